"""Which lens model: Brown's five terms, or the rational one of eight.

Five are kept unless they leave residuals that are systematic or larger than the corners' own
noise, *and* eight predict views better that they have not seen. The lens comes before the
outliers: under the wrong one good views look bad.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adequacy import Adequacy, adequacy, better_by
from binopos_ros.calibration.adjustment.adjust import NEARLY, Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.held_out import cross_validate
from binopos_ros.calibration.adjustment.start import guess_pose
from binopos_ros.calibration.adjustment.warp import estimate_warp
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.corner_noise import corner_variance
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import Camera, RigState
from binopos_ros.sides import SIDES

AUTO, BROWN, RATIONAL = 'auto', 'brown', 'rational'
LENSES = (AUTO, BROWN, RATIONAL)
BROWN_TERMS = 5
RATIONAL_TERMS = 8
RATIONAL_SPREAD = 1.0  # deviation of radial terms beforehand; a pinhole lies 1.3 away
TIGHTER, TIMES = 10.0, 4  # in information, for a lens that folds in the picture
#: The equidistant lens, r = theta, as eight terms: Gauss's continued fraction of the arc tangent
#: to its seventh level. Wide lenses lie near it, and it sees in every direction ahead.
EQUIDISTANT = (50 / 39, 283 / 715, 0.0, 0.0, 256 / 15015, 21 / 13, 105 / 143, 35 / 429)
BETTER = 2.0  # standard errors by which a larger lens model must win on held-out views
NOTICED = 1.05  # times larger errors; three terms are not worth what nobody notices
GRID = 33  # points across the picture at which the lens is asked for a ray


@dataclass(frozen=True)
class LensChoice:
    """One camera's lens.

    Attributes:
        five: the adequacy test of five terms; None where the lens was given.
        text: which lens, and why.
    """

    five: Adequacy | None
    text: str


def choose_lens(
    fit: Adjustment, views: Sequence[View], lens: str, prior: Prior | None = None
) -> tuple[Adjustment, LensChoice]:
    """The adjustment of one camera with the lens that its views ask for.

    Args:
        fit: with five terms; views: all that were seen, good or bad.
        lens: one of `LENSES`.
        prior: on the camera of five terms.

    Raises:
        CalibrationError: the views do not determine the lens that was asked for.
    """
    flat, flat_views = fit, views
    # A bent board and a lens that the model misses look alike, so each lens gets its own bend.
    if bent := estimate_warp(fit, views, prior):
        fit, views = bent.fit, bent.views
    five = adequacy(fit, views, 0)
    chance = f'p = {five.probability:.2g}'
    if lens == BROWN:
        return fit, LensChoice(five, f'five terms, as asked ({chance} of chance residuals)')
    above_noise = _above_noise(fit, views)
    if lens == AUTO and five.adequate and above_noise < BETTER:
        text = f'five terms are adequate ({chance} of chance residuals)'
        return fit, LensChoice(five, text)
    lead = f'five terms leave systematic residuals ({chance})'
    if five.adequate:
        lead = f"five terms leave more than the corners' noise ({above_noise:.1f} standard errors)"
    try:
        larger, held = _with_eight(flat, flat_views, prior)
        if lens == RATIONAL:
            return larger, LensChoice(five, 'rational lens, as asked')
        larger_views = flat_views
        if bent := estimate_warp(larger, flat_views, held):
            larger, larger_views = bent.fit, bent.views
        after = cross_validate(larger, larger_views, held).squares
    except CalibrationError:
        if lens == RATIONAL:
            raise
        text = f'{lead}, but these views do not determine a rational lens'
        return fit, LensChoice(five, text)
    # Judged by the views that they were fitted to five look too good: where they lose, they lose.
    before = np.array([fit.rms(view=i) ** 2 for i in range(len(views))])
    if five.adequate:
        # A bent board and blur leave more than noise, too: the lens has to explain some of it.
        before /= NOTICED**2
    score = better_by(before, after)
    if score < BETTER and not five.adequate:
        before = cross_validate(fit, views, prior).squares
        score = better_by(before, after)
    old, new = np.sqrt(before.mean()), np.sqrt(after.mean())
    change = f'RMS {old:.3f} -> {new:.3f} px held out, {score:.1f} standard errors'
    if score < BETTER:
        return fit, LensChoice(five, f'{lead}, but a rational lens is no better ({change})')
    return larger, LensChoice(five, f'{lead}: rational lens ({change})')


def _above_noise(fit: Adjustment, views: Sequence[View]) -> float:
    """By how many standard errors the views' residuals exceed what their corners scatter."""
    noise = np.array([corner_variance(view, 0) for view in views])
    known = np.isfinite(noise)
    if not known.any():
        return 0.0
    counts = [int(np.isfinite(view.pixels[0]).all(axis=1).sum()) for view in views]
    unknowns = 6 * len(views) + int(fit.free.sum())
    # A view's share of the parameters takes as much of its residuals.
    kept = 1.0 - unknowns / (2.0 * sum(counts))
    squares = np.array([fit.rms(view=i) ** 2 for i in range(len(views))]) / (2.0 * kept)
    return better_by(squares[known], noise[known])


def _with_eight(
    fit: Adjustment, views: Sequence[View], prior: Prior | None
) -> tuple[Adjustment, Prior]:
    (camera,) = fit.state.cameras
    camera = replace(camera, lens=np.array(EQUIDISTANT))
    start = RigState((camera,))
    held = lens_prior(start)
    if prior is not None:
        held.information[: len(fit.free), : len(fit.free)] += prior.information
    guesses = [guess_pose(camera, view.points, view.pixels[0]) for view in views]
    poses = [new or old for new, old in zip(guesses, fit.poses, strict=True)]
    free = np.ones(len(start.names), bool)
    return adjust(start, poses, views, free, held, converged=NEARLY), held


def lens_prior(state: RigState) -> Prior:
    """What holds the radial terms of rational lenses, of which many sets fit the pictures alike.

    They lie about those of the equidistant lens, or the lens would fold where no board was.
    """
    centre = tuple(
        replace(camera, lens=np.array(EQUIDISTANT))
        if len(camera.lens) == RATIONAL_TERMS
        else camera
        for camera in state.cameras
    )
    held = [
        f'{side}.{term}'
        for side, camera in zip(SIDES, state.cameras, strict=False)
        if len(camera.lens) == RATIONAL_TERMS
        for term in ('k1', 'k2', 'k3', 'k4', 'k5', 'k6')
    ]
    radial = np.array([name in held for name in state.names], float)
    return Prior(replace(state, cameras=centre), np.diag(radial / RATIONAL_SPREAD**2))


def one_to_one(fit: Adjustment, views: Sequence[View], prior: Prior) -> tuple[Adjustment, Prior]:
    """The adjustment with rational lenses that do not fold where their pictures are.

    Where no board was, the pictures leave that open, and what was held beforehand may decide.
    """
    found, held = fit, prior
    for _ in range(TIMES):
        if not any(blind_share(camera) for camera in found.state.cameras):
            return found, held
        held = Prior(held.state, TIGHTER * held.information)
        found = adjust(found.state, found.poses, views, fit.free, held)
        if found.rms() > NOTICED * fit.rms() or not held.information.any():
            break
    return fit, prior


def blind_share(camera: Camera) -> float:
    """The part of the picture whose pixels no ray reaches, as the lens model has it."""
    width, height = camera.size
    grid = np.meshgrid(np.linspace(0, width - 1, GRID), np.linspace(0, height - 1, GRID))
    rays = camera.pinhole().unproject(np.stack(grid, axis=-1).reshape(-1, 2))
    return float(np.mean(~np.isfinite(rays).all(axis=1)))
