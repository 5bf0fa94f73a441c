"""One camera from views of a board: Zhang's start, Brown's lens (Eq. 1-3), robust adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.start import guess_camera, guess_pose
from binopos_ros.calibration.cameras.lens import BROWN_TERMS, LensChoice, choose_lens
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import RigState
from binopos_ros.sides import SIDES

FEWEST_VIEWS = 4  # three determine the camera, one more tells whether they agree
OUTLYING = 2.5  # times the median RMS of the views
LEAST_OUTLYING = 0.1  # px; views better than this are good whatever the others are
LEAST_TILT = 8.0  # degrees between the most different boards
MOST_FOCAL_DEVIATION = 0.03  # of the focal length


@dataclass(frozen=True)
class CameraFit:
    """One camera's calibration by itself.

    Attributes:
        adjustment: with the views' poses in this camera's frame.
        views: those that took part, in order, with the board as it is bent.
        outlying: name -> why, of views that fit much worse than the others.
        lens: which, and why.
    """

    adjustment: Adjustment
    views: tuple[View, ...]
    outlying: dict[str, str]
    lens: LensChoice


def calibrate_camera(
    views: Sequence[View],
    side: int,
    size: tuple[int, int],
    square_pixels: bool = False,
    robust: bool = True,
    lens: str | None = None,
) -> CameraFit:
    """Calibrate one camera by itself.

    Args:
        views: of a planar board; those that this camera does not see are passed over.
        side: 0 for the left camera's pixels, 1 for the right's.
        size: image width and height (px).
        square_pixels: force fx = fy.
        robust: let outlying points count less, and leave out the worst.
        lens: one of `lens.LENSES`; None takes Brown's five terms and a flat board, as the usual
            programs do.

    Raises:
        CalibrationError: too few views, or views that do not determine the camera.
    """
    own = [
        View(view.name, view.points, (view.pixels[side],))
        for view in views
        if np.isfinite(view.pixels[side]).all(axis=1).sum() >= 4
    ]
    if len(own) < FEWEST_VIEWS:
        raise CalibrationError(
            f'the {SIDES[side]} camera sees the board in {len(own)} usable pictures: at least '
            f'{FEWEST_VIEWS} are needed, 15 to 30 with different tilts are good'
        )
    camera = guess_camera(own, 0, size, BROWN_TERMS)
    guesses = [guess_pose(camera, view.points, view.pixels[0]) for view in own]
    own = [view for view, guess in zip(own, guesses, strict=True) if guess is not None]
    poses = [guess for guess in guesses if guess is not None]
    state = RigState((camera,))
    prior = None
    if square_pixels:
        tie = np.zeros((len(state.names),) * 2)
        tie[:2, :2] = 1e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
        prior = Prior(state, tie)
    # The lens's terms join once the poses and the focal length are about right.
    free = np.arange(len(state.names)) < 4
    first = adjust(state, poses, own, free, prior, robust=False)
    free[:] = True
    fit = adjust(first.state, first.poses, own, free, prior, robust=robust)
    if _outlying(fit, own):
        # A small board has a second, mirrored pose that fits nearly as well; before the lens was
        # known the wrong one may have been taken.
        camera = fit.state.cameras[0]
        again = [guess_pose(camera, view.points, view.pixels[0]) for view in own]
        poses = [new or old for new, old in zip(again, fit.poses, strict=True)]
        fit = adjust(fit.state, poses, own, free, prior, robust=robust)
    choice = LensChoice(None, 'five terms')
    # Flat boards determine no lens: they are refused for that, and at once.
    if lens is not None and _tilt(fit) >= LEAST_TILT:
        fit, used, choice = choose_lens(fit, own, lens, prior)
        own = list(used)
    return CameraFit(fit, tuple(own), _outlying(fit, own), choice)


def check_determined(fit: CameraFit, side: int) -> None:
    """Refuse a calibration from boards that never tilt.

    Raises:
        CalibrationError: the tilts differ by too little, or the focal length is uncertain.
    """
    adjustment = fit.adjustment
    focal = float(adjustment.state.cameras[0].focal[0])
    deviation = adjustment.deviation('left.fx') / focal
    tilt = _tilt(adjustment)
    if tilt < LEAST_TILT or deviation > MOST_FOCAL_DEVIATION:
        raise CalibrationError(
            f'the board never tilts enough for the {SIDES[side]} camera: its views differ by '
            f'{tilt:.0f} degrees and leave the focal length uncertain to {100 * deviation:.1f} %; '
            'add views tilted by 30-45 degrees about both axes'
        )


def _tilt(fit: Adjustment) -> float:
    """The largest angle between two of the boards (degrees)."""
    normals = np.array([pose.rotation[:, 2] for pose in fit.poses])
    cosine = np.clip(normals @ normals.T, -1.0, 1.0)
    return float(np.degrees(np.arccos(cosine.min())))


def _outlying(fit: Adjustment, views: Sequence[View]) -> dict[str, str]:
    rms = np.array([fit.rms(view=i) for i in range(len(views))])
    outlying = {}
    for i, view in enumerate(views):
        others = float(np.median(np.delete(rms, i)))
        if rms[i] > max(OUTLYING * others, LEAST_OUTLYING):
            outlying[view.name] = (
                f'its corners miss the model by {rms[i]:.2f} px, the other views by '
                f'{others:.2f} px: blur, a bent board, or corners caught by a neighbour'
            )
    return outlying
