"""From one pair of centres to a place, with all that its covariance is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import OpticsError, StereoRig
from binopos_ros.optics.arithmetic import FLOATS, NoRayError
from binopos_ros.optics.ball import ball_outlines
from binopos_ros.optics.disc import Outline, disc_outlines
from binopos_ros.triangulation.considered import changed_rigs, principal_errors
from binopos_ros.triangulation.evidence import gather_evidence
from binopos_ros.triangulation.extent import other_size
from binopos_ros.triangulation.index import DIFFERENT_POINTS
from binopos_ros.triangulation.medium import MediumMeter, may_wave
from binopos_ros.triangulation.meeting import midpoint
from binopos_ros.triangulation.options import LocatorOptions
from binopos_ros.triangulation.triangulate import (
    check_parameters,
    shared_covariances,
    triangulate,
)

Array = NDArray[np.float64]
#: Left and right centre (2,) px, left and right covariance (2, 2) px^2.
Views = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class Index:
    """The refractive index of the target's medium that a position rests on.

    `std` is 0 where the index is taken for exact; `observed` tells whether the rays determine it,
    or the prior alone; `frame` is what this pair alone gives (the paper's mean refractive index of
    the frame), nan where that is not determined.
    """

    mean: float
    std: float = 0.0
    observed: bool = False
    frame: float = math.nan


@dataclass(frozen=True)
class Place:
    """A point (3,) in the rig frame, m, and what its covariance (3, 3), m^2, is made of.

    `noise` differs from frame to frame. `medium` is what waves add that swing to and fro; None
    where nothing waves. `systematic` is what no filter averages away: the calibration's
    uncertainty, the ports', the index', and that of waves too slow to be averaged; None where
    there is none.
    """

    point: Array
    noise: Array
    medium: Array | None
    systematic: Array | None
    index: Index

    @property
    def covariance(self) -> Array:
        """The sum of all parts (3, 3), m^2."""
        total = self.noise
        for part in (self.medium, self.systematic):
            if part is not None:
                total = total + part
        return total


class Locator:
    """Triangulates pairs one after the other, and follows the index and the medium.

    Args:
        rig: cameras and surfaces.
        options: of the triangulation.
        covariance: (K, K) of the rig's parameters, in the order of `rig.parameter_names`.

    Raises:
        TriangulationError: options and covariance do not fit the rig.
    """

    def __init__(
        self, rig: StereoRig, options: LocatorOptions, covariance: Array | None = None
    ) -> None:
        self.rig, self._options, self._covariance = rig, options, covariance
        self._estimator = options.estimator(rig.interface, rig.target_index, covariance)
        self._changed: list[StereoRig] = []
        if covariance is not None and self._estimator is None:
            check_parameters(rig, covariance)
            if rig.target_index is not None:
                self._changed = changed_rigs(rig, principal_errors(covariance))
        waves = options.watches_medium and may_wave(rig.interface)
        self._meter = MediumMeter(rig, swell=options.medium == 'auto') if waves else None

    @property
    def wave_level(self) -> float | None:
        """Deviation of the waves in the rays' miss, in pixel noise's; None where none can be."""
        return None if self._meter is None else self._meter.level

    def locate(
        self, stamp: float, views: Views, diameters: tuple[float, float] = (0.0, 0.0)
    ) -> Place | str:
        """Triangulate one pair.

        Args:
            stamp: of the pair, s.
            views: the centres as the cameras saw them.
            diameters: of what they saw, left and right, px; 0 where that is not known.

        Returns:
            The place, or why there is none.
        """
        outlines: list[Outline] = []
        if self._options.target.diameter > 0:
            try:
                outlines = self._outlines(views)
            except NoRayError as no_ray:
                return str(no_ray)
            except OpticsError as error:
                # Where the pair itself meets nowhere, that is the reason.
                return str(triangulate(self.rig, *views).reasons or error)
            left, right = outlines
            views = (views[0] - left.offset, views[1] - right.offset, views[2], views[3])
        if self._estimator:
            found = self._followed(stamp, views)
        else:
            found = self._considered(views) if self._changed else self._found(views)
        if isinstance(found, str):
            return found
        place, residuals = found
        if 0 < self._options.epipolar_gate < np.abs(residuals).max():
            return DIFFERENT_POINTS
        if outlines:
            expected = [each.across for each in outlines]
            reason = other_size(expected, diameters, self._options.target.diameter)
            if reason:
                return reason
        if self._meter is None:
            return place
        waves = self._meter.add(stamp, residuals, views[2:], place.point, place.noise)
        systematic = waves.long
        if place.systematic is not None:
            systematic = systematic + place.systematic
        return Place(place.point, place.noise, waves.short, systematic, place.index)

    def _found(self, views: Views) -> tuple[Place, Array] | str:
        """Return the place and the residuals (4,) px at the index of the rig."""
        found = triangulate(self.rig, *views, method=self._options.method)
        if found.reasons:
            return str(found.reasons)
        point, noise, systematic = found.points, found.covariances, None
        if self._covariance is not None:
            covs = (views[2][None], views[3][None])
            (systematic,) = shared_covariances(
                self.rig, point[None], noise[None], covs, self._covariance
            )
        index = Index(self.rig.target_index or 1.0)
        return Place(point, noise, None, systematic, index), found.residuals

    def _considered(self, views: Views) -> tuple[Place, Array] | str:
        """As `_found`, with what the rig's errors do, in a tenth of the time."""
        evidence = gather_evidence(self.rig, *views, self._changed)
        if evidence.reason:
            return evidence.reason
        systematic = evidence.by_shared @ evidence.by_shared.T
        index = Index(evidence.at)
        place = Place(evidence.point, evidence.covariance, None, systematic, index)
        return place, evidence.residuals

    def _followed(self, stamp: float, views: Views) -> tuple[Place, Array] | str:
        """Return the place and the residuals (4,) px at the index that is followed."""
        assert self._estimator is not None
        state = self._estimator.update(self.rig, *views, stamp=stamp)
        if not np.isfinite(state.point).all():
            return state.reason
        index = Index(state.mean, state.std, state.observed, state.frame_index)
        systematic = state.covariance - state.noise
        return Place(state.point, state.noise, None, systematic, index), state.residuals

    def _outlines(self, views: Views) -> list[Outline]:
        """What a target of the known diameter shows where the rays of the views all but meet.

        Raises:
            NoRayError: a pixel has no ray, or the rays do not meet.
            OpticsError: the target is not seen whole from there.
        """
        (u, v), (right_u, right_v) = views[0].tolist(), views[1].tolist()
        rays = (
            self.rig.left_view.ray(u, v, FLOATS),
            self.rig.right_view.ray(right_u, right_v, FLOATS),
        )
        near = np.array(midpoint(*rays, FLOATS)[0])
        target = self._options.target
        if target.shape == 'ball':
            return ball_outlines(self.rig.project, near, target.diameter)
        nearest = self.rig.interface or self.rig.left_port
        flat = nearest.axis if nearest is not None else np.array([0.0, 0.0, 1.0])
        normal = np.array(target.normal) if target.normal else flat
        return disc_outlines(self.rig.project, near, normal, target.diameter)
