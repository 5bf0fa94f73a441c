"""The detector as a whole: choosing, refusing, following, and the paper's rule."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.detection import (
    DetectionError,
    Detector,
    DetectorOptions,
    JpegImage,
    RawImage,
    decode,
    detect,
)
from binopos_ros.detection import detector as detector_module
from binopos_ros.detection.search import find
from binopos_ros.detection.stage import stages_of_pair
from binopos_ros.parameters import specs_of

GROUND, RED = (150, 140, 110), (40, 40, 190)


def tank(*blobs, size=(480, 640), seed=0, noise=2.0):
    """A grey-green picture with ellipses: (centre, semi-axes, degrees, colour)."""
    picture = np.full((*size, 3), GROUND, np.uint8)
    for centre, axes, degrees, colour in blobs:
        scaled = [tuple(round(16 * each) for each in pair) for pair in (centre, axes)]
        cv2.ellipse(picture, *scaled, degrees, 0, 360, colour, -1, cv2.LINE_AA, 4)
    noisy = picture + np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def raw(picture):
    height, width = picture.shape[:2]
    return RawImage(picture.tobytes(), width, height, 3 * width, 'bgr8')


def refused(detection):
    return [each.reason for each in detection.candidates if each.reason]


def test_nothing_is_found_where_there_is_nothing_red():
    for colour in ((60, 200, 60), (200, 60, 40), (240, 240, 240), (20, 20, 20), (30, 200, 200)):
        detection = Detector().detect(raw(tank(((300, 200), (25, 25), 0, colour))))
        assert detection.target is None
        assert detection.reason


def test_a_strip_is_refused_for_its_shape_and_a_disc_is_taken():
    picture = tank(((420, 100), (90, 8), 20, RED), ((200, 330), (22, 17), 30, RED))
    detection = Detector().detect(raw(picture))
    assert np.allclose(detection.target.centre, (200, 330), atol=0.2)
    assert any('axis ratio' in reason for reason in refused(detection))


def test_a_ragged_patch_is_refused_for_its_shape():
    picture = tank()
    corners = np.array([[300, 200], [360, 200], [360, 215], [315, 215], [315, 260], [300, 260]])
    cv2.fillPoly(picture, [corners], RED)
    detection = Detector().detect(raw(picture))
    assert detection.target is None
    assert any('ellipse' in reason for reason in refused(detection))


def test_sizes_outside_of_the_range_are_refused():
    picture = tank(((200, 200), (20, 20), 0, RED))
    for limits in ({'min_diameter': 60.0}, {'max_diameter': 30.0}):
        detection = Detector(**limits).detect(raw(picture))
        assert detection.target is None
        assert any('diameter' in reason for reason in refused(detection))


def test_a_disc_cut_by_the_edge_of_the_image_is_refused():
    detection = Detector().detect(raw(tank(((630, 200), (30, 30), 0, RED))))
    assert detection.target is None
    assert any('edge of the image' in reason for reason in refused(detection))


def test_the_upper_of_two_like_patches_is_the_mirror_image():
    picture = tank(((300, 90), (26, 24), 0, RED), ((305, 330), (24, 24), 0, RED))
    detection = Detector().detect(raw(picture))
    assert np.allclose(detection.target.centre, (305, 330), atol=0.2)
    assert any('mirror image' in reason for reason in refused(detection))
    free = Detector(mirror_above=False).detect(raw(picture))
    assert not any('mirror image' in reason for reason in refused(free))
    assert any('ranks higher' in reason for reason in refused(free))


def test_a_smaller_cap_below_does_not_make_the_target_a_mirror_image():
    picture = tank(((300, 200), (26, 26), 0, RED), ((302, 280), (8, 6), 0, (35, 35, 120)))
    detection = Detector().detect(raw(picture))
    assert np.allclose(detection.target.centre, (300, 200), atol=0.2)


def test_red_that_has_lost_its_red_is_found_by_its_contrast():
    picture = tank(((320, 240), (30, 30), 0, (150, 130, 150)), noise=1.5)
    picture[..., 2] = np.where(np.all(picture > 128, axis=2), picture[..., 2], 40)
    picture[..., 2][np.hypot(*(np.indices((480, 640)).T - (240, 320)).T) > 40] = 30
    target = detect(picture)
    assert target is not None
    assert np.allclose(target.centre, (320, 240), atol=0.5)


def test_brightness_does_not_change_what_is_found():
    picture = tank(((200, 330), (22, 17), 30, RED))
    for gain in (0.35, 0.6, 1.2):
        dimmer = np.clip(picture * gain, 0, 255).astype(np.uint8)
        assert np.allclose(detect(dimmer).centre, (200, 330), atol=0.2)


def test_following_and_searching_give_the_same_digits():
    rng = np.random.default_rng(3)
    follower = Detector()
    place, speed, tracked = np.array([200.0, 200.0]), np.array([5.0, 3.0]), 0
    for k in range(120):
        speed = speed + rng.normal(0, 0.7, 2) + 0.02 * (np.array([320, 240]) - place)
        place = place + speed
        axes = 14 + 10 * np.sin(k / 15), 12 + 6 * np.cos(k / 19)
        picture = tank((place, axes, 3 * k, RED), seed=k)
        image = JpegImage(cv2.imencode('.jpg', picture)[1].tobytes()) if k % 2 else raw(picture)
        followed, alone = follower.detect(image), Detector().detect(image)
        tracked += followed.tracked
        assert followed.target is not None
        assert alone.target is not None
        assert np.abs(followed.target.centre - alone.target.centre).max() <= 1e-9
        assert np.abs(followed.target.covariance - alone.target.covariance).max() <= 1e-12
    assert tracked > 110


def test_following_keeps_to_the_target_when_a_larger_patch_appears():
    follower = Detector(mirror_above=False)
    follower.detect(raw(tank(((150, 200), (14, 14), 0, RED))))
    both = tank(((152, 201), (14, 14), 0, RED), ((480, 300), (40, 40), 0, RED))
    assert np.allclose(follower.detect(raw(both)).target.centre, (152, 201), atol=0.3)
    assert np.allclose(detect(both, mirror_above=False).centre, (480, 300), atol=0.3)


def test_a_survey_tells_of_what_was_passed_over_while_following():
    picture = tank(
        ((150, 300), (14, 14), 0, RED),
        ((480, 300), (40, 40), 0, RED),
        ((420, 100), (90, 8), 20, RED),
    )
    follower = Detector(mirror_above=False)
    follower.detect(raw(tank(((150, 300), (14, 14), 0, RED))))
    plain = follower.detect_in(decode(raw(picture)))
    survey = follower.detect_in(decode(raw(picture)), survey=True)
    assert plain.tracked
    assert survey.tracked
    assert np.array_equal(plain.target.centre, survey.target.centre)
    assert not refused(plain)
    assert any('axis ratio' in reason for reason in refused(survey))
    assert any('followed elsewhere' in reason for reason in refused(survey))


def test_a_target_that_leaves_and_comes_back_elsewhere_is_found_again():
    follower = Detector()
    assert follower.detect(raw(tank(((150, 200), (14, 14), 0, RED)))).target is not None
    assert follower.detect(raw(tank())).target is None
    back = follower.detect(raw(tank(((500, 90), (14, 14), 0, RED))))
    assert not back.tracked
    assert np.allclose(back.target.centre, (500, 90), atol=0.2)
    jump = follower.detect(raw(tank(((80, 400), (14, 14), 0, RED))))
    assert np.allclose(jump.target.centre, (80, 400), atol=0.2)


def test_a_decoy_taken_while_the_target_was_hidden_is_not_followed_for_ever():
    decoy = ((90, 400), (8, 8), 0, RED)
    detector = Detector()
    found = []
    for k in range(70):
        target = ((200 + 2 * k, 200), (16, 16), 0, RED)
        hidden = 5 <= k < 9
        picture = tank(*([decoy] if hidden else [decoy, target]), seed=k)
        seen = detector.detect(raw(picture)).target
        found.append(seen is not None and seen.centre[0] > 150)
    assert all(found[:5])
    assert not any(found[5:9])
    assert all(found[-10:])


@pytest.mark.parametrize('phase', [0, 7])
@pytest.mark.parametrize('looks_at_once', [True, False])
def test_a_decoy_is_found_out_after_45_followed_images_at_the_latest(phase, looks_at_once):
    decoy, target = ((90, 400), (8, 8), 0, RED), ((300, 200), (16, 16), 0, RED)
    detector = Detector(phase=phase)
    assert detector.detect(raw(tank(decoy))).target.centre[0] < 150
    both = decode(raw(tank(decoy, target)))
    found = []
    for _ in range(45):
        found.append(detector.detect_in(both).target.centre[0] > 150)
        if looks_at_once:
            detector.look_over()
    assert found.index(True) == 44 - phase


def test_the_two_cameras_of_a_rig_look_over_different_pairs(monkeypatch):
    searched, turn = [], ()
    picture = decode(raw(tank(((300, 200), (16, 16), 0, RED))))
    monkeypatch.setattr(
        detector_module, 'find', lambda *each: (searched.append(turn), find(*each))[1]
    )
    stages = stages_of_pair(DetectorOptions())
    for pair in range(31):
        for side, stage in stages.items():
            turn = pair, side, 'before the answer'
            assert stage.detect(pair + 1, picture).target is not None
            turn = pair, side, 'after it'
            stage.look_over()
    first = [(0, 'left', 'before the answer'), (0, 'right', 'before the answer')]
    looks = [(7, 'right'), (14, 'left'), (22, 'right'), (29, 'left')]
    assert searched == first + [(*look, 'after it') for look in looks]


def test_the_threshold_follows_the_noise_and_is_reported():
    calm, rough = (
        Detector(noise_factor=6.0).detect(raw(tank(noise=noise, size=(240, 320))))
        for noise in (1.0, 25.0)
    )
    assert calm.threshold == pytest.approx(0.12)
    assert rough.threshold > 0.2
    assert rough.target is None


def test_a_dark_part_of_the_picture_hides_nothing_in_the_bright_one():
    for seed in range(3):
        picture = np.full((480, 640, 3), (150.0, 140.0, 110.0))
        cv2.circle(picture, (480, 240), 15, (120, 110, 140), -1)
        picture[:, :400] *= 0.1
        noise = np.random.default_rng(seed).normal(0, 6, picture.shape)
        noisy = np.clip(np.round(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise), 0, 255)
        target = Detector().detect(raw(noisy.astype(np.uint8))).target
        assert np.allclose(target.centre, (480, 240), atol=1)


def test_the_papers_rule_is_the_middle_of_the_four_extremes():
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[40:61, 30:71] = (10, 49, 169)
    picture[10, 10] = (0, 50, 255)
    picture[20, 20] = (0, 0, 168)
    target = detect(picture, method='paper')
    assert target.centre == pytest.approx((50, 50))
    assert target.diameter == 41
    picture[100, 150] = (0, 0, 255)
    assert detect(picture, method='paper').centre == pytest.approx((90, 70))
    nothing = Detector(method='paper').detect(raw(np.zeros((120, 160, 3), np.uint8)))
    assert nothing.target is None
    assert 'R > 168 and G < 50' in nothing.reason


@pytest.mark.parametrize(
    ('options', 'word'),
    [
        ({'method': 'best'}, 'method'),
        ({'min_diameter': -1.0}, 'min_diameter'),
        ({'min_fit': float('nan')}, 'min_fit'),
        ({'paper_red': 300}, 'paper_red'),
        ({'min_diameter': 50.0, 'max_diameter': 20.0}, 'max_diameter'),
        ({'colour': 'red'}, 'colour'),
    ],
)
def test_bad_options_are_refused_in_one_line(options, word):
    with pytest.raises(DetectionError, match=word) as caught:
        Detector(**options)
    assert '\n' not in str(caught.value)


def test_every_option_is_described_for_the_node():
    for name, spec in specs_of(DetectorOptions).items():
        assert spec.description, name
        assert spec.kind in (str, bool) or spec.limits is not None, name
        if spec.limits is not None:
            assert spec.limits[0] <= spec.default <= spec.limits[1], name


def test_detect_refuses_arrays_of_another_kind():
    for array in (np.zeros((10, 10), np.uint8), np.zeros((10, 10, 3)), np.zeros((9, 9, 4), 'u1')):
        with pytest.raises(DetectionError, match='uint8'):
            detect(array)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(8, 70), st.integers(8, 70)),
    st.floats(0, 255),
)
def test_whatever_the_pixels_are_the_answer_is_finite_or_has_a_reason(seed, size, spread):
    rng = np.random.default_rng(seed)
    picture = np.clip(rng.normal(128, spread, (*size, 3)), 0, 255).astype(np.uint8)
    if seed % 3 == 0:
        picture[: size[0] // 2] = picture[0, 0]
    detection = Detector().detect_in(decode(raw(picture)))
    if detection.target is None:
        assert detection.reason
        return
    target = detection.target
    assert np.isfinite(target.centre).all()
    assert np.linalg.eigvalsh(target.covariance).min() > 0
    assert 0 <= target.centre[0] <= size[1] - 1
    assert 0 <= target.centre[1] <= size[0] - 1


def test_a_dim_noisy_target_is_found_and_followed():
    rng = np.random.default_rng(6)
    follower, found, tracked = Detector(), 0, 0
    for k in range(32):
        # A fifth of the light, and noise of 8 grey levels: single pixels tell nothing.
        centre = (150 + 3.0 * k, 120 + 1.5 * k)
        dim = 0.22 * tank((centre, (15, 14), 0, RED), noise=0.0).astype(float)
        picture = np.clip(np.round(dim + rng.normal(0, 8, dim.shape)), 0, 255).astype(np.uint8)
        detection = follower.detect(raw(picture))
        tracked += detection.tracked
        if detection.target is not None:
            found += 1
            assert np.allclose(detection.target.centre, centre, atol=1.0)
    assert found >= 31
    assert tracked >= 28
