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
from binopos_ros.calibration.adjustment.shape import (
    FLAT,
    BoardShape,
    bent_board,
    with_uncertain_shape,
)
from binopos_ros.calibration.adjustment.start import other_pose, sunk
from binopos_ros.calibration.adjustment.warp import Bent
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.guesses import (
    Guess,
    check_places,
    prior_deviations,
    with_assumed_index,
    with_known_plates,
)
from binopos_ros.calibration.interface.misfit import SUSPECT, refuse_explained, refuse_hopeless
from binopos_ros.calibration.interface.starts import Known, best_start
from binopos_ros.calibration.views.pairs import Dropped, repeats
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import LEFT, TARGET_INDEX, RigState

SUSPICIOUS = 1.5  # times the median RMS of the views
FEWEST_INLIERS = 0.7  # of a view's points
LEAST_LIQUID = 1.2  # index; liquefied gases lie about it, what people dive in far above
SURE = 3.0  # standard deviations


@dataclass(frozen=True)
class InterfaceCalibration:
    """What `calibrate_interface` found.

    Attributes:
        state: cameras and interfaces.
        covariance: (P, P) of all parameters of `state`, the cameras' included.
        prior: standard deviations beforehand, by name.
        adjustment: None where there were no views and the priors are all there is.
        views: those used; dropped: those not used, with reasons.
        shape: of the board.
    """

    state: RigState
    covariance: np.ndarray
    prior: dict[str, float]
    adjustment: Adjustment | None
    views: tuple[View, ...]
    dropped: tuple[Dropped, ...] = ()
    shape: BoardShape = FLAT

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
    guesses = with_known_plates(guesses)
    if not views:
        return _ruler_only(air, guesses, air_covariance)
    if not any(view.turns for view in views):
        guesses = with_assumed_index(guesses)
    again = repeats(views) if views[0].turns else {}
    views = [view for i, view in enumerate(views) if i not in again]
    dropped = list(again.values())
    known = Known(air, guesses, air_covariance)
    try:
        best, prior = best_start(known, views, free_cameras)
    except CalibrationError:
        refuse_explained(known, views, np.inf)
        raise
    fit = adjust(best.state, best.poses, views, best.free, prior, robust=robust, sigma=sigma)
    fit = _turn_boards(fit, views, prior, sigma)
    flat = views
    fit, views, bent = _shaped(fit, flat, prior)
    if not free_cameras and fit.sigma > SUSPECT:
        refuse_explained(known, views, fit.rms())
    # One by one, the worst first: a bad view makes good ones look bad.
    while (bad := _outlying(fit)) and robust and len(views) > 1:
        worst = max(bad, key=lambda i: fit.rms(view=i))
        dropped.append(_drop(fit, views, worst))
        views, flat = ([one for i, one in enumerate(some) if i != worst] for some in (views, flat))
        poses = [pose for i, pose in enumerate(fit.poses) if i != worst]
        fit = adjust(fit.state, poses, views, fit.free, prior, sigma=sigma)
        fit = _turn_boards(fit, views, prior, sigma)
    if bent is not None and len(views) < len(bent.views):
        # What has been left out has no say in the board's shape.
        fit = adjust(fit.state, fit.poses, flat, fit.free, prior, robust=robust, sigma=sigma)
        fit, views, bent = _shaped(fit, flat, prior)
    if not free_cameras:
        refuse_hopeless(fit)
    _refuse_air(fit, guesses)
    fit = _not_below_one(fit, views, prior, sigma)
    if sigma is None:
        fit = widened(fit, views, prior)
    shape = FLAT
    if bent is not None:
        fit, shape = with_uncertain_shape(fit, bent)
    return InterfaceCalibration(
        fit.state,
        fit.covariance,
        prior_deviations(fit.state, guesses),
        fit,
        tuple(views),
        tuple(dropped),
        shape,
    )


def _shaped(
    fit: Adjustment, views: list[View], prior: Prior
) -> tuple[Adjustment, list[View], Bent | None]:
    """With the board's own shape, where all show one flat board and it turns out not to be."""
    points = views[0].points
    one_board = all(view.turns and np.array_equal(view.points, points) for view in views)
    found = None
    if one_board and not np.ptp(points[:, 2]):
        found = bent_board(fit, views, prior)
    if found is None:
        return fit, views, None
    return found[0].fit, list(found[0].views), found[0]


def _refuse_air(fit: Adjustment, guesses: Sequence[Guess]) -> None:
    """Say so where a liquid was given and the pictures show none.

    Raises:
        CalibrationError: no liquid has the index found.
    """
    if not any(guess.estimates_index and guess.indices[-1] > LEAST_LIQUID for guess in guesses):
        return
    index, deviation = fit.state.target_index, fit.deviation(TARGET_INDEX)
    if index + SURE * deviation < LEAST_LIQUID:
        raise CalibrationError(
            f'the pictures show an index of {index:.4f} (+- {deviation:.4f}), which is that of '
            'air and of no liquid: take them through the water, or give the gas as the last of '
            'the --indices'
        )


def _not_below_one(
    fit: Adjustment, views: Sequence[View], prior: Prior, sigma: float | None
) -> Adjustment:
    """The fit with an index that noise has brought below 1 held there, as uncertain as it was."""
    short = 1.0 - fit.state.target_index
    if short <= 0.0:
        return fit
    is_index = np.array([name == TARGET_INDEX for name in fit.state.names])
    start = fit.state.plus(short * is_index)
    held = adjust(start, fit.poses, views, fit.free & ~is_index, prior, sigma=sigma)
    return replace(held, free=fit.free, covariance=fit.covariance)


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
