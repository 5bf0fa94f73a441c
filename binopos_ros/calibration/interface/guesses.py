"""What is known of the interfaces beforehand, and how it enters the adjustment as a prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Prior
from binopos_ros.calibration.adjustment.known import information_of
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.optics import DomePort, FlatInterface
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.rig_state import LEFT_PORT, RIGHT_PORT, SHARED, TARGET_INDEX, RigState

#: Where nothing was measured: standard deviations so wide that the pictures decide.
UNKNOWN_NORMAL = 0.5  # rad
UNKNOWN_DISTANCE = 10.0  # m
UNKNOWN_CENTRE, UNKNOWN_RADIUS = 0.02, 0.001  # m
UNKNOWN_INDEX = 0.1
#: A ball shows the index so little that its outline's ellipse outweighs it: then it is taken for
#: that of water, fresh or salt, unless it was measured.
ASSUMED_INDEX = 0.01
UNKNOWN_LAYER = 0.01  # the index of glass or acrylic whose kind is known
#: Gases lie below it, and nothing else: such a medium is known and no parameter.
GAS = 1.001
#: A plate, with one medium on both sides, shifts the rays alike wherever it stands, and so has a
#: port before a shared surface. So it needs a place beforehand: a housing's, before its camera.
PORT_DISTANCE, PORT_DISTANCE_DEVIATION = 0.03, 0.03  # m
PORT_TILT = 0.1  # rad


@dataclass(frozen=True)
class Guess:
    """What is known of an interface beforehand, whatever its shape.

    Attributes:
        place: 'interface' (shared, rig frame), 'left_port' or 'right_port' (own camera's frame).
        indices: of the media, camera side first; the first is exact.
        thicknesses: of the layers in between (m).
        deviations: standard deviations of what was measured: 'target_index', the keys of the shape
            (`OWN`), and of the layers in between 'thicknesses.0' (m), 'indices.1' and so on. What
            is not named takes that of `OWN`, a layer's own 1 % and `UNKNOWN_LAYER`.
    """

    place: str
    indices: tuple[float, ...]
    thicknesses: tuple[float, ...] = ()
    deviations: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    #: What the shape alone has, and its deviation where nothing was measured.
    OWN: ClassVar[Mapping[str, float]] = {}

    def __post_init__(self) -> None:
        if self.place not in (SHARED, LEFT_PORT, RIGHT_PORT):
            raise CalibrationError(
                f"place {self.place!r}: '{SHARED}', '{LEFT_PORT}' or '{RIGHT_PORT}'"
            )
        known = {*self.OWN, TARGET_INDEX}
        known |= {f'indices.{i}' for i in range(1, len(self.indices) - 1)}
        known |= {f'thicknesses.{i}' for i in range(len(self.thicknesses))}
        for name, deviation in self.deviations.items():
            if name not in known:
                raise CalibrationError(
                    f'{self.place} has no {name!r}: choose from {", ".join(sorted(known))}'
                )
            if not deviation > 0:
                raise CalibrationError(
                    f'{self.place}.{name}: standard deviation {deviation:g}: it must be above 0'
                )

    @property
    def is_plate(self) -> bool:
        """Whether the same medium lies on both sides, so that the distance makes no difference."""
        return self.indices[0] == self.indices[-1] and TARGET_INDEX not in self.deviations

    @property
    def estimates_index(self) -> bool:
        """Whether the last medium's index is to be found: a gas is known, and so are the cameras'
        surroundings, unless a measurement says otherwise."""
        known = self.indices[-1] < GAS or self.indices[-1] == self.indices[0]
        return TARGET_INDEX in self.deviations or not known

    def deviation(self, name: str) -> float:
        """The prior's standard deviation of one of this interface's parameters."""
        kind, _, number = name.partition('.')
        if kind in self.OWN:
            return self.deviations.get(kind, self.OWN[kind])
        if name in self.deviations:
            return self.deviations[name]
        if name == TARGET_INDEX:
            return UNKNOWN_INDEX
        return 0.01 * self.thicknesses[int(number)] if kind == 'thicknesses' else UNKNOWN_LAYER

    def weighs(self, name: str) -> bool:
        """Whether what is known of one of its parameters counts in the adjustment."""
        return True

    def start(self, reach: float) -> Interface:
        """The interface from which a descent begins; `reach` (m) guesses an unknown distance."""
        raise NotImplementedError

    def by_hand(self) -> Interface:
        """The interface as measured, without pictures.

        Raises:
            CalibrationError: what matters most was not measured.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class InterfaceGuess(Guess):
    """What is known of a flat interface.

    Attributes:
        distance: to the first surface (m), None where unknown.
        normal: from the cameras into the target's medium. Deviations: 'normal' (rad), 'distance'
            (m).
    """

    distance: float | None = None
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    OWN = {'normal': UNKNOWN_NORMAL, 'distance': UNKNOWN_DISTANCE}  # noqa: RUF012

    def weighs(self, name: str) -> bool:
        """A distance that was not measured does not."""
        return name != 'distance' or self.distance is not None

    def start(self, reach: float) -> FlatInterface:
        """The interface at this guess."""
        distance = reach if self.distance is None else self.distance
        return FlatInterface(self.normal, distance, self.indices, self.thicknesses)

    def by_hand(self) -> FlatInterface:
        """The interface as measured.

        Raises:
            CalibrationError: without a distance.
        """
        if self.distance is None:
            raise CalibrationError(
                f"without pictures the {self.place}'s distance must be measured by hand: "
                '--prior distance=0.80,0.005 (value and standard deviation in metres)'
            )
        return self.start(self.distance)


@dataclass(frozen=True)
class DomeGuess(Guess):
    """What is known of a dome.

    Attributes:
        radius: of the inner sphere (m).
        centre: in the camera's frame (m). Deviations: 'radius', 'centre' (m, in each direction).
    """

    radius: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    OWN = {'centre': UNKNOWN_CENTRE, 'radius': UNKNOWN_RADIUS}  # noqa: RUF012

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.place == SHARED:
            raise CalibrationError('a dome belongs to one camera: give --ports with --shape dome')
        if len(self.indices) != 3 or len(self.thicknesses) != 1:
            raise CalibrationError(
                f'{self.place}: a dome needs three indices (inside it, its wall, beyond) and one '
                f'thickness, not {len(self.indices)} and {len(self.thicknesses)}: '
                '--indices 1.0,1.49,1.333 --thicknesses 0.005'
            )
        if not self.radius > 0.0:
            raise CalibrationError(
                f"{self.place}: the dome's inner radius is missing: --radius 0.050 (metres)"
            )

    def start(self, reach: float) -> DomePort:
        """The dome at this guess."""
        return DomePort(self.centre, self.radius, self.thicknesses[0], self.indices)

    def by_hand(self) -> DomePort:
        """The dome as measured.

        Raises:
            CalibrationError: without a centre.
        """
        if 'centre' not in self.deviations:
            raise CalibrationError(
                f"without pictures the {self.place}'s centre must be measured by hand: "
                "--prior centre=0,0,0.003,0.0005 (in the camera's frame, and the standard "
                'deviation, in metres)'
            )
        return self.start(0.0)


def check_places(guesses: Sequence[Guess]) -> None:
    places = sorted(guess.place for guess in guesses)
    ports = [LEFT_PORT, RIGHT_PORT]
    of_rig = [[SHARED], ports, [SHARED, *ports]]
    of_one = [own + shared for own in ([LEFT_PORT], [RIGHT_PORT]) for shared in ([], [SHARED])]
    if places not in of_rig + [sorted(one) for one in of_one]:
        raise CalibrationError(
            f'interfaces {places}: give one shared surface, or a port for each camera, or both'
        )
    shared, before = _parted(guesses)
    if len({guess.indices[-1] for guess in shared or before}) > 1:
        raise CalibrationError(
            'the ports end in different media: both look at one target, give one last index'
        )
    for guess in before if shared else ():
        if guess.indices[-1] != shared[0].indices[0]:
            raise CalibrationError(
                f'{guess.place} ends in a medium of index {guess.indices[-1]:g}, the surface '
                f'behind it begins in one of {shared[0].indices[0]:g}: it is the same medium'
            )


def _parted(
    guesses: Sequence[Guess],
) -> tuple[list[Guess], list[Guess]]:
    """The shared surface, and the ports."""
    shared = [guess for guess in guesses if guess.place == SHARED]
    return shared, [guess for guess in guesses if guess.place != SHARED]


def with_known_plates(guesses: Sequence[Guess]) -> list[Guess]:
    """Plates, and ports before a shared surface, with a rough place where none was measured."""
    shared, ports = _parted(guesses)
    known: list[Guess] = []
    for guess in (*shared, *ports):
        before_surface = bool(shared) and guess.place != SHARED
        if isinstance(guess, InterfaceGuess) and (guess.is_plate or before_surface):
            known.append(_placed(guess, before_surface))
        else:
            known.append(guess)
    return known


def _placed(guess: InterfaceGuess, facing: bool) -> InterfaceGuess:
    """A flat interface with a place, and where it is a port with a tilt, if none was measured."""
    rough = {'normal': PORT_TILT} if facing else {}
    if guess.distance is not None:
        return replace(guess, deviations={**rough, **guess.deviations})
    rough['distance'] = PORT_DISTANCE_DEVIATION
    return replace(guess, distance=PORT_DISTANCE, deviations={**rough, **guess.deviations})


def with_assumed_index(guesses: Sequence[Guess]) -> list[Guess]:
    """Guesses for views of a ball: an index that was not measured is that given, nearly."""
    return [
        replace(guess, deviations={TARGET_INDEX: ASSUMED_INDEX, **guess.deviations})
        if guess.estimates_index
        else guess
        for guess in guesses
    ]


def unknowns(
    start: RigState,
    guesses: Sequence[Guess],
    air_covariance: ParameterCovariance | None,
    free_cameras: bool,
) -> tuple[np.ndarray, Prior]:
    """Which parameters are free, and what is known of them."""
    names = start.names
    prior = prior_deviations(start, guesses)
    own = np.array([name in prior for name in names])
    free = own.copy()
    information = np.zeros((len(names), len(names)))
    if free_cameras:
        free |= [name != TARGET_INDEX for name in names]
    elif air_covariance is not None:
        cameras = [name if not mine else '' for name, mine in zip(names, own, strict=True)]
        uncertain, information = information_of(air_covariance, cameras)
        free |= uncertain
    of_place = {guess.place: guess for guess in guesses}
    for i, name in enumerate(names):
        place, _, parameter = name.partition('.')
        if name in prior and (place not in of_place or of_place[place].weighs(parameter)):
            information[i, i] = prior[name] ** -2
    return free, Prior(start, information)


def prior_deviations(state: RigState, guesses: Sequence[Guess]) -> dict[str, float]:
    """Standard deviations beforehand, by name, of the interfaces' unknowns."""
    last = [guess for guess in guesses if guess.place in state.last_places]
    deviations = {}
    if any(guess.estimates_index for guess in last):
        deviations[TARGET_INDEX] = min(guess.deviation(TARGET_INDEX) for guess in last)
    for guess in guesses:
        for name in state.names_of(guess.place):
            deviations[name] = guess.deviation(name.partition('.')[2])
    return deviations
