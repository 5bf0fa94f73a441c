"""Targets that are hidden in part, cut by the image's edge, framed in black or merged with red."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from binopos_ros.detection import Detector, JpegImage, RawImage
from looks import BALL, DISC, HIDDEN, LOOKS, plain_script, take

GROUND, RED = np.array([140.0, 135.0, 90.0]), np.array([40.0, 36.0, 190.0])


def found(picture, **options):
    height, width = picture.shape[:2]
    image = RawImage(np.ascontiguousarray(picture).tobytes(), width, height, 3 * width, 'bgr8')
    return Detector(**options).detect(image)


def painted(shares, seed=0, size=(160, 200)):
    """A picture of red shapes, each drawn by a function at four times the size."""
    fine = np.zeros((4 * size[0], 4 * size[1]), np.uint8)
    for draw in shares:
        draw(fine)
    share = cv2.resize(fine, size[::-1], interpolation=cv2.INTER_AREA)[..., None] / 255
    share = cv2.GaussianBlur(share, (0, 0), 0.8)[..., None]
    picture = GROUND * (1 - share) + RED * share
    return picture + np.random.default_rng(seed).normal(0, 2, picture.shape)


def disc(u, v, radius):
    centre = (round(16 * (4 * u + 1.5)), round(16 * (4 * v + 1.5)))
    return lambda fine: cv2.circle(fine, centre, 64 * radius, 255, -1, cv2.LINE_8, 4)


def as_picture(mean):
    return np.clip(np.round(mean), 0, 255).astype(np.uint8)


@pytest.mark.parametrize('look', HIDDEN)
@pytest.mark.parametrize('diameter', [32, 60])
def test_a_target_of_which_a_third_is_hidden_is_measured_by_the_rest(look, diameter):
    rng = np.random.default_rng(diameter)
    errors, squared, whole = [], [], []
    for _ in range(25):
        taken = take(HIDDEN[look], diameter, rng)
        target = found(taken.picture).target
        assert target is not None
        error = target.centre - taken.centre
        errors.append(error)
        squared.append(error @ np.linalg.solve(target.covariance, error))
        seen_whole = found(take(BALL if 'ball' in look else DISC, diameter, rng).picture).target
        whole.append(np.trace(seen_whole.covariance))
        assert np.trace(target.covariance) > 1.5 * np.mean(whole)
    assert np.sqrt(np.mean(np.square(errors))) < 0.12
    assert np.mean(squared) < 7


def test_what_is_cut_a_little_by_the_image_is_not_lost_and_what_is_cut_in_half_is_refused():
    whole = as_picture(painted([disc(60.3, 80.2, 24)]))
    slightly = found(whole[:, 42:])
    assert np.allclose(slightly.target.centre, (18.3, 80.2), atol=0.15)
    assert np.trace(slightly.target.covariance) > np.trace(found(whole).target.covariance)
    half = found(whole[:, 60:])
    assert half.target is None
    assert 'edge of the image' in half.candidates[0].reason


def test_what_touches_a_black_frame_is_not_lost():
    mean = painted([disc(30.4, 80.7, 20)])
    mean[:, :17] = 0
    target = found(as_picture(mean)).target
    assert np.allclose(target.centre, (30.4, 80.7), atol=0.2)


def test_what_merges_with_something_red_is_measured_by_its_own_outline():
    def cap(fine):
        cv2.rectangle(fine, (4 * 92, 4 * 90), (4 * 108, 4 * 118), 255, -1)

    target = found(as_picture(painted([disc(100.2, 70.4, 26), cap]))).target
    assert np.allclose(target.centre, (100.2, 70.4), atol=0.3)


def test_the_share_that_must_be_seen_can_be_set():
    taken = take(HIDDEN['a third hidden'], 50, np.random.default_rng(3))
    refused = found(taken.picture, min_seen=0.9)
    assert refused.target is None
    assert 'of its outline is seen' in refused.candidates[0].reason


def test_a_tilted_disc_is_not_taken_for_a_part_of_a_circle():
    def ellipse(fine):
        cv2.ellipse(fine, (401, 321), (140, 70), 30, 0, 360, 255, -1)

    target = found(as_picture(painted([ellipse]))).target
    assert np.allclose(target.centre, (99.9, 79.9), atol=0.1)
    assert target.outline.semi_axes == pytest.approx((35, 17.5), abs=0.3)


@pytest.mark.parametrize('diameter', [30, 70])
def test_a_highlight_is_no_hole_in_the_target(diameter):
    rng = np.random.default_rng(diameter)
    for _ in range(8):
        taken = take(LOOKS['ball, highlight'], diameter, rng)
        target = found(taken.picture).target
        assert target is not None
        assert np.linalg.norm(target.centre - taken.centre) < 0.06
        assert np.trace(target.covariance) < 0.05**2


def test_a_dark_limb_in_a_jpeg_is_measured_better_than_by_a_plain_script():
    rng, errors, script, squared = np.random.default_rng(8), [], [], []
    for _ in range(12):
        taken = take(LOOKS['ball, dark limb on dark water'], rng.uniform(36, 44), rng)
        data = cv2.imencode('.jpg', taken.picture, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
        target = Detector().detect(JpegImage(data.tobytes())).target
        errors.append(target.centre - taken.centre)
        squared.append(errors[-1] @ np.linalg.solve(target.covariance, errors[-1]))
        script.append(plain_script(cv2.imdecode(data, cv2.IMREAD_COLOR)) - taken.centre)
    rms, beside = (np.sqrt(np.mean(np.square(each))) for each in (errors, script))
    assert rms < 0.6 * beside
    assert np.mean(squared) < 4


def test_the_light_on_a_ball_does_not_shift_its_centre_where_a_jpegs_chroma_is_blurred():
    rng, errors, squared = np.random.default_rng(9), [], []
    for _ in range(12):
        taken = take(BALL, rng.uniform(36, 44), rng)
        data = cv2.imencode('.jpg', taken.picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
        target = Detector().detect(JpegImage(data.tobytes())).target
        errors.append(target.centre - taken.centre)
        squared.append(errors[-1] @ np.linalg.solve(target.covariance, errors[-1]))
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
    assert np.mean(squared) < 3.5
