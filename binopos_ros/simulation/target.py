"""The red disc, and the ways it moves."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.simulation.errors import SimulationError

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Disc:
    """A flat round target.

    Attributes:
        diameter: m.
        colour: reflectance in blue, green, red, each 0 to 1.
    """

    diameter: float = 0.05
    colour: tuple[float, float, float] = (0.10, 0.09, 0.92)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.diameter) and self.diameter > 0):
            msg = f'the disc is {self.diameter!r} m wide: give a diameter above 0'
            raise SimulationError(msg)


class Path(Protocol):
    """Where the target is, and which way it faces, at any time."""

    def poses(self, times: ArrayLike) -> tuple[Array, Array]:
        """(N,) s to (N, 3) positions of the centre in m and (N, 3) unit normals, rig frame."""
        ...


#: What `harmonic_path` knows.
PATHS = ('still', 'line', 'circle', 'figure-eight', 'stop-and-go')


@dataclasses.dataclass(frozen=True)
class HarmonicPath:
    """Swings about a centre: position = centre + sum of axis sin(2 pi f tau(t) + phase).

    The disc's normal nods by `nod` radians about the first axis and the second in turn.

    Attributes:
        centre: (3,) m, rig frame.
        normal: (3,) unit, the disc's mean normal, pointing to the cameras.
        axes: (K, 3) amplitudes, m; none for a still target.
        frequencies: (K,) Hz.
        phases: (K,) rad.
        nod: amplitude of the normal's swing, rad.
        pause: share of each period, 0 to 1, in which the target rests.
    """

    centre: Array
    normal: Array
    axes: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 3)))
    frequencies: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    phases: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    nod: float = 0.0
    pause: float = 0.0

    def poses(self, times: ArrayLike) -> tuple[Array, Array]:
        times = np.atleast_1d(np.asarray(times, float))
        positions = np.repeat(self.centre[None, :], len(times), axis=0)
        tilt = np.zeros((len(times), 3))
        for axis, frequency, phase in zip(self.axes, self.frequencies, self.phases, strict=True):
            turns = frequency * times
            if self.pause:
                # Each half turn starts with a rest, then runs smoothly to catch up.
                whole = np.floor(2 * turns)
                moving = np.clip((2 * turns - whole - self.pause) / (1 - self.pause), 0, 1)
                turns = 0.5 * (whole + moving**2 * (3 - 2 * moving))
            swing = np.sin(2 * np.pi * turns + phase)
            positions += swing[:, None] * axis
            length = np.sqrt(axis @ axis)
            tilt += np.tan(self.nod) * swing[:, None] * axis / length if length else 0.0
        normals = self.normal + tilt
        return positions, normals / np.linalg.norm(normals, axis=1)[:, None]


@dataclasses.dataclass(frozen=True)
class SwungPath:
    """A path as a rig sees it that swings to and fro about its vertical axis, y.

    Attributes:
        path: as the rig would see it at rest.
        amplitude: rad.
        period: s.
    """

    path: Path
    amplitude: float
    period: float

    def __post_init__(self) -> None:
        if not (0 < abs(self.amplitude) < np.pi / 4 and np.isfinite(self.amplitude)):
            msg = (
                f'the rig swings by {np.degrees(self.amplitude):g} degrees: give a value between '
                '0 and 45'
            )
            raise SimulationError(msg)
        if not (np.isfinite(self.period) and self.period > 0):
            msg = f'the rig swings once in {self.period!r} s: give a value above 0'
            raise SimulationError(msg)

    def poses(self, times: ArrayLike) -> tuple[Array, Array]:
        times = np.atleast_1d(np.asarray(times, float))
        angle = self.amplitude * np.sin(2 * np.pi * times / self.period)
        turn = np.zeros((len(times), 3, 3))
        turn[:, 1, 1] = 1.0
        turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
        turn[:, 0, 2], turn[:, 2, 0] = -np.sin(angle), np.sin(angle)
        positions, normals = self.path.poses(times)
        seen = (np.einsum('nij,nj->ni', turn, each) for each in (positions, normals))
        return next(seen), next(seen)


def harmonic_path(
    kind: str, centre: Array, normal: Array, axes: Array, period: float, nod: float = 0.0
) -> HarmonicPath:
    """One of the named paths about a centre.

    Args:
        kind: one of PATHS.
        centre: (3,) m.
        normal: (3,) unit, of the disc.
        axes: (2, 3) half the extent of the motion in two directions, m.
        period: of one round, s.
        nod: swing of the disc's normal, rad.

    Raises:
        SimulationError: no such path, or a period of zero.
    """
    if kind not in PATHS:
        msg = f'no path is called {kind!r}: choose one of {", ".join(PATHS)}'
        raise SimulationError(msg)
    if not (np.isfinite(period) and period > 0):
        msg = f'the period of the path is {period!r} s: give a value above 0'
        raise SimulationError(msg)
    if kind == 'still':
        return HarmonicPath(centre, normal)
    base = 1 / period
    if kind in ('line', 'stop-and-go'):
        pause = 0.5 if kind == 'stop-and-go' else 0.0
        return HarmonicPath(
            centre, normal, axes[:1], np.array([base]), np.array([-np.pi / 2]), nod, pause
        )
    ratio = 1 if kind == 'circle' else 2
    phases = np.array([np.pi / 2, 0.0]) if kind == 'circle' else np.zeros(2)
    return HarmonicPath(centre, normal, axes, np.array([base, ratio * base]), phases, nod)
