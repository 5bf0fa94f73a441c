"""What is known of the interfaces beforehand, and how it enters the adjustment as a prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Prior
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.optics import FlatInterface
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import LEFT_PORT, RIGHT_PORT, SHARED, TARGET_INDEX, RigState

#: Where nothing was measured: standard deviations so wide that the pictures decide.
UNKNOWN_NORMAL = 0.5  # rad
UNKNOWN_DISTANCE = 10.0  # m
UNKNOWN_INDEX = 0.1
#: A ball shows the index so little that its outline's ellipse outweighs it: then it is taken for
#: that of water, fresh or salt, unless it was measured.
ASSUMED_INDEX = 0.01
UNKNOWN_LAYER = 0.01  # the index of glass or acrylic whose kind is known
#: A port with a shared surface behind it has air, or the same water, on both sides, and then where
#: it stands makes no difference. So it needs a place beforehand: a housing's, before its camera.
PORT_DISTANCE, PORT_DISTANCE_DEVIATION = 0.03, 0.03  # m
PORT_TILT = 0.1  # rad


@dataclass(frozen=True)
class InterfaceGuess:
    """What is known of an interface beforehand.

    Attributes:
        place: 'interface' (shared, rig frame), 'left_port' or 'right_port' (own camera's frame).
        indices: of the media, camera side first; the first is exact.
        thicknesses: of the layers in between (m).
        distance: to the first surface (m), None where unknown.
        normal: from the cameras into the target's medium.
        deviations: standard deviations of what was measured: keys 'normal' (rad), 'distance' (m),
            'target_index', and of the layers in between 'thicknesses.0' (m), 'indices.1' and so
            on. What is not named takes `UNKNOWN_*`, a layer's own 1 % and `UNKNOWN_LAYER`.
    """

    place: str
    indices: tuple[float, ...]
    thicknesses: tuple[float, ...] = ()
    distance: float | None = None
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    deviations: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.place not in (SHARED, LEFT_PORT, RIGHT_PORT):
            raise CalibrationError(
                f"place {self.place!r}: '{SHARED}', '{LEFT_PORT}' or '{RIGHT_PORT}'"
            )
        known = {'normal', 'distance', TARGET_INDEX}
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

    def interface(self, distance: float) -> FlatInterface:
        """The interface at this guess."""
        return FlatInterface(self.normal, distance, self.indices, self.thicknesses)

    def deviation(self, name: str) -> float:
        """The prior's standard deviation of one of this interface's parameters."""
        if name.startswith('normal'):
            return self.deviations.get('normal', UNKNOWN_NORMAL)
        if name in self.deviations:
            return self.deviations[name]
        if name == 'distance':
            return UNKNOWN_DISTANCE
        if name == TARGET_INDEX:
            return UNKNOWN_INDEX
        kind, number = name.split('.')
        return 0.01 * self.thicknesses[int(number)] if kind == 'thicknesses' else UNKNOWN_LAYER


def check_places(guesses: Sequence[InterfaceGuess]) -> None:
    places = sorted(guess.place for guess in guesses)
    ports = [LEFT_PORT, RIGHT_PORT]
    if places not in ([SHARED], ports, [LEFT_PORT], [RIGHT_PORT], [SHARED, *ports]):
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
    guesses: Sequence[InterfaceGuess],
) -> tuple[list[InterfaceGuess], list[InterfaceGuess]]:
    """The shared surface, and the ports."""
    shared = [guess for guess in guesses if guess.place == SHARED]
    return shared, [guess for guess in guesses if guess.place != SHARED]


def with_known_ports(guesses: Sequence[InterfaceGuess]) -> list[InterfaceGuess]:
    """Ports before a shared surface, with a rough place where none was measured."""
    shared, ports = _parted(guesses)
    if not shared:
        return ports
    known = []
    for port in ports:
        deviations = {'normal': PORT_TILT, **port.deviations}
        if port.distance is None:
            deviations['distance'] = PORT_DISTANCE_DEVIATION
        distance = PORT_DISTANCE if port.distance is None else port.distance
        known.append(replace(port, distance=distance, deviations=deviations))
    return [*shared, *known]


def with_assumed_index(guesses: Sequence[InterfaceGuess]) -> list[InterfaceGuess]:
    """Guesses for views of a ball: an index that was not measured is that given, nearly."""
    return [
        replace(guess, deviations={TARGET_INDEX: ASSUMED_INDEX, **guess.deviations})
        for guess in guesses
    ]


def unknowns(
    start: RigState,
    guesses: Sequence[InterfaceGuess],
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
        free[:] = True
    elif air_covariance is not None:
        cameras = np.flatnonzero(~own)
        covariance = air_covariance.ordered([names[i] for i in cameras])
        known = np.diag(covariance) > 0
        cameras, covariance = cameras[known], covariance[np.ix_(known, known)]
        scale = np.sqrt(np.diag(covariance))
        inverse = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True)
        information[np.ix_(cameras, cameras)] = inverse / np.outer(scale, scale)
        free[cameras] = True
    measured = {f'{guess.place}.distance' for guess in guesses if guess.distance is not None}
    for i, name in enumerate(names):
        if name in prior and (name in measured or not name.endswith('.distance')):
            information[i, i] = prior[name] ** -2
    return free, Prior(start, information)


def prior_deviations(state: RigState, guesses: Sequence[InterfaceGuess]) -> dict[str, float]:
    last = [guess for guess in guesses if guess.place in state.last_places]
    deviations = {TARGET_INDEX: min(guess.deviation(TARGET_INDEX) for guess in last)}
    for guess in guesses:
        for name in state.names_of(guess.place):
            deviations[name] = guess.deviation(name.partition('.')[2])
    return deviations
