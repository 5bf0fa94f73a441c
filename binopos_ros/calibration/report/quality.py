"""What speaks against a calibration of the cameras, in plain words."""

from __future__ import annotations

import numpy as np

from binopos_ros.calibration.cameras.lens import blind_share
from binopos_ros.calibration.cameras.stereo import StereoCalibration
from binopos_ros.calibration.views.corner_noise import corner_noise
from binopos_ros.sides import SIDES

POOR = 2.0  # times the corners' own noise


def concerns(calibration: StereoCalibration) -> list[str]:
    """One sentence for each thing that is wrong; empty where nothing is."""
    found = []
    for name, camera in zip(SIDES, calibration.state.cameras, strict=True):
        if share := blind_share(camera):
            found.append(
                f'{100 * share:.2g} % of the {name} picture has no ray in this lens model, and '
                'gives no position: show the board there, or try another --lens'
            )
    noise = np.sqrt(2.0) * corner_noise(calibration.views)
    ratio = calibration.held_out.rms / noise
    if ratio > POOR:
        found.append(
            f'the result is poor: held-out corners miss by {calibration.held_out.rms:.3f} px, '
            f'{ratio:.1f} times their own noise of {noise:.3f} px: another --lens, a flatter '
            'board, pictures in which it rests'
        )
    return found
