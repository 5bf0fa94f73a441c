"""What a user sets of what the cameras look through: a shared interface, or a port for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from binopos_ros.optics import DomePort, FlatInterface
from binopos_ros.optics.interface import Interface
from binopos_ros.parameters import UnfinishedError, option
from binopos_ros.triangulation.errors import TriangulationError

FLAT, DOME = 'flat', 'dome'

UNSTATED = -1.0
#: What a protractor and a ruler do.
USUAL_NORMAL, USUAL_DISTANCE, USUAL_CENTRE = 0.0175, 0.005, 0.002  # rad, m, m


class Deviation(NamedTuple):
    """A standard deviation, and whether the rig's owner has stated it."""

    value: float
    stated: bool

    @classmethod
    def of(cls, option: float, usual: float) -> Deviation:
        """What an option says; the usual deviation where it says nothing."""
        return cls(option, True) if option >= 0.0 else cls(usual, False)


class HalfGivenError(TriangulationError, UnfinishedError):
    """An interface of which a part is missing: a running node waits for the rest."""


@dataclass(frozen=True)
class InterfaceOptions:
    """One flat interface: a water surface, a port or a tank's wall. All empty: there is none."""

    normal: tuple[float, ...] = option(
        (), "unit normal, from the cameras into the target's medium, 3 numbers"
    )
    distance: float = option(
        0.0, "along the normal, from the camera's centre to the first surface", 'm', (0.0, 1000.0)
    )
    indices: tuple[float, ...] = option(
        (), 'refractive indices, camera side first', '1', (1.0, 4.0)
    )
    thicknesses: tuple[float, ...] = option(
        (), 'of the layers between the first and the last medium', 'm', (0.0, 100.0)
    )
    normal_std: float = option(
        UNSTATED,
        'standard deviation of the normal about either axis, where calibration_covariance does '
        'not tell it; 0: exact; below 0: not stated, then 0.0175',
        'rad',
        (UNSTATED, 0.5),
    )
    distance_std: float = option(
        UNSTATED,
        'standard deviation of the distance, where calibration_covariance does not tell it; '
        '0: exact; below 0: not stated, then 0.005',
        'm',
        (UNSTATED, 1.0),
    )

    @property
    def deviations(self) -> dict[str, Deviation]:
        """By option, the standard deviations that hold for what is given."""
        return {
            'normal_std': Deviation.of(self.normal_std, USUAL_NORMAL),
            'distance_std': Deviation.of(self.distance_std, USUAL_DISTANCE),
        }

    def build(self, name: str) -> Interface | None:
        """The interface, or None where nothing was given.

        Raises:
            HalfGivenError: the interface is half given.
            TriangulationError, OpticsError: its values make no interface.
        """
        if not self.indices and not self.normal:
            return None
        if not self.indices or not self.normal:
            missing = 'indices' if self.normal else 'normal'
            msg = f'{name}.{missing} is missing: give {name}.normal and {name}.indices together'
            raise HalfGivenError(msg)
        if len(self.thicknesses) != len(self.indices) - 2 and len(self.indices) > 1:
            msg = (
                f'{name}.indices has {len(self.indices)} media and {name}.thicknesses '
                f'{len(self.thicknesses)} layers between them: give two more indices than '
                'thicknesses'
            )
            raise HalfGivenError(msg)
        interface = FlatInterface(self.normal, self.distance, self.indices, self.thicknesses)
        if interface.normal[2] <= 0:
            msg = (
                f'{name}.normal = {list(self.normal)} points behind the camera: it must point '
                "from the cameras into the target's medium, so its z is above 0"
            )
            raise TriangulationError(msg)
        return interface


@dataclass(frozen=True)
class PortOptions(InterfaceOptions):
    """One camera's port, a flat pane or a dome. All empty: there is none."""

    shape: str = option(
        FLAT,
        'flat: a pane, given by normal and distance; dome: two concentric spheres around the '
        'camera, given by centre and radius',
        choices=(FLAT, DOME),
    )
    centre: tuple[float, ...] = option(
        (), "centre of a dome's spheres in the camera's frame, 3 numbers", 'm'
    )
    radius: float = option(0.0, "of a dome's inner sphere", 'm', (0.0, 10.0))
    centre_std: float = option(
        UNSTATED,
        "standard deviation of a dome's centre along each axis, where calibration_covariance does "
        'not tell it; 0: exact; below 0: not stated, then 0.002',
        'm',
        (UNSTATED, 1.0),
    )

    @property
    def deviations(self) -> dict[str, Deviation]:
        """By option, the standard deviations that hold for what is given."""
        if self.shape != DOME:
            return super().deviations
        return {'centre_std': Deviation.of(self.centre_std, USUAL_CENTRE)}

    def build(self, name: str) -> Interface | None:
        """The port, or None where nothing was given.

        Raises:
            HalfGivenError: the port is half given, or parts of both shapes are.
            TriangulationError, OpticsError: its values make no port.
        """
        return self._dome(name) if self.shape == DOME else self._pane(name)

    def _pane(self, name: str) -> Interface | None:
        if self.centre or self.radius:
            given = 'centre' if self.centre else 'radius'
            msg = f'{name}.{given} belongs to a dome: set {name}.shape to {DOME}'
            raise HalfGivenError(msg)
        return super().build(name)

    def _dome(self, name: str) -> DomePort:
        if self.normal or self.distance:
            given = 'normal' if self.normal else 'distance'
            msg = (
                f'{name}.{given} belongs to a flat port: leave it out, a dome has {name}.centre '
                f'and {name}.radius'
            )
            raise HalfGivenError(msg)
        if len(self.centre) != 3 or not self.radius:
            missing = 'radius' if len(self.centre) == 3 else 'centre'
            msg = (
                f'{name}.{missing} is missing: a dome needs {name}.centre (three numbers, m, in '
                f"the camera's frame) and {name}.radius (m)"
            )
            raise HalfGivenError(msg)
        if len(self.thicknesses) != 1 or len(self.indices) != 3:
            msg = (
                f'{name}.indices has {len(self.indices)} media and {name}.thicknesses '
                f'{len(self.thicknesses)} layers: a dome needs three indices (inside it, its '
                'wall, beyond) and one thickness'
            )
            raise HalfGivenError(msg)
        return DomePort(self.centre, self.radius, self.thicknesses[0], self.indices)
