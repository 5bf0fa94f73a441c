"""Which lens model: Brown's five terms, the rational one of eight, or the equidistant of four.

Five are kept unless they leave residuals that are systematic or larger than the corners' own
noise, *and* another lens predicts views better that they have not seen. The lens comes before the
outliers: under the wrong one good views look bad.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adequacy import BETTER, Adequacy, adequacy, better_by
from binopos_ros.calibration.adjustment.adjust import NEARLY, Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.held_out import cross_validate
from binopos_ros.calibration.adjustment.start import guess_pose
from binopos_ros.calibration.adjustment.warp import estimate_warp
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.corner_noise import corner_variance
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import lens as models
from binopos_ros.optics.rig_state import Camera, RigState
from binopos_ros.sides import SIDES

AUTO, BROWN, RATIONAL, EQUIDISTANT = 'auto', 'brown', 'rational', 'equidistant'
#: What is tried where Brown's five terms do not do.
OTHERS = (RATIONAL, EQUIDISTANT)
LENSES = (AUTO, BROWN, *OTHERS)
LENS_WORDS = {RATIONAL: 'rational lens', EQUIDISTANT: 'equidistant lens'}
BROWN_TERMS = 5
RATIONAL_TERMS = 8
RATIONAL_SPREAD = 1.0  # deviation of radial terms beforehand; a pinhole lies 1.3 away
TIGHTER, TIMES = 10.0, 4  # in information, for a lens that folds in the picture
#: The equidistant lens, r = theta, as eight terms: Gauss's continued fraction of the arc tangent
#: to its seventh level. Wide lenses lie near it, and it sees in every direction ahead.
ARC_TANGENT = (50 / 39, 283 / 715, 0.0, 0.0, 256 / 15015, 21 / 13, 105 / 143, 35 / 429)
#: The terms and the model from which the others begin.
IDEAL = {RATIONAL: (ARC_TANGENT, models.BROWN), EQUIDISTANT: ((0.0,) * 4, models.EQUIDISTANT)}
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
) -> tuple[Adjustment, Sequence[View], LensChoice]:
    """The adjustment of one camera with the lens that its views ask for, and the views with the
    board as it is bent.

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
        return fit, views, LensChoice(five, f'five terms, as asked ({chance} of chance residuals)')
    above_noise = _above_noise(fit, views)
    if lens == AUTO and five.adequate and above_noise < BETTER:
        text = f'five terms are adequate ({chance} of chance residuals)'
        return fit, views, LensChoice(five, text)
    lead = f'five terms leave systematic residuals ({chance})'
    if five.adequate:
        lead = f"five terms leave more than the corners' noise ({above_noise:.1f} standard errors)"
    if lens in OTHERS:
        other = _with(lens, flat, flat_views, prior)[0]
        return other, flat_views, LensChoice(five, f'{lens}, as asked')
    # Judged by the views that they were fitted to five look too good: where they lose, they lose.
    own = np.array([fit.rms(view=i) ** 2 for i in range(len(views))])
    # A bent board and blur leave more than noise, too: the lens has to explain some of it.
    own /= NOTICED**2 if five.adequate else 1.0
    told = []
    for name in OTHERS if not five.adequate else (RATIONAL,):
        try:
            other, held = _with(name, flat, flat_views, prior)
            other_views = flat_views
            if bent := estimate_warp(other, flat_views, held):
                other, other_views = bent.fit, bent.views
            after = cross_validate(other, other_views, held).squares
        except CalibrationError:
            told.append(f'these views do not determine {LENS_WORDS[name]}')
            continue
        before, score = own, better_by(own, after)
        if score < BETTER and not five.adequate:
            before = cross_validate(fit, views, prior).squares
            score = better_by(before, after)
        old, new = np.sqrt(before.mean()), np.sqrt(after.mean())
        change = f'RMS {old:.3f} -> {new:.3f} px held out, {score:.1f} standard errors'
        if score >= BETTER:
            words = f'{lead}: {LENS_WORDS[name]} ({change})'
            return other, other_views, LensChoice(five, words)
        told.append(f'{LENS_WORDS[name]} is no better ({change})')
    return fit, views, LensChoice(five, f'{lead}, but {", and ".join(told)}')


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


def _with(
    lens: str, fit: Adjustment, views: Sequence[View], prior: Prior | None
) -> tuple[Adjustment, Prior]:
    """The camera with another lens, from the ideal one of its kind."""
    (camera,) = fit.state.cameras
    terms, model = IDEAL[lens]
    camera = replace(camera, lens=np.array(terms), model=model)
    start = RigState((camera,))
    held = lens_prior(start)
    if prior is not None:
        held.information[:4, :4] += prior.information[:4, :4]
    guesses = [guess_pose(camera, view.points, view.pixels[0]) for view in views]
    poses = [new or old for new, old in zip(guesses, fit.poses, strict=True)]
    free = np.ones(len(start.names), bool)
    return adjust(start, poses, views, free, held, converged=NEARLY), held


def lens_prior(state: RigState) -> Prior:
    """What holds the radial terms of rational lenses, of which many sets fit the pictures alike.

    They lie about those of the equidistant lens, or the lens would fold where no board was.
    """
    centre = tuple(
        replace(camera, lens=np.array(ARC_TANGENT))
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
