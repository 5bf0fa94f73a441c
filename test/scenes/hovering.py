"""A robot that hovers before a target: its rig's positions, its odometry, what comes of them.

Positions are triangulated from the rig's projection and noise: thousands cost no rendering.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from binopos_ros.platform import FixedFrameOptions, Missing, Platform, PlatformOptions
from binopos_ros.platform.quaternions import matrix_of
from binopos_ros.simulation import ports
from binopos_ros.simulation.rig_motion import (
    FIXED_FRAME,
    ROBOT_FRAME,
    Odometer,
    mounting,
    rig_motion,
)
from binopos_ros.smoothing.stage import make_smoother
from binopos_ros.triangulation import triangulate

Array = NDArray[np.float64]

RATE = 30.0
AMPLITUDE, FREQUENCY = 0.1, 0.2  # m and Hz of a target that moves in the world


@dataclass(frozen=True)
class Outcome:
    """Errors (N, 3) in the fixed frame, m, and normalised squares (N,) divided by three.

    `raw` are the positions as they come; `optimal` is the mean weighted by the true covariances,
    the best that can be made of a target at rest; `own` the same with the covariances that the
    platform states; `pose` the smoother's.
    """

    raw: Array
    optimal: Array
    own: Array
    own_square: Array
    pose: Array
    pose_square: Array


def hovering(
    distance: float,
    pixel_noise: float,
    odometer: Odometer,
    seed: int,
    moving: bool = False,
    count: int = 300,
) -> Outcome:
    """Follow a target from a hovering robot.

    Args:
        distance: of the target before the rig, m.
        pixel_noise: standard deviation of each pixel coordinate.
        odometer: what the robot knows of its pose.
        seed: of motion and noise.
        moving: the target goes round in a circle; else it is at rest.
        count: of pairs, at 30 Hz.
    """
    rng = np.random.default_rng(seed)
    motion = rig_motion('hover', rng)
    rig = ports().rig
    times = np.arange(count) / RATE
    angle = 2 * np.pi * FREQUENCY * times
    start = motion.rig_poses(0.0)
    target = start[0][0] + start[1][0] @ [0.06, 0.02, distance]
    truth = np.repeat(target[None], count, axis=0)
    if moving:
        circle = np.column_stack([np.sin(angle), np.cos(angle), np.zeros(count)])
        truth = truth + AMPLITUDE * circle
    places, turns = motion.rig_poses(times)
    pixels = rig.project(np.einsum('nji,nj->ni', turns, truth - places))
    noisy = [each + rng.normal(0, pixel_noise, each.shape) for each in pixels]
    noise = np.repeat(pixel_noise**2 * np.eye(2)[None], count, axis=0)
    found = triangulate(rig, *noisy, noise, noise)

    ticks = np.arange(-0.1, times[-1] + 0.1, 1 / odometer.rate)
    samples = iter(zip(ticks, odometer.samples(motion, ticks, rng), strict=True))
    options = PlatformOptions(source='odometry', mounting=mounting())
    platform = Platform(FixedFrameOptions(FIXED_FRAME, options))
    # What docs/robot.md says to set for a target that stands still in the world.
    smoother = make_smoother({'resting_frames': 1e4, 'max_turning': 0.0})
    sums = {name: (np.zeros((3, 3)), np.zeros(3)) for name in ('optimal', 'own')}
    result: dict[str, list[Array]] = {name: [] for name in Outcome.__annotations__}
    told = -1.0
    for k in range(count):
        while told < times[k]:
            told, (place, turn) = next(samples)
            reason = platform.odometry.add(
                round((1 + told) * 1e9), FIXED_FRAME, ROBOT_FRAME, place, turn, odometer.covariance
            )
            assert not reason
        stamp = round((1 + times[k]) * 1e9)
        pose = platform.rig_pose(stamp, 'left')
        assert not isinstance(pose, Missing), pose
        placed = pose.carry(found.points[k], found.covariances[k])
        own = placed.covariance
        # The truth of the noise: pixels, and what interpolation leaves of two samples'.
        lever = placed.point - pose.placed.pivot
        turn_part = odometer.rotation_std**2 * (lever @ lever * np.eye(3) - np.outer(lever, lever))
        robot = pose.placed.white * (odometer.position_std**2 * np.eye(3) + turn_part)
        axes = matrix_of(pose.placed.pose.rotation)
        true = axes @ found.covariances[k] @ axes.T + robot
        result['raw'].append(placed.point - truth[k])
        for name, covariance in (('optimal', true), ('own', own)):
            information, weighted = sums[name]
            inverse = np.linalg.inv(covariance)
            information += inverse
            weighted += inverse @ placed.point
            error = np.linalg.solve(information, weighted) - truth[k]
            result[name].append(error)
            if name == 'own':
                result['own_square'].append(error @ information @ error / 3)
        smoothed, _ = smoother.add(stamp, *placed)
        assert smoothed is not None
        error = smoothed.state.position - truth[k]
        result['pose'].append(error)
        covariance = smoothed.state.covariance[:3, :3]
        result['pose_square'].append(error @ np.linalg.solve(covariance, error) / 3)
    return Outcome(**{name: np.array(values) for name, values in result.items()})


def rms(errors: Array) -> float:
    """Root of the mean squared length of (N, 3) errors."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))
