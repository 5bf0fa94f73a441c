"""The picture for people."""

from __future__ import annotations

import cv2
import numpy as np

from binopos_ros.detection import Detection, Detector, RawImage
from binopos_ros.detection.overlay import DOUBT, FOUND, REFUSED, draw


def scene(*discs):
    picture = np.full((240, 320, 3), (150, 140, 110), np.uint8)
    for centre, axes in discs:
        cv2.ellipse(picture, centre, axes, 0, 0, 360, (40, 40, 190), -1, cv2.LINE_AA)
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def detected(picture):
    return Detector().detect(RawImage(picture.tobytes(), 320, 240, 960, 'bgr8'))


def near(drawn, colour, tolerance=40):
    return np.abs(drawn.astype(int) - colour).max(axis=2) < tolerance


def test_the_outline_lies_on_the_edge_of_the_target_and_the_image_is_kept():
    picture = scene(((160, 120), (40, 30)))
    before = picture.copy()
    drawn = draw(picture, detected(picture))
    assert np.array_equal(picture, before)
    rows, columns = np.nonzero(near(drawn, FOUND)[60:180, 100:220])
    radius = np.hypot((columns + 100 - 160) / 40, (rows + 60 - 120) / 30)
    assert np.sum(np.abs(radius - 1) < 0.06) > 150


def test_the_ellipse_of_doubt_is_drawn_at_the_scale_asked_for():
    picture = scene(((160, 120), (40, 30)))
    detection = detected(picture)
    for magnification in (400.0, 800.0):
        rows, columns = np.nonzero(near(draw(picture, detection, magnification), DOUBT))
        sigma = np.sqrt(np.diag(detection.target.covariance))
        expected = 3 * magnification * sigma
        assert np.ptp(columns) / 2 == np.clip(np.ptp(columns) / 2, *(expected[0] + [-3, 3]))
        assert np.ptp(rows) / 2 == np.clip(np.ptp(rows) / 2, *(expected[1] + [-3, 3]))


def test_what_was_refused_is_outlined_and_told():
    picture = scene(((160, 120), (90, 6)))
    detection = detected(picture)
    assert detection.target is None
    drawn = draw(picture, detection)
    assert near(drawn, REFUSED).sum() > 150
    assert not near(drawn, FOUND).any()


def test_a_detection_without_candidates_still_tells_its_reason():
    drawn = draw(scene(), Detection(None, 'no red patch'))
    assert near(drawn, REFUSED).sum() > 30
