"""A robot that carries the rig about, and its odometry."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.platform.quaternions import (
    Quaternion,
    matrix_of,
    of_rotation_vector,
    product,
    quaternion_of,
)
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.target import Path

Array = NDArray[np.float64]

#: What `rig_motion` knows.
MOTIONS = ('hover', 'line', 'turn')
FIXED_FRAME = 'odom'
ROBOT_FRAME = 'base_link'
#: Of a hovering robot: 7 cm, 5 degrees, 0.1 to 0.5 Hz.
SWAY, TILT, FREQUENCIES = 0.07, np.deg2rad(5.0), (0.1, 0.5)
#: Share of a hovering robot's unrest that is left while it is under way.
UNDER_WAY = 0.25
#: A survey line of 0.8 m to and fro at 0.1 m/s, and a turn by 20 degrees to either side.
LINE, LINE_SPEED = 0.4, 0.1
TURN, TURN_PERIOD = np.deg2rad(20.0), 16.0
#: The left optical frame in the robot's: 20 cm ahead and 6 cm to the left of its origin.
MOUNT = np.array([0.20, 0.06, -0.05])
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
#: Where the robot's mean pose is in the fixed frame: m, and rad about the vertical.
STATION, HEADING = np.array([2.0, -1.0, -3.0]), 0.5
#: Sines that make up the unrest of one axis.
SINES = 2


@dataclasses.dataclass(frozen=True)
class RigMotion:
    """Unrest of a robot about its station, and the way that it goes beside.

    Attributes:
        kind: one of MOTIONS.
        amplitudes: (6, SINES) of position (m) and rotation vector (rad), in the station's axes.
        frequencies: (6, SINES) Hz.
        phases: (6, SINES) rad.
    """

    kind: str
    amplitudes: Array
    frequencies: Array
    phases: Array

    def poses(self, times: ArrayLike) -> tuple[Array, list[Quaternion]]:
        """(N,) s to places (N, 3), m, and rotations of the robot in the fixed frame."""
        times = np.atleast_1d(np.asarray(times, float))
        angles = 2 * np.pi * self.frequencies * times[:, None, None] + self.phases
        unrest = (self.amplitudes * np.sin(angles)).sum(axis=2)
        if self.kind == 'line':
            # A triangle with rounded tips.
            angle = np.pi / 2 * LINE_SPEED / LINE * times
            unrest[:, 1] += LINE * 2 / np.pi * np.arcsin(0.98 * np.sin(angle))
        elif self.kind == 'turn':
            unrest[:, 5] += TURN * np.sin(2 * np.pi * times / TURN_PERIOD)
        station = of_rotation_vector((0.0, 0.0, HEADING))
        turns = [product(station, of_rotation_vector(each)) for each in unrest[:, 3:]]
        return STATION + unrest[:, :3] @ matrix_of(station).T, turns

    def rig_poses(self, times: ArrayLike) -> tuple[Array, Array]:
        """Places (N, 3), m, and rotations (N, 3, 3) of the rig in the fixed frame."""
        places, turns = self.poses(times)
        robots = np.array([matrix_of(turn) for turn in turns])
        return places + robots @ MOUNT, robots @ OPTICAL


def rig_motion(kind: str, rng: np.random.Generator) -> RigMotion:
    """One of the named motions, with unrest of its own.

    Raises:
        SimulationError: no such motion.
    """
    if kind not in MOTIONS:
        msg = f'no motion of a robot is called {kind!r}: choose one of {", ".join(MOTIONS)}'
        raise SimulationError(msg)
    share = 1.0 if kind == 'hover' else UNDER_WAY
    reach = share * np.array([SWAY] * 3 + [TILT] * 3)
    return RigMotion(
        kind,
        np.repeat(reach[:, None] / SINES, SINES, axis=1),
        rng.uniform(*FREQUENCIES, (6, SINES)),
        rng.uniform(0, 2 * np.pi, (6, SINES)),
    )


@dataclasses.dataclass(frozen=True)
class SeenFromRobot:
    """A path as a rig sees it that a robot carries.

    Attributes:
        path: as the rig would see it from the robot's station.
        motion: of the robot.
    """

    path: Path
    motion: RigMotion

    def fixed(self, times: ArrayLike) -> tuple[Array, Array]:
        """(N,) s to (N, 3) positions, m, and (N, 3) unit normals in the fixed frame."""
        station = matrix_of(of_rotation_vector((0.0, 0.0, HEADING)))
        positions, normals = self.path.poses(times)
        turn = station @ OPTICAL
        return STATION + station @ MOUNT + positions @ turn.T, normals @ turn.T

    def poses(self, times: ArrayLike) -> tuple[Array, Array]:
        positions, normals = self.fixed(times)
        places, turns = self.motion.rig_poses(times)
        seen = np.einsum('nji,nj->ni', turns, positions - places)
        return seen, np.einsum('nji,nj->ni', turns, normals)


@dataclasses.dataclass(frozen=True)
class Odometer:
    """What the robot knows of its pose: the truth and white noise, with the right covariance.

    Attributes:
        position_std: along each axis, m.
        rotation_std: about each axis of the fixed frame, rad.
        rate: samples per second.
    """

    position_std: float = 0.002
    rotation_std: float = float(np.deg2rad(0.1))
    rate: float = 50.0

    def __post_init__(self) -> None:
        for name in ('position_std', 'rotation_std'):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                msg = f"the odometry's {name} is {value!r}: give 0 or more"
                raise SimulationError(msg)
        if not (np.isfinite(self.rate) and self.rate > 0):
            msg = f"the odometry's rate is {self.rate!r} Hz: give a value above 0"
            raise SimulationError(msg)

    @property
    def covariance(self) -> Array:
        """(6, 6) of position, m^2, and rotation, rad^2."""
        return np.diag([self.position_std**2] * 3 + [self.rotation_std**2] * 3)

    def samples(
        self, motion: RigMotion, times: Array, rng: np.random.Generator
    ) -> list[tuple[Array, Quaternion]]:
        """Places (3,), m, and rotations of the robot in the fixed frame, as it measures them."""
        places, turns = motion.poses(times)
        noise = rng.normal(0.0, 1.0, (len(times), 6))
        return [
            (
                place + self.position_std * error[:3],
                product(of_rotation_vector(self.rotation_std * error[3:]), turn),
            )
            for place, turn, error in zip(places, turns, noise, strict=True)
        ]


def mounting() -> tuple[float, ...]:
    """The left optical frame in the robot's: x, y, z in m, qx, qy, qz, qw."""
    return (*MOUNT.tolist(), *quaternion_of(OPTICAL))
