"""A rig that is not what its calibration says: drawn from its own covariance, again and again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.motions import Conditions, draw_views, ports_rig
from binopos_ros.optics import StereoRig
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.tracker import Tracked, Tracker
from binopos_ros.triangulation.triangulate import shared_covariances

Array = NDArray[np.float64]

#: At 1 m: deviation of what all frames share (m), and the noise (px) that makes 0.3 mm.
_SHARED, _PIXEL_STD = 2e-3, 0.026
#: What calibrations leave of each parameter, relative to each other, by the end of its name.
_SIZES = {'fx': 1.0, 'fy': 1.0, 'cx': 1.0, 'cy': 1.0, 'x': 1e-3, 'y': 1e-3, 'z': 1e-3}


class Judged(NamedTuple):
    """Mean stated deviation (m, over the three axes together) and mean squared error by it."""

    deviation: float
    squares: float


class Drawn(NamedTuple):
    """Of the last raw position and of the last pose of each rig drawn."""

    position: Judged
    pose: Judged


def calibrated_rig() -> tuple[StereoRig, Array]:
    """Return a rig behind ports and the covariance (K, K) of all its parameters.

    The covariance is such that a target 1 m ahead is off by 2 mm.
    """
    plain = ports_rig()
    rig = UncertainRig(
        plain.left,
        plain.right,
        plain.rotation,
        plain.translation,
        left_port=plain.left_port,
        right_port=plain.right_port,
    )
    sizes = [_SIZES.get(name.rsplit('.', 1)[-1], 0.0) for name in rig.parameter_names]
    covariance = np.diag(np.square(sizes))
    point = np.array([[0.06, 0.0, 1.0]])
    pixels = np.eye(2)[None]
    jacobians = rig.differentiate(point)
    information = sum(
        np.swapaxes(each, 1, 2) @ each
        for each in (jacobians.left_by_point, jacobians.right_by_point)
    )
    noise = np.asarray(np.linalg.inv(information), dtype=np.float64)
    shared = shared_covariances(rig, point, noise, (pixels, pixels), covariance)
    return rig, covariance * (_SHARED**2 / np.trace(shared[0]))


def last_seen(
    rig: StereoRig, truth: StereoRig, covariance: Array | None, seed: int, frames: int = 10
) -> tuple[Tracked, Array]:
    """Return what `rig` says at last of a still target that `truth` saw, and where it is, m."""
    conditions = Conditions(pixel_std=_PIXEL_STD, frames=frames)
    views = draw_views('still', truth, conditions, seed)
    tracker = Tracker(rig, covariance)
    for stamp, left, right in zip(views.stamps.tolist(), views.left, views.right, strict=True):
        tracked = tracker.step(stamp, left, right, views.covariance, views.covariance)
    return tracked, views.truth[-1]


def drawn_squares(count: int, frames: int = 10) -> Drawn:
    """Return how the covariance of a calibrated rig holds for `count` rigs drawn from it.

    Each sees a still target in so many frames.
    """
    rig, covariance = calibrated_rig()
    random = np.random.default_rng(1)
    found: dict[str, list[tuple[float, float]]] = {'position': [], 'pose': []}
    for seed in range(count):
        change = random.standard_normal(len(covariance)) * np.sqrt(np.diag(covariance))
        tracked, place = last_seen(rig, rig.perturbed(change), covariance, seed, frames)
        assert tracked.pose is not None
        for name, point, spread in (
            ('position', tracked.position, tracked.covariance),
            ('pose', tracked.pose.position, tracked.pose.covariance[:3, :3]),
        ):
            error = point - place
            squares = float(error @ np.linalg.solve(spread, error)) / 3.0
            found[name].append((float(np.trace(spread)), squares))
    means = {name: np.mean(values, axis=0) for name, values in found.items()}
    return Drawn(*(Judged(float(np.sqrt(m[0])), float(m[1])) for m in means.values()))
