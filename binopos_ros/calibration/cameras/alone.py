"""One camera alone, from its own pictures: `binopos calibrate camera`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from binopos_ros.calibration.adjustment.adjust import Adjustment
from binopos_ros.calibration.adjustment.held_out import HeldOut, cross_validate
from binopos_ros.calibration.adjustment.noise import widened
from binopos_ros.calibration.cameras.camera import FEWEST_VIEWS, calibrate_camera, check_determined
from binopos_ros.calibration.cameras.lens import LensChoice, lens_prior, one_to_one
from binopos_ros.calibration.views.pairs import Dropped, repeats
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import LEFT, Camera


@dataclass(frozen=True)
class CameraCalibration:
    """What `calibrate_alone` found.

    Attributes:
        adjustment: of the camera and its boards, in its own frame.
        views: those used; dropped: those not used, with reasons.
        lens: which model, and why.
        held_out: cross-validation.
    """

    adjustment: Adjustment
    views: tuple[View, ...]
    dropped: tuple[Dropped, ...]
    lens: LensChoice
    held_out: HeldOut

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.adjustment.state.cameras[0]


def calibrate_alone(views: Sequence[View], size: tuple[int, int], lens: str) -> CameraCalibration:
    """Calibrate one camera from its own pictures.

    Args:
        views: of one board, of one picture each.
        size: image width and height (px).
        lens: one of `lens.LENSES`.

    Raises:
        CalibrationError: too few views, or views that do not determine the camera.
    """
    again = repeats(views)
    dropped = list(again.values())
    kept = [view for i, view in enumerate(views) if i not in again]
    fit = calibrate_camera(kept, LEFT, size, lens=lens)
    check_determined(fit, LEFT)
    if fit.outlying and len(kept) - len(fit.outlying) >= FEWEST_VIEWS:
        dropped += [Dropped(name, reason) for name, reason in fit.outlying.items()]
        kept = [view for view in kept if view.name not in fit.outlying]
        fit = calibrate_camera(kept, LEFT, size, lens=lens)
    prior = lens_prior(fit.adjustment.state)
    adjustment, prior = one_to_one(fit.adjustment, fit.views, prior)
    held_out = cross_validate(adjustment, fit.views, prior)
    found = widened(adjustment, fit.views)
    return CameraCalibration(found, fit.views, tuple(dropped), fit.lens, held_out)
