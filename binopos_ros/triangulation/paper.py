"""The paper's own method (Wang and Hu, Traitement du Signal 35, 2018), with its errata mended.

Both functions work along the interface's normal N instead of the paper's y axis, so that any tilt
will do, and take any number of parallel layers, of which the paper has none. Each camera's ray
stays in the plane through that camera's centre that holds N. Both planes hold the target, so it
lies on their common line, parallel to N, whatever the index is; only its height on that line
depends on the index. Lengths are metres, the frame is the rig's (the left camera's).

A rig with a port per camera has no common line: both functions refuse it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import ARRAYS
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.meeting import PARALLEL, PARALLEL_SINE, midpoint
from binopos_ros.triangulation.straight import BEHIND, NO_RAY

if TYPE_CHECKING:
    from binopos_ros.optics import FlatInterface, StereoRig

Array = NDArray[np.float64]

_NOT_BELOW = 'target is not beyond the interface'
_TOTAL_REFLECTION = 'total reflection'
_ONE_PLANE = 'index not observable: target in the plane of both centres and the normal'
_EQUALLY_FAR = 'index not observable: target equally far from both cameras'
_NO_INDEX = 'no index makes the refracted rays meet'


class _Rays(NamedTuple):
    """Both cameras' rays in the air, rig frame: unit directions (N,3); right centre (3,)."""

    left: Array
    right: Array
    right_centre: Array


def triangulate_paper(
    rig: StereoRig, left_px: ArrayLike, right_px: ArrayLike
) -> tuple[Array, NDArray[np.str_]]:
    """Triangulate as the paper does: a virtual point on straight rays, then one refraction.

    Args:
        rig: cameras and, at most, one interface that both share.
        left_px: (N,2) or (2,), pixels in the left image.
        right_px: the same in the right image.

    Returns:
        points (N,3) in the rig frame, m, nan where there is none; reasons (N,), '' where there is.

    Raises:
        TriangulationError: a rig with ports, or pixels of unequal or wrong shape.
    """
    rays = _rays(rig, left_px, right_px)
    virtual, reasons = _virtual_points(rays)
    interface = _shared_interface(rig)
    if interface is None:
        return virtual, reasons

    # Eq. 10: the left straight ray to E2 pierces the first surface at D1.
    depth = virtual @ interface.normal
    lateral = np.linalg.norm(virtual - depth[:, None] * interface.normal, axis=1)
    tangent = lateral / depth
    # Eq. 8, 9 and 11 mended: n1 sin(angle in air) = n2 sin(angle in water), |E1D1|/|E2D1| = n2/n1.
    invariant = interface.indices[0] * tangent / np.hypot(1.0, tangent)
    travelled, last_surface, tangents = _through_layers(interface, invariant)
    # Eq. 12 mended: the bent ray comes to E2's distance from the axis at the target's height X.
    bent = (lateral - travelled) / np.where(tangents > 0, tangents, np.nan)
    straight_down = _straight_down(interface, depth)
    height = last_surface + np.where(tangents > 0, bent, straight_down)
    points = virtual + (height - depth)[:, None] * interface.normal

    _give(reasons, depth <= interface.distance, _NOT_BELOW)
    _give(reasons, np.isnan(tangents), _TOTAL_REFLECTION)
    _give(reasons, ~(height > last_surface), _NOT_BELOW)
    points[reasons != ''] = np.nan
    return points, reasons


def frame_index(
    rig: StereoRig, left_px: ArrayLike, right_px: ArrayLike
) -> tuple[Array, NDArray[np.str_]]:
    """Return the index of the last medium at which both refracted rays of a pair meet.

    What Eq. 13-15 intend: the paper's mean refractive index of a frame. On the common line, at
    distances a and b from where the rays enter the last medium, with ray invariants s and t
    (index times sine of the angle to N), the heights are equal when

        a^2 (n^2/s^2 - 1) = b^2 (n^2/t^2 - 1),   so   n^2 = (a^2 - b^2) / (a^2/s^2 - b^2/t^2).

    With noise this is a wild number for most targets: `index.IndexEstimator` weighs and
    accumulates it. The last index of the rig's interface is not used.

    Args:
        rig: cameras with one interface that both share.
        left_px: (N,2) or (2,), pixels in the left image.
        right_px: the same in the right image.

    Returns:
        index (N,), nan where this pair cannot tell, and reasons (N,), '' where it can.

    Raises:
        TriangulationError: a rig with ports or without interface, or pixels of wrong shape.
    """
    rays = _rays(rig, left_px, right_px)
    interface = _shared_interface(rig)
    if interface is None:
        msg = 'frame_index: the rig has no interface, so there is no index to find'
        raise TriangulationError(msg)
    reasons = _blank_reasons(rays.left)
    normal = interface.normal
    left_across, left_along = _split(rays.left, normal)
    right_across, right_along = _split(rays.right, normal)
    left_sine = np.linalg.norm(left_across, axis=1)
    right_sine = np.linalg.norm(right_across, axis=1)
    offset = rays.right_centre - (rays.right_centre @ normal) * normal

    # Eq. 10 and 14 mended: distances of the common line from each camera, across the normal.
    twist = np.cross(left_across, right_across) @ normal
    with np.errstate(divide='ignore', invalid='ignore'):
        left_lateral = (np.cross(offset, right_across) @ normal) / twist * left_sine
        right_lateral = (np.cross(offset, left_across) @ normal) / twist * right_sine

        index = interface.indices[0]
        left_gap = interface.distance
        right_gap = float(interface.distance - rays.right_centre @ normal)
        left_run = left_lateral - _run(interface, left_sine, left_along, left_gap)
        right_run = right_lateral - _run(interface, right_sine, right_along, right_gap)
        left_ratio = (left_run / (index * left_sine)) ** 2
        right_ratio = (right_run / (index * right_sine)) ** 2
        difference = left_ratio - right_ratio
        squared = (left_run**2 - right_run**2) / difference

    same_plane = np.abs(twist) <= PARALLEL_SINE * left_sine * right_sine
    equally_far = np.abs(difference) <= PARALLEL_SINE * (left_ratio + right_ratio)
    largest = np.maximum(left_sine, right_sine) * index
    _give(reasons, np.isnan(twist), NO_RAY)
    _give(reasons, same_plane, _ONE_PLANE)
    _give(reasons, (left_lateral < 0) | (right_lateral < 0), BEHIND)
    _give(reasons, (left_run <= 0) | (right_run <= 0), _NOT_BELOW)
    _give(reasons, equally_far, _EQUALLY_FAR)
    _give(reasons, ~(squared > np.maximum(largest, 1.0) ** 2), _NO_INDEX)
    good = reasons == ''
    return np.sqrt(np.where(good, squared, np.nan)), reasons


def _rays(rig: StereoRig, left_px: ArrayLike, right_px: ArrayLike) -> _Rays:
    """Eq. 1-5: undistort, leave the image, and bring both rays into the left camera's frame."""
    left = np.atleast_2d(np.asarray(left_px, dtype=np.float64))
    right = np.atleast_2d(np.asarray(right_px, dtype=np.float64))
    if left.shape != right.shape or left.ndim != 2 or left.shape[1] != 2:
        msg = f'pixels have shapes {left.shape} and {right.shape}: give (N, 2) for both'
        raise TriangulationError(msg)
    rotation = np.asarray(rig.rotation, dtype=np.float64)
    centre = -rotation.T @ np.asarray(rig.translation, dtype=np.float64).reshape(3)
    return _Rays(rig.left.unproject(left), rig.right.unproject(right) @ rotation, centre)


def _virtual_points(rays: _Rays) -> tuple[Array, NDArray[np.str_]]:
    """Eq. 6-7: E2 (N,3), the middle of the shortest segment between the two straight rays.

    The paper's single scale holds for parallel cameras only; one scale per ray holds always, and
    is the same there.
    """
    (ux, uy, uz), (vx, vy, vz) = rays.left.T, rays.right.T
    x, y, z = rays.right_centre.tolist()
    with np.errstate(divide='ignore', invalid='ignore'):
        left, right = ((0.0, 0.0, 0.0), (ux, uy, uz)), ((x, y, z), (vx, vy, vz))
        middle, scales = midpoint(left, right, ARRAYS)
    points = np.stack(middle, axis=-1)
    reasons = _blank_reasons(points)
    _give(reasons, np.isnan(ux + vx), NO_RAY)
    _give(reasons, np.isnan(scales[0]), PARALLEL)
    _give(reasons, ~((scales[0] > 0) & (scales[1] > 0)), BEHIND)
    points[reasons != ''] = np.nan
    return points, reasons


def _shared_interface(rig: StereoRig) -> FlatInterface | None:
    if rig.left_port is not None or rig.right_port is not None:
        msg = (
            "the paper's method knows one surface that both cameras share, and this rig has "
            'ports: use method refractive'
        )
        raise TriangulationError(msg)
    return rig.interface


def _split(rays: Array, normal: Array) -> tuple[Array, Array]:
    """Return the parts of unit rays across (N,3) and along (N,) the normal."""
    along = rays @ normal
    return rays - along[:, None] * normal, along


def _run(interface: FlatInterface, sine: Array, cosine: Array, gap: float) -> Array:
    """Return the distance across the normal from a camera to where its ray leaves the layers."""
    travelled = gap * sine / np.where(cosine > 0, cosine, np.nan)
    for index, thickness in zip(interface.indices[1:-1], interface.thicknesses, strict=True):
        layer_sine = interface.indices[0] * sine / index
        travelled = travelled + thickness * _tangent(layer_sine)
    return travelled


def _through_layers(interface: FlatInterface, invariant: Array) -> tuple[Array, float, Array]:
    """Follow left rays to the last surface: distance across, its depth, tangent beyond it."""
    first_sine = invariant / interface.indices[0]
    cosine = np.sqrt(np.clip(1.0 - first_sine**2, 0.0, None))
    travelled = _run(interface, first_sine, cosine, interface.distance)
    last_surface = float(interface.distance + np.sum(interface.thicknesses))
    return travelled, last_surface, _tangent(invariant / interface.indices[-1])


def _straight_down(interface: FlatInterface, depth: Array) -> Array:
    """The limit of Eq. 12 on the normal itself: apparent depths grow by the ratio of indices."""
    apparent = interface.distance + sum(
        thickness * interface.indices[0] / index
        for index, thickness in zip(interface.indices[1:-1], interface.thicknesses, strict=True)
    )
    return (depth - apparent) * interface.indices[-1] / interface.indices[0]


def _tangent(sine: Array) -> Array:
    """Tangent of an angle from its sine; nan beyond total reflection."""
    return sine / np.sqrt(np.where(sine < 1, 1.0 - sine**2, np.nan))


def _blank_reasons(like: Array) -> NDArray[np.str_]:
    longest = max(len(_ONE_PLANE), len(_EQUALLY_FAR))
    return np.full(len(like), '', dtype=f'<U{longest}')


def _give(reasons: NDArray[np.str_], where: NDArray[np.bool_], reason: str) -> None:
    """Give `reason` to those that have none yet."""
    reasons[where & (reasons == '')] = reason
