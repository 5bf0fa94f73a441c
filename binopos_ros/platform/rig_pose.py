"""The rig's pose in the fixed frame, with its covariance, and positions carried there by it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.platform.quaternions import (
    Vector,
    conjugate,
    matrix_of,
    product,
    rotation_vector,
)
from binopos_ros.platform.transforms import Transform

Array = NDArray[np.float64]


AT_REST: Array = np.zeros(3)


class PlacedRig(NamedTuple):
    """Where the rig is, without what is known of the errors.

    Attributes
    ----------
    pose : Transform
        Of the rig in the fixed frame.
    pivot : tuple of float
        Place in the fixed frame (m) about which errors of rotation turn: the robot's own origin.
    white : float
        Variance left by the interpolation of samples that err independently of each other, 0.5
        to 1 of theirs.
    span : float
        Seconds between the samples.
    velocity, turn : (3,) array
        Of the rig in the fixed frame (m/s, rad/s), from the same samples.

    """

    pose: Transform
    pivot: Vector
    white: float
    span: float
    velocity: Array
    turn: Array


class FixedPosition(NamedTuple):
    """A position in the fixed frame: (3,) m, and covariances (3, 3), m^2.

    `systematic` and `medium` are the parts of `covariance` that `Smoother.add` knows.
    """

    point: Array
    covariance: Array
    systematic: Array | None
    medium: Array | None


@dataclass(frozen=True)
class RigPose:
    """The rig in the fixed frame, with the robot's own uncertainty.

    Attributes
    ----------
    placed : PlacedRig
        Where it is.
    sample : (6, 6) array or None
        Covariance of what differs from sample to sample: position (m) and rotation (rad) of the
        robot about the fixed frame's axes, as nav_msgs/Odometry has it. None: taken for exact.
    drift : (6, 6) array or None
        Covariance of what is slow: the same for all positions of a while.
    stamp_std : float
        Standard deviation (s) of the time between the clocks of the robot and of the cameras.

    """

    placed: PlacedRig
    sample: Array | None
    drift: Array | None
    stamp_std: float

    def carry(
        self,
        point: Array,
        covariance: Array,
        systematic: Array | None = None,
        medium: Array | None = None,
    ) -> FixedPosition:
        """A position (3,) of the rig frame, with its covariance and the parts of it (3, 3).

        With x = R p + t and the lever r = x - pivot, an error of the robot's pose (dt, dw) moves
        x by dt + dw x r; so its covariance comes in by J = [I, -[r]x].
        """
        pose = self.placed.pose
        rotation = matrix_of(pose.rotation)
        place = rotation @ point + pose.translation
        lever = place - self.placed.pivot
        x, y, z = lever
        jacobian = np.array([[1.0, 0, 0, 0, z, -y], [0, 1.0, 0, -z, 0, x], [0, 0, 1.0, y, -x, 0]])
        whole = rotation @ covariance @ rotation.T
        shared = None if systematic is None else rotation @ systematic @ rotation.T
        if self.sample is not None:
            whole = whole + jacobian @ self.sample @ jacobian.T
        if self.drift is not None:
            part = jacobian @ self.drift @ jacobian.T
            whole = whole + part
            shared = part if shared is None else shared + part
        if self.stamp_std:
            motion = self.placed.velocity + np.cross(
                self.placed.turn, place - np.asarray(pose.translation)
            )
            part = self.stamp_std**2 * np.outer(motion, motion)
            # It swings with the robot: the gain has it, so that what was taken at rest counts for
            # more, and the pose keeps it, as it is no noise that averages away.
            whole = whole + 2 * part
            shared = part if shared is None else shared + part
        swaying = None if medium is None else rotation @ medium @ rotation.T
        return FixedPosition(place, whole, shared, swaying)


def rates(first: Transform, second: Transform, seconds: float) -> tuple[Array, Array]:
    """Velocity (m/s) and rate of turn (rad/s), (3,) each, from one transform to another."""
    velocity = (np.array(second.translation) - first.translation) / seconds
    turn = rotation_vector(product(second.rotation, conjugate(first.rotation)))
    return velocity, np.array(turn) / seconds
