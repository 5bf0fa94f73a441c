"""Coloured discs in water of ten colours.

The water is the textbook's: a colour seen through it is its own, less what the water takes of each
channel over the way, and as much of the water's own colour instead.
"""

from __future__ import annotations

import cv2
import numpy as np

from binopos_ros.detection import JpegImage

# Blue, green, red; the last is how many times as strongly red is taken as green.
WATERS = [
    ((110, 140, 150), 1.2), ((120, 120, 60), 1.6), ((150, 140, 40), 2.0), ((160, 110, 30), 2.5),
    ((90, 120, 60), 1.6), ((130, 100, 100), 1.3), ((70, 105, 60), 1.6), ((140, 140, 130), 1.1),
    ((90, 60, 20), 2.5), ((170, 170, 80), 1.5),
]  # fmt: skip
RED = (38, 34, 195)
OTHERS = {
    'yellow': (30, 190, 210),
    'orange': (15, 140, 240),
    'pink': (180, 105, 255),
    'magenta': (170, 40, 200),
}


def seen(colour, water, way):
    """A colour over a way through the water, in lengths over which green falls to 1/e."""
    veil, strength = water
    left = np.exp(-way * np.array([1.0, 1.0, strength]))
    return np.array(colour) * left + np.array(veil) * (1 - left)


def tank(water, *discs, way=0.25, seed=0):
    picture = np.full((240, 320, 3), water[0], float)
    for (u, v), radius, colour in discs:
        fine = np.zeros((960, 1280), np.uint8)
        cv2.circle(fine, (4 * u + 1, 4 * v + 1), 4 * radius, 255, -1)
        share = cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA)[..., None] / 255
        picture = picture * (1 - share) + seen(colour, water, way) * share
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    picture = np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)
    return JpegImage(cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes())
