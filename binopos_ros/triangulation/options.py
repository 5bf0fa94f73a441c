"""What a user sets for triangulation: the method, the interface, the pairing."""

from __future__ import annotations

from dataclasses import dataclass, field

from binopos_ros.optics import FlatInterface
from binopos_ros.triangulation.errors import TriangulationError

METHODS = ('refractive', 'paper', 'straight')


@dataclass(frozen=True)
class InterfaceOptions:
    """One flat interface: a water surface, a port or a tank's wall. All empty: there is none."""

    normal: tuple[float, ...] = field(
        default=(),
        metadata={
            'description': "unit normal, from the cameras into the target's medium, 3 numbers"
        },
    )
    distance: float = field(
        default=0.0,
        metadata={
            'description': "along the normal, from the camera's centre to the first surface",
            'unit': 'm',
            'range': (0.0, 1000.0),
        },
    )
    indices: tuple[float, ...] = field(
        default=(),
        metadata={
            'description': 'refractive indices, camera side first',
            'unit': '1',
            'range': (1.0, 5.0),
        },
    )
    thicknesses: tuple[float, ...] = field(
        default=(),
        metadata={
            'description': 'thicknesses of the layers between the first and the last medium',
            'unit': 'm',
            'range': (0.0, 100.0),
        },
    )

    def build(self, name: str) -> FlatInterface | None:
        """The interface, or None where nothing was given.

        Raises:
            TriangulationError: the interface is half given.
            OpticsError: its values make no interface.
        """
        if not self.indices and not self.normal:
            return None
        if not self.indices or not self.normal:
            missing = 'indices' if self.normal else 'normal'
            msg = f'{name}.{missing} is missing: give {name}.normal and {name}.indices together'
            raise TriangulationError(msg)
        interface = FlatInterface(self.normal, self.distance, self.indices, self.thicknesses)
        if interface.normal[2] <= 0:
            msg = (
                f'{name}.normal = {list(self.normal)} points behind the camera: it must point '
                "from the cameras into the target's medium, so its z is above 0"
            )
            raise TriangulationError(msg)
        return interface


@dataclass(frozen=True)
class TriangulatorOptions:
    """Options of the triangulation stage."""

    method: str = field(
        default='refractive',
        metadata={
            'description': "refractive: along the bent rays; paper: the paper's; straight: in air",
            'choices': METHODS,
        },
    )
    pair_tolerance: float | None = field(
        default=None,
        metadata={
            'description': 'largest difference between the stamps of a pair; '
            'unset: half of the measured frame period',
            'unit': 's',
            'range': (0.0, 10.0),
        },
    )
    epipolar_gate: float = field(
        default=10.0,
        metadata={
            'description': 'largest distance of an image point from the image of the position '
            'found; above it left and right did not see the same target. 0 switches it off',
            'unit': 'px',
            'range': (0.0, 1000.0),
        },
    )
    interface: InterfaceOptions = field(default_factory=InterfaceOptions)
    left_port: InterfaceOptions = field(default_factory=InterfaceOptions)
    right_port: InterfaceOptions = field(default_factory=InterfaceOptions)

    def __post_init__(self) -> None:
        has_interface = any(self.interfaces())
        if self.method != 'straight' and not has_interface:
            msg = (
                f'method {self.method!r} needs an interface: give interface.normal, '
                'interface.distance and interface.indices (or left_port.* and right_port.*), '
                "or choose method 'straight'"
            )
            raise TriangulationError(msg)

    def interfaces(
        self,
    ) -> tuple[FlatInterface | None, FlatInterface | None, FlatInterface | None]:
        """The shared interface, the left port and the right port.

        Raises:
            TriangulationError, OpticsError: one of them is half given or impossible.
        """
        left = self.left_port.build('left_port')
        right = self.right_port.build('right_port')
        if (left is None) != (right is None):
            msg = 'left_port and right_port go together: give both or neither'
            raise TriangulationError(msg)
        return self.interface.build('interface'), left, right
