"""What a robot that carries the simulated rig publishes: odometry, transforms; and the truth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from binopos_ros.bag import BagWriter, messages
from binopos_ros.bag.qos import Qos
from binopos_ros.bag.results import odometry, pose_with_covariance
from binopos_ros.platform.quaternions import quaternion_of
from binopos_ros.simulation.rig_motion import (
    FIXED_FRAME,
    ROBOT_FRAME,
    Odometer,
    SeenFromRobot,
    mounting,
)

Array = NDArray[np.float64]

#: Seconds of odometry before the first image and after the last.
AROUND = 0.1
TF, TF_STATIC = '/tf', '/tf_static'
LATCHED = Qos(durability='transient_local')


class SimulatedPlatform:
    """Writes the robot's topics in between the images.

    Args:
        writer: of the bag; gets the topics.
        namespace: of the rig's own topics.
        path: of the target as the rig sees it.
        odometer: what the robot knows of its pose.
        stamps: of the images, ns; the first one is at time 0 of the path.
        rng: of the odometry's noise.
    """

    def __init__(
        self,
        writer: BagWriter,
        namespace: str,
        path: SeenFromRobot,
        odometer: Odometer,
        stamps: NDArray[np.int64],
        rng: np.random.Generator,
    ) -> None:
        self._writer = writer
        self._odometry = f'{namespace}/platform/odometry'
        self._truth = f'{namespace}/truth/fixed_pose'
        writer.add_topic(self._odometry, messages.ODOMETRY)
        writer.add_topic(TF, messages.TF)
        writer.add_topic(TF_STATIC, messages.TF, qos=(LATCHED,))
        writer.add_topic(self._truth, messages.POSE_WITH_COVARIANCE)
        self._covariance = odometer.covariance
        self._fixed = path.fixed((stamps - stamps[0]) * 1e-9)[0]
        last = (stamps[-1] - stamps[0]) * 1e-9 + AROUND
        times = np.arange(-AROUND, last + 1 / odometer.rate, 1 / odometer.rate)
        samples = odometer.samples(path.motion, times, rng)
        ticks = stamps[0] + np.rint(times * 1e9).astype(np.int64)
        self._samples: Iterator[tuple[int, tuple[Array, tuple[float, ...]]]] = zip(
            ticks.tolist(), samples, strict=True
        )
        self._next = next(self._samples, None)

    def write_mounting(self, frames: tuple[str, str], rotation: Array, translation: Array) -> None:
        """Write the frames that do not move: the left camera's on the robot, the right one's.

        Args:
            frames: of the left and the right camera.
            rotation, translation: (3, 3) and (3,) m, right_from_left.
        """
        assert self._next is not None
        place = mounting()
        left_from_right = -rotation.T @ translation
        message = messages.transforms(
            self._next[0],
            (ROBOT_FRAME, frames[0], place[:3], place[3:]),
            (frames[0], frames[1], left_from_right, quaternion_of(rotation.T)),
        )
        self._writer.write(TF_STATIC, self._next[0], message)

    def write_until(self, stamp: int | None) -> None:
        """Write the robot's poses up to a stamp (ns); None: those that are left."""
        while self._next is not None and (stamp is None or self._next[0] <= stamp):
            tick, (place, turn) = self._next
            frames = (FIXED_FRAME, ROBOT_FRAME)
            told = odometry(
                tick, frames, place, self._covariance, np.zeros(3), np.zeros((3, 3)), turn
            )
            self._writer.write(self._odometry, tick, told)
            self._writer.write(TF, tick, messages.transforms(tick, (*frames, place, turn)))
            self._next = next(self._samples, None)

    def write_truth(self, number: int, stamp: int) -> None:
        """Write where the target is in the fixed frame in a pair."""
        place = self._fixed[number]
        truth = pose_with_covariance(stamp, FIXED_FRAME, place, np.zeros((3, 3)))
        self._writer.write(self._truth, stamp, truth)
