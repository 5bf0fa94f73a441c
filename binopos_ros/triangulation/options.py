"""What a user sets for triangulation: the method, the interface, the pairing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import FlatInterface, OpticsError
from binopos_ros.optics.disc import unit_vector
from binopos_ros.optics.interface import Interface
from binopos_ros.parameters import check_options, option
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.index import IndexEstimator
from binopos_ros.triangulation.medium import may_wave
from binopos_ros.triangulation.seawater import index_prior
from binopos_ros.triangulation.surface_options import (
    UNSTATED,
    Deviation,
    HalfGivenError,
    InterfaceOptions,
    PortOptions,
)

USUAL_BASELINE = 0.005  # of the baseline, by a printed board's scale
METHODS = ('refractive', 'paper', 'straight')


@dataclass(frozen=True)
class IndexOptions:
    """What is known beforehand of the refractive index of the target's medium."""

    prior: str = option(
        'given',
        "given: the last of the interface's indices, with index.std; "
        'water: computed from temperature, salinity, wavelength and depth',
        choices=('given', 'water'),
    )
    std: float = option(
        0.0,
        'standard deviation of the given index. Above 0 the index is followed live; '
        '0: it is taken for exact',
        '1',
        (0.0, 0.5),
    )
    drift: float = option(
        0.0, 'standard deviation of the change of the index in a second', '1/sqrt(s)', (0.0, 0.1)
    )
    temperature: float = option(20.0, 'temperature of the water', 'C', (0.0, 30.0))
    temperature_std: float = option(1.0, 'standard deviation of the temperature', 'C', (0.0, 30.0))
    salinity: float = option(0.0, 'salinity of the water', 'g/kg', (0.0, 43.0))
    salinity_std: float = option(0.5, 'standard deviation of the salinity', 'g/kg', (0.0, 43.0))
    wavelength: float = option(620.0, "wavelength of the target's light", 'nm', (500.0, 700.0))
    wavelength_std: float = option(
        15.0, 'standard deviation of the wavelength', 'nm', (0.0, 150.0)
    )
    depth: float = option(0.0, 'depth of the target under the sea surface', 'm', (0.0, 11000.0))
    calibration_std: float = option(
        0.1,
        'what the calibration leaves of systematic error in the pixels: the epipolar residual of '
        'held-out views. It bounds how well the index can ever be known',
        'px',
        (0.0, 10.0),
    )
    target_depth: float = option(
        0.0, 'depth of the target beyond the last surface; 0: not known', 'm', (0.0, 100.0)
    )
    target_depth_std: float = option(0.001, 'standard deviation of that depth', 'm', (1e-6, 10.0))

    @property
    def is_estimated(self) -> bool:
        """Whether the index is followed live."""
        return self.prior == 'water' or self.std > 0

    def estimator(
        self,
        interface: FlatInterface | None,
        index: float,
        covariance: NDArray[np.float64] | None,
        epipolar_gate: float,
    ) -> IndexEstimator | None:
        """The live estimate of the index, or None where the given one is taken for exact.

        Raises:
            TriangulationError: conditions outside the formula, or an impossible known depth.
        """
        if not self.is_estimated:
            return None
        mean, std = index, self.std
        if self.prior == 'water':
            computed = index_prior(
                self.temperature,
                self.salinity,
                self.wavelength,
                self.depth,
                temperature_std=self.temperature_std,
                salinity_std=self.salinity_std,
                wavelength_std_nm=self.wavelength_std,
            )
            mean, std = computed.mean, computed.std
        plane = None
        if self.target_depth > 0:
            if interface is None:
                msg = 'index.target_depth needs a shared interface: give interface.*'
                raise TriangulationError(msg)
            plane = KnownPlane.at_depth(interface, self.target_depth, self.target_depth_std)
        return IndexEstimator(
            mean,
            std,
            drift=self.drift,
            known_plane=plane,
            parameter_covariance=covariance,
            calibration_std=self.calibration_std,
            epipolar_gate=epipolar_gate,
        )


@dataclass(frozen=True)
class DiscOptions:
    """The target as a disc or a ball. Raises TriangulationError where a value is of no use."""

    shape: str = option(
        'any',
        'How the centre of its outline is brought to its own. Ball: by the lines of sight that '
        'touch it; disc, any: as that of a disc',
        choices=('any', 'disc', 'ball'),
    )
    diameter: float = option(
        0.0,
        'Diameter of the target; above 0, the image of its centre is used instead of the '
        "outline's centre",
        'm',
        (0.0, 10.0),
    )
    normal: tuple[float, ...] = option(
        (),
        'Normal of the disc in the rig frame; left out: that of the interface, as for a disc on '
        'the floor under a water surface',
    )

    def __post_init__(self) -> None:
        check_options(self, TriangulationError)
        if self.normal:
            try:
                unit_vector(np.array(self.normal, float))
            except OpticsError as error:
                raise TriangulationError(str(error)) from None


@dataclass(frozen=True)
class LocatorOptions:
    """Options of what triangulates a pair, whatever its rig."""

    method: str = option(
        'refractive',
        "refractive: along the bent rays; paper: the paper's; straight: in air",
        choices=METHODS,
    )
    epipolar_gate: float = option(
        10.0,
        'largest distance of an image point from the image of the position found; above it left '
        'and right did not see the same target. 0 switches it off',
        'px',
        (0.0, 1000.0),
    )
    medium: str = option(
        'auto',
        'auto: under a free surface the miss of the two rays tells how it waves, and the '
        'covariance says so, as of slow bobbing, which may be swell; basin: there is no room for '
        'swell; still: nothing waves',
        choices=('auto', 'basin', 'still'),
    )
    index: IndexOptions = field(default_factory=IndexOptions)
    target: DiscOptions = field(default_factory=DiscOptions)

    def __post_init__(self) -> None:
        if self.method != 'refractive' and self.index.is_estimated:
            msg = (
                f'method {self.method!r} cannot follow the index: '
                "set index.std to 0 and index.prior to 'given'"
            )
            raise TriangulationError(msg)

    @property
    def watches_medium(self) -> bool:
        """Whether the miss of the two rays is asked how the medium waves."""
        return self.medium != 'still' and self.method == 'refractive'

    def estimator(
        self,
        interface: FlatInterface | None,
        index: float | None,
        covariance: NDArray[np.float64] | None = None,
    ) -> IndexEstimator | None:
        """The live estimate of the index, or None where the given one is taken for exact.

        Args:
            interface: that both cameras look through, if any.
            index: of the target's medium; None where the cameras look through nothing.
            covariance: (K, K) of the rig's parameters, in its own order.

        Raises:
            TriangulationError: conditions outside the formula, or an impossible known depth.
        """
        if index is None:
            return None
        return self.index.estimator(interface, index, covariance, self.epipolar_gate)


@dataclass(frozen=True)
class TriangulatorOptions(LocatorOptions):
    """Options of the triangulation stage."""

    pair_tolerance: float = option(
        0.0,
        'largest difference between the stamps of a pair; 0 takes half of the frame period',
        's',
        (0.0, 10.0),
    )
    triggered: bool = option(
        False,
        'the cameras are exposed together by hardware: where the stamps of a pair differ it is '
        'their jitter. False: the right centroid is brought along its path to the left stamp',
    )
    calibration_covariance: str = option(
        '',
        'covariance.yaml of `binopos calibrate interface`: the covariance of the position then '
        "holds the calibration's own uncertainty, cameras and interface together; empty: that of "
        'normal_std, distance_std and baseline_std',
    )
    baseline_std: float = option(
        UNSTATED,
        'standard deviation of the baseline as a share of it, where calibration_covariance does '
        'not tell it; 0: exact; below 0: not stated, then 0.005',
        '1',
        (UNSTATED, 0.5),
    )
    interface: InterfaceOptions = field(default_factory=InterfaceOptions)
    left_port: PortOptions = field(default_factory=PortOptions)
    right_port: PortOptions = field(default_factory=PortOptions)

    def __post_init__(self) -> None:
        super().__post_init__()
        has_interface = any(self.interfaces())
        if self.method != 'straight' and not has_interface:
            msg = (
                f'method {self.method!r} needs an interface: give interface.normal, '
                'interface.distance and interface.indices (or left_port.* and right_port.*), '
                "or choose method 'straight'"
            )
            raise TriangulationError(msg)

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts that a covariance has beside its noise: 'systematic', 'medium'."""
        waves = may_wave(self.interfaces()[0]) and self.watches_medium
        if waves:
            return 'systematic', 'medium'
        return ('systematic',) if self.is_uncertain or self.index.is_estimated else ()

    @property
    def is_uncertain(self) -> bool:
        """Whether the rig's own uncertainty is carried on to the positions."""
        if self.method != 'refractive':
            return False
        own = (std for place in self.places.values() for std in place.deviations.values())
        return bool(self.calibration_covariance) or any(
            std.value > 0 for std in (self.baseline_deviation, *own)
        )

    @property
    def baseline_deviation(self) -> Deviation:
        """Of the baseline, as a share of it."""
        return Deviation.of(self.baseline_std, USUAL_BASELINE)

    @property
    def places(self) -> dict[str, InterfaceOptions]:
        """The interfaces that are given, by the names that their parameters begin with."""
        all_places = {
            'interface': self.interface,
            'left_port': self.left_port,
            'right_port': self.right_port,
        }
        return {name: place for name, place in all_places.items() if place.build(name)}

    def interfaces(
        self,
    ) -> tuple[FlatInterface | None, Interface | None, Interface | None]:
        """The shared interface, the left port and the right port.

        Raises:
            UnfinishedError: one of them is half given.
            TriangulationError, OpticsError: one of them is impossible.
        """
        left = self.left_port.build('left_port')
        right = self.right_port.build('right_port')
        if (left is None) != (right is None):
            msg = 'left_port and right_port go together: give both or neither'
            raise HalfGivenError(msg)
        shared = self.interface.build('interface')
        assert shared is None or isinstance(shared, FlatInterface)
        return shared, left, right
