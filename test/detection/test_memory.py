"""What only several images tell: what is new, of another size, or drawn over the picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from binopos_ros.detection import Detector, RawImage

GROUND, RED = np.array((150.0, 140.0, 110.0)), (40, 40, 190)
SIZE = (240, 320)
#: Images until three looks in a row, 15 images apart, are compared.
LOOKS = 62


@pytest.fixture(scope='module')
def floor():
    """An uneven floor, wider than the picture."""
    rough = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 1, (240, 700)), (0, 0), 6)
    return GROUND + 15 * (rough / rough.std())[..., None]


def image(ground, *blobs, seed=0, drawn=None, light=None):
    """Blobs (u, v, radius) on a ground, with noise; `drawn` over it, (u, v, radius)."""
    picture = np.clip(ground, 0, 255).astype(np.uint8)
    for blob in blobs:
        paint(picture, blob)
    if light is not None:
        picture = picture * light[..., None]
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    picture = np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)
    if drawn is not None:
        paint(picture, drawn)
    return RawImage(picture.tobytes(), SIZE[1], SIZE[0], 3 * SIZE[1], 'bgr8')


def paint(picture, blob):
    u, v, radius = (round(16 * each) for each in blob)
    cv2.circle(picture, (u, v), radius, RED, -1, cv2.LINE_AA, 4)


def plain():
    return np.broadcast_to(GROUND, (*SIZE, 3))


def reasons(detection):
    return ' '.join(each.reason for each in detection.candidates)


def test_glints_that_last_for_an_image_or_two_are_no_target():
    rng, detector = np.random.default_rng(1), Detector()
    for k in range(40):
        glints = [
            (rng.uniform(40, 280), rng.uniform(40, 200), rng.uniform(4, 20))
            for _ in range(int(k % 4 in (1, 2)))
        ]
        detection = detector.detect(image(plain(), *glints, seed=k))
        assert detection.target is None
        assert not glints or 'new: seen in' in detection.reason


def test_a_target_that_comes_into_view_is_believed_in_its_third_image_wherever_it_goes():
    detector = Detector()
    assert detector.detect(image(plain())).target is None
    found = [
        detector.detect(image(plain(), (60 + 25 * k, 100, 9 + k))).target is not None
        for k in range(6)
    ]
    assert found == [False, False, True, True, True, True]


def test_one_image_alone_is_believed():
    assert Detector().detect(image(plain(), (150, 100, 12))).target is not None
    alone = Detector(track=False)
    assert alone.detect(image(plain())).target is None
    assert alone.detect(image(plain(), (150, 100, 12))).target is not None


def test_a_hidden_targets_place_is_not_given_to_what_is_of_another_size():
    detector = Detector()
    for k in range(4):
        detector.detect(image(plain(), (150, 120, 16), (60, 60, 7), seed=k))
    hidden = detector.detect(image(plain(), (60, 60, 7)))
    assert hidden.target is None
    back = detector.detect(image(plain(), (158, 120, 17), (60, 60, 7)))
    assert np.allclose(back.target.centre, (158, 120), atol=0.1)
    in_its_place = detector.detect(image(plain(), (158, 120, 7)))
    assert in_its_place.target is None
    assert 'new' in reasons(in_its_place)


def test_what_is_drawn_over_a_moving_picture_is_found_out(floor):
    detector, answers = Detector(), []
    for k in range(LOOKS):
        moving = floor[:, 4 * k : 4 * k + SIZE[1]]
        answers.append(detector.detect(image(moving, seed=k, drawn=(280, 40, 12))))
    assert answers[-1].target is None
    assert 'stands still' in answers[-1].reason
    # And a target beside it is taken, in its third image as it is new.
    for k in range(3):
        moving = floor[:, 2 * k : 2 * k + SIZE[1]]
        seen = image(moving, (100 + 3 * k, 150, 20), seed=k, drawn=(280, 40, 12))
        detection = detector.detect(seen)
    assert np.allclose(detection.target.centre, (106, 150), atol=0.1)
    assert 'stands still' in reasons(detection)


@pytest.mark.parametrize('moves', ['nothing', 'the light', 'the camera'])
def test_a_target_is_kept_where_nothing_moves_and_where_it_moves_with_the_rest(floor, moves):
    detector = Detector()
    light = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 1, (240, 700)), (0, 0), 8)
    light = 1 + 0.2 * light / light.std()
    for k in range(LOOKS):
        ground, shown, u = floor[:, : SIZE[1]], None, 200.0
        if moves == 'the light':
            shown = light[:, 4 * k : 4 * k + SIZE[1]]
        elif moves == 'the camera':
            ground, u = floor[:, 2 * k : 2 * k + SIZE[1]], 300.0 - 2 * k
        detection = detector.detect(image(ground, (u, 120, 14), seed=k, light=shown))
        assert detection.target is not None, (k, detection.reason)
