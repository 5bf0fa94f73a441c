"""The water's surface or the ports, from what the rig sees through them.

`binopos calibrate interface`. The cameras are known from air, with their covariance; unknown are
each interface's normal, distance, indices and thicknesses, and the pose of every board. What was
measured by hand enters as a prior with its standard deviation, so that a ruler, a caliper and
pictures mix as they should, and nothing has to be held at a value that is not exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adjust import NEARLY, Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.noise import widened
from binopos_ros.calibration.adjustment.start import other_pose, straight_poses, sunk
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.guesses import (
    Guess,
    check_places,
    prior_deviations,
    unknowns,
    with_assumed_index,
    with_known_ports,
)
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import LEFT, RigState

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
ROUGHLY = 1e-3  # relative decrease of the cost at which an explanation has shown its worth
GOOD_START = 0.5  # px; a descent into a wrong valley ends far above it


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
    guesses: Sequence[Guess],
    air_covariance: ParameterCovariance | None = None,
    free_cameras: bool = False,
    sigma: float | None = None,
    robust: bool = True,
) -> InterfaceCalibration:
    """Calibrate the interfaces of a rig.

    Args:
        air: the rig as calibrated in air, without interfaces.
        views: of boards or balls beyond the interface.
        guesses: one shared surface, or a port for each camera, or both.
        air_covariance: of the cameras' parameters; None takes them as exact.
        free_cameras: estimate the cameras' parameters without any prior (a rig that was never in
            air; needs points spread over the whole volume).
        sigma: standard deviation of a pixel coordinate (px); None estimates it.
        robust: reject outlying points.

    Raises:
        CalibrationError: no guess, views that no such interface explains, or nothing known at all.
    """
    check_places(guesses)
    guesses = with_known_ports(guesses)
    if not views:
        return _ruler_only(air, guesses, air_covariance)
    if not any(view.turns for view in views):
        guesses = with_assumed_index(guesses)
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
    if sigma is None:
        fit = widened(fit, views, prior)
    return InterfaceCalibration(
        fit.state,
        fit.covariance,
        prior_deviations(fit.state, guesses),
        fit,
        tuple(views),
        tuple(dropped),
    )


def _refuse_misfit(
    fit: Adjustment,
    air: RigState,
    views: Sequence[View],
    guesses: Sequence[Guess],
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
            best = _best_start(air, changed, guesses, air_covariance, False, ROUGHLY)[0]
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
    none = np.zeros(len(fit.free), bool)
    for i in np.flatnonzero(rms > SUSPICIOUS * np.median(rms)):
        other = other_pose(fit.state.cameras[LEFT], views[i].points, views[i].pixels[LEFT])
        if not views[i].turns or other is None:
            continue
        start = [sunk(other, views[i], fit.state)]
        alone = adjust(
            fit.state, start, [views[i]], none, robust=False, sigma=1.0, converged=NEARLY
        )
        if alone.rms() < rms[i]:
            poses[i] = alone.poses[0]
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
    guesses: Sequence[Guess],
    air_covariance: ParameterCovariance | None,
    free_cameras: bool,
    converged: float = NEARLY,
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
        interfaces = {guess.place: guess.start(fraction * nearest) for guess in guesses}
        start = replace(air, interfaces=interfaces)
        poses = [sunk(pose, view, start) for pose, view in zip(straight, views, strict=True)]
        free, prior = unknowns(start, guesses, air_covariance, free_cameras)
        try:
            fit = adjust(
                start, poses, views, free, prior, robust=False, sigma=1.0, converged=converged
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


def _ruler_only(
    air: RigState,
    guesses: Sequence[Guess],
    air_covariance: ParameterCovariance | None,
) -> InterfaceCalibration:
    state = replace(air, interfaces={guess.place: guess.by_hand() for guess in guesses})
    prior = prior_deviations(state, guesses)
    covariance = np.diag([prior.get(name, 0.0) ** 2 for name in state.names])
    if air_covariance is not None:
        covariance += air_covariance.ordered(
            [name if name not in prior else '' for name in state.names]
        )
    return InterfaceCalibration(state, covariance, prior, None, ())
