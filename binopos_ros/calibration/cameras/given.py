"""Cameras that are calibrated already: then only their mutual pose is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Prior
from binopos_ros.calibration.adjustment.known import information_of
from binopos_ros.calibration.cameras.lens import LensChoice
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import Camera, RigState
from binopos_ros.sides import SIDES

GIVEN = LensChoice(None, 'as given')


@dataclass(frozen=True)
class GivenCameras:
    """Both cameras, from files.

    Attributes:
        cameras: left and right.
        covariance: of their parameters, within which the pictures refine them; None keeps them
            as they are, as if they were exact.
    """

    cameras: tuple[Camera, Camera]
    covariance: ParameterCovariance | None = None

    def refuse_other_size(self, sizes: tuple[tuple[int, int], tuple[int, int]]) -> None:
        """Raises:
        CalibrationError: the pictures' sizes (px) are not those of the cameras.
        """
        for name, size, camera in zip(SIDES, sizes, self.cameras, strict=True):
            if size != camera.size:
                raise CalibrationError(
                    f'the {name} pictures are {size[0]}x{size[1]}, but the intrinsics given are '
                    f'of {camera.size[0]}x{camera.size[1]} px: use the same resolution'
                )

    def unknowns(self, start: RigState) -> tuple[np.ndarray, Prior]:
        """Which of `start`'s parameters are free, and what is known of them."""
        posed = np.array([name.startswith(('rotation', 'translation')) for name in start.names])
        if self.covariance is None:
            return posed, Prior(start, np.zeros((len(posed), len(posed))))
        of_cameras = ['' if pose else name for name, pose in zip(start.names, posed, strict=True)]
        uncertain, information = information_of(self.covariance, of_cameras)
        return posed | uncertain, Prior(start, information)
