"""The water's surface or the ports, from what the rig sees through them.

`binopos calibrate interface`. The cameras are known from air, with their covariance; unknown are
each interface's normal, distance, indices and thicknesses, and the pose of every board. What was
measured by hand enters as a prior with its standard deviation, so that a ruler, a caliper and
pictures mix as they should, and nothing has to be held at a value that is not exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from binopos_ros.calibration.adjust import NEARLY, Adjustment, Prior, View, adjust
from binopos_ros.calibration.covariance import ParameterCovariance
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.start import other_pose, straight_poses, sunk
from binopos_ros.calibration.state import (
    LEFT,
    LEFT_PORT,
    RIGHT_PORT,
    SHARED,
    TARGET_INDEX,
    RigState,
)
from binopos_ros.calibration.views import Dropped
from binopos_ros.optics import FlatInterface

#: Where nothing was measured: standard deviations so wide that the pictures decide.
UNKNOWN_NORMAL = 0.5  # rad
UNKNOWN_DISTANCE = 10.0  # m
UNKNOWN_INDEX = 0.1
UNKNOWN_LAYER = 0.01  # the index of glass or acrylic whose kind is known
SUSPICIOUS = 1.5  # times the median RMS of the views
FEWEST_INLIERS = 0.7  # of a view's points
#: First guesses of an unknown distance, as parts of the way to the nearest board.
FRACTIONS = (0.5, 0.15, 0.85)
#: Above this standard deviation (px) some views are asked what else would explain them.
SUSPECT = 0.35
ENOUGH_TO_ASK = 3
EXPLAINED = 0.6  # of the RMS may be left by an explanation, and no more than 2 SUSPECT
SCALES = (0.5, 0.8, 0.9, 1.1, 1.25, 2.0)
HOPELESS = 3.0  # px
GOOD_START = 0.5  # px; a descent into a wrong valley ends far above it


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


@dataclass(frozen=True)
class InterfaceCalibration:
    """What `calibrate_interface` found.

    Attributes:
        state: cameras and interfaces.
        covariance: (P, P) of all parameters of `state`, the cameras' included.
        prior: standard deviations beforehand, by name.
        adjustment: None where there were no views and the priors are all there is.
        views: those used; dropped: those not used, with reasons.
    """

    state: RigState
    covariance: np.ndarray
    prior: dict[str, float]
    adjustment: Adjustment | None
    views: tuple[View, ...]
    dropped: tuple[Dropped, ...] = ()

    def deviation(self, name: str) -> float:
        """The standard deviation of one parameter."""
        place = self.state.names.index(name)
        return float(np.sqrt(self.covariance[place, place]))

    @property
    def interface_names(self) -> list[str]:
        """The names of the interfaces' parameters."""
        return [name for name in self.state.names if name in self.prior]


def calibrate_interface(
    air: RigState,
    views: Sequence[View],
    guesses: Sequence[InterfaceGuess],
    air_covariance: ParameterCovariance | None = None,
    free_cameras: bool = False,
    sigma: float | None = None,
    robust: bool = True,
) -> InterfaceCalibration:
    """Calibrate the interfaces of a rig.

    Args:
        air: the rig as calibrated in air, without interfaces.
        views: of boards or balls beyond the interface.
        guesses: one shared surface, or a port for each camera.
        air_covariance: of the cameras' parameters; None takes them as exact.
        free_cameras: estimate the cameras' parameters without any prior (a rig that was never in
            air; needs points spread over the whole volume).
        sigma: standard deviation of a pixel coordinate (px); None estimates it.
        robust: reject outlying points.

    Raises:
        CalibrationError: no guess, views that no such interface explains, or nothing known at all.
    """
    _check_places(guesses)
    if not views:
        return _ruler_only(air, guesses, air_covariance)
    best, prior = _best_start(air, views, guesses, air_covariance, free_cameras)
    fit = adjust(best.state, best.poses, views, best.free, prior, robust=robust, sigma=sigma)
    dropped: list[Dropped] = []
    fit = _turn_boards(fit, views, prior, sigma)
    # One by one, the worst first: a bad view makes good ones look bad.
    while (bad := _outlying(fit)) and robust and len(views) > 1:
        worst = max(bad, key=lambda i: fit.rms(view=i))
        dropped.append(_drop(fit, views, worst))
        views = [view for i, view in enumerate(views) if i != worst]
        poses = [pose for i, pose in enumerate(fit.poses) if i != worst]
        fit = adjust(fit.state, poses, views, fit.free, prior, sigma=sigma)
        fit = _turn_boards(fit, views, prior, sigma)
    if not free_cameras:
        _refuse_misfit(fit, air, views, guesses, air_covariance)
    return InterfaceCalibration(
        fit.state,
        fit.covariance,
        _prior_deviations(fit.state, guesses),
        fit,
        tuple(views),
        tuple(dropped),
    )


def _refuse_misfit(
    fit: Adjustment,
    air: RigState,
    views: Sequence[View],
    guesses: Sequence[InterfaceGuess],
    air_covariance: ParameterCovariance | None,
) -> None:
    """Say what is wrong where no interface explains the pictures.

    Raises:
        CalibrationError: swapped cameras, a board of another size, or pairs that do not fit.
    """
    if fit.sigma < SUSPECT:
        return
    rms = fit.rms()
    some = views[:ENOUGH_TO_ASK]

    def error(changed: Sequence[View]) -> float:
        try:
            best = _best_start(air, changed, guesses, air_covariance, False)[0]
        except CalibrationError:
            return np.inf
        return best.rms()

    explained = min(EXPLAINED * rms, 2.0 * SUSPECT)
    lead = f'no such interface explains the pictures: they miss by {rms:.2f} px'
    if error([replace(view, pixels=view.pixels[::-1]) for view in some]) < explained:
        raise CalibrationError(f'{lead}; left and right are swapped: swap the two sources')
    scaled = {
        scale: error([replace(view, points=scale * view.points) for view in some])
        for scale in SCALES
    }
    scale = min(scaled, key=lambda one: scaled[one])
    if scaled[scale] < explained:
        raise CalibrationError(
            f'{lead}, with a board about {scale:g} times as large by {scaled[scale]:.2f} px: '
            "check the board's size"
        )
    if fit.sigma > HOPELESS:
        raise CalibrationError(
            f'{lead}: the pictures of a pair do not belong together, or the cameras have moved '
            'since they were calibrated'
        )


def _outlying(fit: Adjustment) -> list[int]:
    """The views most of whose points had to be left out; a few bad points do not condemn one."""
    bad = []
    for i, (inliers, residuals) in enumerate(zip(fit.inliers, fit.residuals, strict=True)):
        seen = [np.isfinite(one).all(axis=1) for one in residuals]
        share = sum(int(one.sum()) for one in inliers) / sum(int(one.sum()) for one in seen)
        if share < FEWEST_INLIERS:
            bad.append(i)
    return bad


def _turn_boards(
    fit: Adjustment, views: Sequence[View], prior: Prior, sigma: float | None
) -> Adjustment:
    """Try the other pose in which a board looks nearly the same, where a view fits badly."""
    rms = np.array([fit.rms(view=i) for i in range(len(views))])
    poses = list(fit.poses)
    for i in np.flatnonzero(rms > SUSPICIOUS * np.median(rms)):
        other = other_pose(fit.state.cameras[LEFT], views[i].points, views[i].pixels[LEFT])
        if views[i].turns and other is not None:
            poses[i] = sunk(other, views[i], fit.state)
    if all(new is old for new, old in zip(poses, fit.poses, strict=True)):
        return fit
    turned = adjust(fit.state, poses, views, fit.free, prior, sigma=sigma)
    return turned if turned.rms() < fit.rms() else fit


def _drop(fit: Adjustment, views: Sequence[View], worst: int) -> Dropped:
    usual = float(np.median([fit.rms(view=i) for i in range(len(views))]))
    return Dropped(
        views[worst].name,
        f'it misses the interface by {fit.rms(view=worst):.2f} px, the others by {usual:.2f} px: '
        'the board or the water moved between the two pictures, or it is another board',
    )


def _best_start(
    air: RigState,
    views: Sequence[View],
    guesses: Sequence[InterfaceGuess],
    air_covariance: ParameterCovariance | None,
    free_cameras: bool,
) -> tuple[Adjustment, Prior]:
    """Of several first distances, the one from which the pictures are explained best."""
    straight = straight_poses(air, views)
    nearest = min(
        float(np.min(pose.apply(view.points)[:, 2]))
        for pose, view in zip(straight, views, strict=True)
    )
    best: tuple[Adjustment, Prior] | None = None
    trouble = ''
    for fraction in FRACTIONS:
        interfaces = {
            guess.place: guess.interface(_first_distance(guess, fraction * nearest))
            for guess in guesses
        }
        start = replace(air, interfaces=interfaces)
        poses = [sunk(pose, view, start) for pose, view in zip(straight, views, strict=True)]
        free, prior = _unknowns(start, guesses, air_covariance, free_cameras)
        try:
            fit = adjust(
                start, poses, views, free, prior, robust=False, sigma=1.0, converged=NEARLY
            )
        except ValueError as error:
            trouble = str(error)
            continue
        if best is None or fit.rms() < 0.999 * best[0].rms():
            best = fit, prior
        if best[0].rms() < GOOD_START:
            break
    if best is None:
        raise CalibrationError(f'no such interface explains the views: {trouble}')
    return best


def _check_places(guesses: Sequence[InterfaceGuess]) -> None:
    places = sorted(guess.place for guess in guesses)
    if places not in ([SHARED], [LEFT_PORT, RIGHT_PORT], [LEFT_PORT], [RIGHT_PORT]):
        raise CalibrationError(
            f'interfaces {places}: give one shared surface, or a port for each camera'
        )
    if len({guess.indices[-1] for guess in guesses}) > 1:
        raise CalibrationError(
            'the ports end in different media: both look at one target, give one last index'
        )


def _unknowns(
    start: RigState,
    guesses: Sequence[InterfaceGuess],
    air_covariance: ParameterCovariance | None,
    free_cameras: bool,
) -> tuple[np.ndarray, Prior]:
    """Which parameters are free, and what is known of them."""
    names = start.names
    prior = _prior_deviations(start, guesses)
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


def _prior_deviations(state: RigState, guesses: Sequence[InterfaceGuess]) -> dict[str, float]:
    deviations = {TARGET_INDEX: min(guess.deviation(TARGET_INDEX) for guess in guesses)}
    for guess in guesses:
        for name in state.names_of(guess.place):
            deviations[name] = guess.deviation(name.partition('.')[2])
    return deviations


def _ruler_only(
    air: RigState,
    guesses: Sequence[InterfaceGuess],
    air_covariance: ParameterCovariance | None,
) -> InterfaceCalibration:
    interfaces = {}
    for guess in guesses:
        if guess.distance is None:
            raise CalibrationError(
                f"without pictures the {guess.place}'s distance must be measured by hand: "
                '--prior distance=0.80,0.005 (value and standard deviation in metres)'
            )
        interfaces[guess.place] = guess.interface(guess.distance)
    state = replace(air, interfaces=interfaces)
    prior = _prior_deviations(state, guesses)
    covariance = np.diag([prior.get(name, 0.0) ** 2 for name in state.names])
    if air_covariance is not None:
        covariance += air_covariance.ordered(
            [name if name not in prior else '' for name in state.names]
        )
    return InterfaceCalibration(state, covariance, prior, None, ())


def _first_distance(guess: InterfaceGuess, otherwise: float) -> float:
    return guess.distance if guess.distance is not None else otherwise
