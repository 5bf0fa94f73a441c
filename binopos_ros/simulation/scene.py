"""A scene: the rig, the water, the target and its way, and what the sensor adds."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.simulation.backdrop import Backdrop
from binopos_ros.simulation.boards import ShownBoard
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.medium import Rays, plane_axes
from binopos_ros.simulation.rig_motion import Odometer
from binopos_ros.simulation.sensor import Sensor
from binopos_ros.simulation.target import Disc, Path
from binopos_ros.simulation.view import View, views_of
from binopos_ros.simulation.water import Water
from binopos_ros.simulation.waves import WaveField

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Scene:
    """Everything that a picture depends on but the seed of its noise.

    Attributes:
        rig: the two cameras and what they look through, as numbers; its projection is never used.
        water: what the target's medium does to colours.
        backdrop: what lies behind the target.
        path, target: where it is, and what.
        sensor: of both cameras.
        waves: on the rig's shared surface; None where it is calm.
        rate: pairs per second.
        odometer: of the robot that carries the rig, where the path is one seen from a robot.
    """

    rig: StereoRig
    water: Water
    backdrop: Backdrop
    path: Path
    target: Disc | ShownBoard = dataclasses.field(default_factory=Disc)
    sensor: Sensor = dataclasses.field(default_factory=Sensor)
    waves: WaveField | None = None
    rate: float = 30.0
    odometer: Odometer = dataclasses.field(default_factory=Odometer)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0):
            msg = f'the rate is {self.rate!r} pairs per second: give a value above 0'
            raise SimulationError(msg)

    @functools.cached_property
    def views(self) -> tuple[View, View]:
        """The left and the right camera."""
        return views_of(self.rig, self.waves)

    def times(self, pairs: int) -> Array:
        """(N,) s since the start at which pairs are taken."""
        return np.arange(pairs) / self.rate

    def target_rotations(self, times: ArrayLike) -> Array:
        """(N, 3, 3) rig_from_target: z is the disc's normal, or points into the board."""
        times = np.atleast_1d(np.asarray(times, float))
        if isinstance(self.target, ShownBoard):
            return self.target.rotations[[self.target.number(float(time)) for time in times]]
        normals = self.path.poses(times)[1]
        return np.array([np.column_stack([*plane_axes(normal), normal]) for normal in normals])

    def measurements(
        self, times: ArrayLike, points: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Where the target's centre appears, without rendering: exact, free of noise.

        Args:
            times: (N,) s.
            points: (N, 3) m, rig frame; the path's own positions where left out.

        Returns:
            (N, 2) px in the left and in the right image; nan where no light comes through.
        """
        times = np.atleast_1d(np.asarray(times, float))
        places = self.path.poses(times)[0] if points is None else np.asarray(points, float)
        left, right = self.views
        return left.apparent(places, times), right.apparent(places, times)

    def through_water(
        self, rays: Rays, steps: Array, chosen: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Factor and veil, each (N, 3), on what chosen rays show after so many metres."""
        points = rays.origins[chosen] + steps[chosen, None] * rays.directions[chosen]
        lengths = rays.lengths[chosen] + steps[chosen]
        return self.water.transmission(lengths, self.backdrop.light_lengths(points, lengths))
