"""Where a board is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pose:
    """x_rig = rotation @ x_board + translation (m)."""

    rotation: np.ndarray
    translation: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) board points in the rig frame."""
        return points @ self.rotation.T + self.translation
