"""A plane that the target is known to lie in, such as a basin's floor: it sharpens the index.

Two rays that look almost straight down say little about the index, but all about the apparent
depth; with the true depth known, its ratio to the apparent one *is* the index.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from binopos_ros.optics import FlatInterface
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.evidence import Clue, Evidence


class KnownPlane:
    """The plane normal . x = offset of the rig frame.

    Args:
        normal: (3,) direction, scaled to unit length.
        offset: m, along the normal from the left camera's centre.
        std: standard deviation of the offset, m. It is one error for all frames (the floor does
            not move): it never averages out.

    Raises:
        TriangulationError: no direction, or an offset or deviation that cannot be.
    """

    def __init__(self, normal: ArrayLike, offset: float, std: float) -> None:
        direction = np.array(normal, dtype=np.float64)
        length = float(np.linalg.norm(direction)) if direction.shape == (3,) else 0.0
        if not (math.isfinite(length) and length > 0):
            msg = f'known plane: the normal {normal!r} is no direction: give three numbers'
            raise TriangulationError(msg)
        if not math.isfinite(offset):
            msg = f'known plane: the offset is {offset}: give metres along the normal'
            raise TriangulationError(msg)
        if not (math.isfinite(std) and std > 0):
            msg = f'known plane: the standard deviation is {std} m: it must be above 0'
            raise TriangulationError(msg)
        self.normal = direction / length
        self.normal.flags.writeable = False
        self.offset = float(offset)
        self.std = float(std)

    @classmethod
    def at_depth(cls, interface: FlatInterface, depth: float, std: float) -> KnownPlane:
        """Return the plane parallel to `interface`, `depth` m beyond its last surface.

        Raises:
            TriangulationError: a depth that is not above 0, or an impossible deviation.
        """
        if not depth > 0:
            msg = f'known plane: a depth of {depth} m is not beyond the interface'
            raise TriangulationError(msg)
        offset = interface.distance + sum(interface.thicknesses) + depth
        return cls(interface.normal, offset, std)

    def clue(self, evidence: Evidence) -> Clue:
        """Return what the plane says about the index, given one pair's point.

        How far the point at the assumed index lies from the plane, in standard deviations of the
        point across it. The last considered parameter is the error of the plane's offset.
        """
        across = self._spread(evidence)
        return Clue(
            innovation=(self.offset - float(self.normal @ evidence.point)) / across,
            gain=float(self.normal @ evidence.by_index) / across,
            shared=np.append(self.normal @ evidence.by_shared, -1.0) / across,
        )

    def hold(self, evidence: Evidence) -> Evidence:
        """Return the evidence with its point, covariance and derivatives held in the plane."""
        across = self._spread(evidence)
        pull = evidence.covariance @ self.normal / across**2
        along = np.eye(3) - np.outer(pull, self.normal)
        return replace(
            evidence,
            point=evidence.point + pull * (self.offset - self.normal @ evidence.point),
            covariance=along @ evidence.covariance,
            by_index=along @ evidence.by_index,
            by_shared=np.column_stack([along @ evidence.by_shared, pull]),
        )

    def _spread(self, evidence: Evidence) -> float:
        """Standard deviation of the point across the plane, m."""
        return math.sqrt(float(self.normal @ evidence.covariance @ self.normal))
