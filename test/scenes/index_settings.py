"""Rigs over which the index is observable, and runs of the live estimate on them.

The tests of the index share it, and `bench/triangulation/index.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from scipy.stats import norm

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation.index import IndexEstimator

PIXEL_STD = 0.1
COVARIANCE = PIXEL_STD**2 * np.eye(2)
CAMERA = PinholeCamera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], [], (1280, 960))
WIDE = PinholeCamera(
    [[600, 0, 639.5], [0, 602, 479.5], [0, 0, 1]], [-0.05, 0.01, 0.0005, 0.0], (1280, 960)
)


class Setting(NamedTuple):
    """A rig through a medium of about `index`, and the box (low, high) its target moves in, m."""

    rig: StereoRig
    low: tuple
    high: tuple


def rig_through(*surfaces, camera=CAMERA, turn=(0, 0, 0), shift=(-0.23, 0, 0)):
    rotation = cv2.Rodrigues(np.array(turn, dtype=float))[0]
    return StereoRig(camera, camera, rotation, shift, *surfaces)


def flat(normal, distance, *indices, glass=()):
    return FlatInterface(normal, distance, indices, glass)


SETTINGS = {
    'washbowl, corner': Setting(
        rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), (0.45, 0.3, 1.2), (0.7, 0.5, 1.3)
    ),
    'oblique to both': Setting(
        rig_through(flat((0.3, 0.3, 1), 0.3, 1, 1.355)), (0.2, 0.0, 0.8), (0.6, 0.4, 1.2)
    ),
    'oblique along the baseline': Setting(
        rig_through(flat((0.5, 0, 1), 0.5, 1, 1.355)), (0.0, 0.15, 0.9), (0.4, 0.4, 1.3)
    ),
    'tank wall': Setting(
        rig_through(flat((0, 0, 1), 0.1, 1, 1.5, 1.355, glass=(0.01,)), camera=WIDE),
        (0.25, 0.15, 0.5),
        (0.45, 0.4, 0.9),
    ),
    'toed in': Setting(
        rig_through(flat((0, 0.2, 1), 0.3, 1, 1.355), turn=(0.01, 0.2, 0.02)),
        (0.2, 0.2, 0.7),
        (0.4, 0.4, 1.1),
    ),
    'wide baseline': Setting(
        rig_through(flat((0, 0, 1), 0.3, 1, 1.355), shift=(-0.6, 0.02, 0.0), camera=WIDE),
        (0.5, 0.2, 0.8),
        (0.8, 0.5, 1.2),
    ),
    'one camera above the other': Setting(
        rig_through(flat((0, 0.3, 1), 0.6, 1, 1.355), shift=(0.0, -0.3, 0.0)),
        (0.2, 0.2, 1.0),
        (0.5, 0.5, 1.4),
    ),
    'one camera ahead': Setting(
        rig_through(flat((0, 0, 1), 0.5, 1, 1.355), shift=(-0.2, 0.0, 0.1)),
        (0.2, 0.2, 0.8),
        (0.5, 0.4, 1.2),
    ),
    'a port each': Setting(
        rig_through(
            None,
            flat((0.1, 0, 1), 0.05, 1, 1.5, 1.355, glass=(0.008,)),
            flat((-0.2, 0.1, 1), 0.05, 1, 1.5, 1.355, glass=(0.008,)),
            camera=WIDE,
        ),
        (-0.1, 0.1, 0.6),
        (0.3, 0.4, 1.0),
    ),
    'brine, far': Setting(
        rig_through(flat((0.2, 0.4, 1), 0.4, 1, 1.355), shift=(-0.4, 0, 0)),
        (0.3, 0.0, 1.0),
        (0.8, 0.5, 1.8),
    ),
}


def path(setting, count, random):
    """Points (count, 3) of the box that both cameras have in the image."""
    points = random.uniform(setting.low, setting.high, (20 * count, 3))
    width, height = setting.rig.left.size
    pixels = images(setting.rig, points).reshape(-1, 2, 2)
    inside = ((pixels > 0) & (pixels < (width, height))).all(axis=(1, 2))
    return points[inside][:count]


def images(rig, points):
    return np.hstack(rig.project(points))


def information(rig, points):
    """Whitened p (N,4) of each pair by finite differences of `project`: |p|^2 is its information.

    The Fisher information on the index with the point eliminated, by a way of its own.
    """
    h = 1e-5
    by_point = np.stack(
        [(images(rig, points + h * e) - images(rig, points - h * e)) / (2 * h) for e in np.eye(3)],
        axis=2,
    )
    index = rig.target_index
    up, down = (images(rig.with_target_index(index + s), points) for s in (h, -h))
    by_index = (up - down) / (2 * h)
    fitted = [
        np.linalg.lstsq(J, g, rcond=None)[0] for J, g in zip(by_point, by_index, strict=True)
    ]
    return (by_index - np.einsum('nij,nj->ni', by_point, fitted)) / PIXEL_STD


def run(estimator, rig, pixels, rate=30.0, start=0.0, std=PIXEL_STD):
    """Feed pairs (N,4) px; return the states."""
    covariance = std**2 * np.eye(2)
    return [
        estimator.update(rig, row[:2], row[2:], covariance, covariance, start + k / rate)
        for k, row in enumerate(pixels)
    ]


def trial(name, runs, pairs, prior_std, random, strata=True):
    """Errors (R,), deviations (R,) of the index and the bound of the deviation, over `runs` runs.

    With `strata` the one combination of all noises that moves the estimate is drawn by strata, the
    rest freely: the same distribution, and a mean square that `runs` runs fix far better than
    free draws do.
    """
    setting = SETTINGS[name]
    points = path(setting, pairs, random)
    rig = setting.rig
    weights = np.concatenate([[1.0 / prior_std], information(rig, points).ravel()])
    bound = 1.0 / np.linalg.norm(weights)
    direction = weights * bound
    quantiles = (random.permutation(runs) + random.uniform(size=runs)) / runs
    drawn = norm.ppf(quantiles) if strata else random.standard_normal(runs)
    errors, stds = [], []
    for along in drawn:
        noise = random.standard_normal(len(weights))
        noise += direction * (along - direction @ noise)
        truth = rig.target_index - prior_std * noise[0]
        exact = images(rig.with_target_index(truth), points)
        estimator = IndexEstimator(rig.target_index, prior_std)
        state = run(estimator, rig, exact + PIXEL_STD * noise[1:].reshape(-1, 4))[-1]
        errors.append(state.mean - truth)
        stds.append(state.std)
    return np.array(errors), np.array(stds), bound


def correlated(random, count, correlation, std):
    noise = random.standard_normal((count, 4))
    for k in range(1, count):
        noise[k] = correlation * noise[k - 1] + math.sqrt(1 - correlation**2) * noise[k]
    return std * noise
