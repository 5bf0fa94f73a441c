"""Pixels of points, with the derivatives by the point and by every parameter of the rig.

The chain is rig frame -> camera frame -> through the interface -> lens. Rotations are
differentiated by a left factor exp(d) (see `rig_state`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from binopos_ros.optics.arithmetic import ARRAYS
from binopos_ros.optics.equidistant import EquidistantLens
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import FlatInterface
from binopos_ros.optics.lens import EQUIDISTANT
from binopos_ros.optics.paths import path_through
from binopos_ros.optics.refracted import apparent_points
from binopos_ros.optics.rig_state import (
    RIGHT,
    SHARED,
    TARGET_INDEX,
    Camera,
    RigState,
    cross_matrices,
    places_seen_through,
)
from binopos_ros.optics.shooting import image_plane_jacobian
from binopos_ros.optics.surfaces import Surfaces
from binopos_ros.sides import SIDES


@dataclass(frozen=True)
class Projection:
    """pixels (N, 2); by_point (N, 2, 3), by the point in the rig frame; by_rig (N, 2, P)."""

    pixels: np.ndarray
    by_point: np.ndarray
    by_rig: np.ndarray


def project(state: RigState, side: int, points: np.ndarray) -> Projection:
    """Project rig-frame points (N, 3) into a camera, with all derivatives.

    Pixels are nan where the point lies before the interface or behind the camera.
    """
    names = state.names
    by_rig = np.zeros((len(points), 2, len(names)))
    camera = state.cameras[side]
    local = points @ state.rotation.T + state.translation if side == RIGHT else points
    seen = _through_interface(state, side, local)
    pixels, by_seen, by_camera = project_straight(camera, seen.points)

    start = len(state.cameras[0].lens) + 4 if side == RIGHT else 0
    by_rig[:, :, start : start + by_camera.shape[2]] = by_camera
    if seen.columns:
        by_rig[:, :, seen.columns] = by_seen @ seen.by_interface
    by_point = by_seen @ seen.by_point
    if side == RIGHT:
        first = names.index('rotation.x')
        turned = -cross_matrices(local - state.translation)
        by_rig[:, :, first : first + 3] = by_point @ turned + by_seen @ seen.by_rotation
        by_rig[:, :, first + 3 : first + 6] = by_point + by_seen @ seen.by_translation
        by_point = by_point @ state.rotation
    return Projection(pixels, by_point, by_rig)


def project_straight(
    camera: Camera, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) of camera-frame points in air, derivatives by point (N, 2, 3) and by fx, fy,
    cx, cy and the lens's terms (N, 2, 4 + L)."""
    if not len(points):
        return np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros((0, 2, 4 + len(camera.lens)))
    ahead = np.isfinite(points).all(axis=1) & (points[:, 2] > 0)
    safe = np.where(ahead[:, None], points, [0.0, 0.0, 1.0])
    straight = _project_equidistant if camera.model == EQUIDISTANT else _project_brown
    pixels, by_point, by_camera = straight(camera, safe)
    if camera.skew:
        # u is moved by the skew times the lens's own y, which fy and cy leave alone.
        share = camera.skew / camera.focal[1]
        pixels[:, 0] += share * (pixels[:, 1] - camera.centre[1])
        by_point[:, 0] += share * by_point[:, 1]
        by_camera[:, 0, 4:] += share * by_camera[:, 1, 4:]
    return np.where(ahead[:, None], pixels, np.nan), by_point, by_camera


def _project_brown(
    camera: Camera, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    zero = np.zeros(3)
    lens = camera.lens if len(camera.lens) else np.zeros(4)
    pixels, jacobian = cv2.projectPoints(points.reshape(-1, 1, 3), zero, zero, camera.matrix, lens)
    jacobian = jacobian.reshape(len(points), 2, -1)
    by_point, by_camera = jacobian[:, :, 3:6], jacobian[:, :, 6 : 10 + len(camera.lens)]
    return pixels.reshape(-1, 2), by_point, by_camera


def _project_equidistant(
    camera: Camera, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y, depth = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], points[:, 2]
    lens, count = EquidistantLens(camera.lens), len(points)
    xd, yd, *slopes = lens.distort_with_jacobian(x, y)
    by_plane = camera.focal[:, None] * np.stack(slopes, axis=1).reshape(count, 2, 2)
    away = by_plane @ np.stack([x, y], axis=1)[:, :, None]
    by_point = np.concatenate([by_plane, -away], axis=2) / depth[:, None, None]
    by_camera = np.zeros((count, 2, 4 + len(camera.lens)))
    by_camera[:, 0, 0], by_camera[:, 1, 1] = xd, yd
    by_camera[:, 0, 2] = by_camera[:, 1, 3] = 1.0
    by_camera[:, :, 4:] = camera.focal[:, None] * lens.by_terms(x, y)[:, :, : len(camera.lens)]
    return camera.focal * np.stack([xd, yd], axis=1) + camera.centre, by_point, by_camera


@dataclass(frozen=True)
class _Seen:
    """Apparent points in the camera frame, and their derivatives.

    by_rotation and by_translation are those of the camera's pose that act through the interface,
    which stays in the rig frame while the camera moves.
    """

    points: np.ndarray
    by_point: np.ndarray
    by_interface: np.ndarray
    columns: list[int]
    by_rotation: np.ndarray
    by_translation: np.ndarray


def _through_interface(state: RigState, side: int, local: np.ndarray) -> _Seen:
    count = len(local)
    still = np.zeros((count, 3, 3))
    places = places_seen_through(state, side)
    if not places:
        straight = np.broadcast_to(np.eye(3), (count, 3, 3))
        return _Seen(local, straight, np.zeros((count, 3, 0)), [], still, still)
    interface = state.interfaces[places[0]]
    if len(places) > 1 or not isinstance(interface, FlatInterface):
        return _through_all(state, side, places, local)
    (place,) = places
    own = [TARGET_INDEX, *state.names_of(place)]
    columns = [state.names.index(name) for name in own]
    in_rig_frame = place == SHARED and side == RIGHT
    rotation = state.rotation if in_rig_frame else np.eye(3)
    translation = state.translation if in_rig_frame else np.zeros(3)
    normal = rotation @ interface.normal
    distance = interface.distance + float(normal @ translation)
    basis = rotation @ state.bases[place].T
    seen = apparent_points(local, normal, distance, interface.indices, interface.thicknesses)
    by_distance = seen.by_distance[:, :, None]
    by_normal = seen.by_normal + by_distance * translation
    by_interface = np.concatenate(
        [
            seen.by_indices[:, :, -1:],
            by_normal @ basis,
            by_distance,
            seen.by_thicknesses,
            seen.by_indices[:, :, :-1],
        ],
        axis=2,
    )
    by_rotation = by_normal @ -cross_matrices(normal) if in_rig_frame else still
    by_translation = by_distance * normal if in_rig_frame else still
    return _Seen(seen.points, seen.by_point, by_interface, columns, by_rotation, by_translation)


def _through_all(state: RigState, side: int, places: Sequence[str], local: np.ndarray) -> _Seen:
    """Through the camera's own port, of any shape, and a shared surface behind it, at any angle.

    Apparent points are those of the image plane, z = 1.
    """
    rotation = state.rotation if side == RIGHT else np.eye(3)
    translation = state.translation if side == RIGHT else np.zeros(3)
    shared = state.interfaces.get(SHARED)
    assert shared is None or isinstance(shared, FlatInterface)
    (port,) = (state.interfaces[place] for place in places if place != SHARED)
    try:
        surfaces = Surfaces(port, shared, rotation, translation, SIDES[side])
    except OpticsError:
        return _unseen(len(local))
    x, y, z = np.ascontiguousarray(local.T)
    with np.errstate(all='ignore'):
        dx, dy, dz = path_through(surfaces).direction((x, y, z), ARRAYS)
        flat = np.stack([dx / dz, dy / dz, np.ones(len(local))], axis=1)
        by_point, by_named = image_plane_jacobian(surfaces, flat[:, 0], flat[:, 1], local)
    names = surfaces.seeds.names
    own = [name for name in names if name in state.names]
    by_interface = _flat_rows(by_named[:, :, [names.index(name) for name in own]])
    by_rotation, by_translation = (np.zeros((len(local), 3, 3)) for _ in range(2))
    if side == RIGHT and shared is not None:
        # The shared surface stays while the camera turns and moves.
        normal = rotation @ shared.normal
        for i, tangent in enumerate(state.bases[SHARED] @ rotation.T):
            column = by_interface[:, :, own.index(f'{SHARED}.normal.{i}')]
            by_rotation += column[:, :, None] * np.cross(normal, tangent)
        distance = by_interface[:, :, own.index(f'{SHARED}.distance')]
        by_translation = distance[:, :, None] * normal
    columns = [state.names.index(name) for name in own]
    return _Seen(flat, _flat_rows(by_point), by_interface, columns, by_rotation, by_translation)


def _unseen(count: int) -> _Seen:
    """What a camera sees through surfaces that reach through each other: nothing."""
    nothing = np.full((count, 3, 3), np.nan)
    return _Seen(nothing[:, :, 0], nothing, nothing[:, :, :0], [], nothing, nothing)


def _flat_rows(by: np.ndarray) -> np.ndarray:
    """(N, 2, K) of the image plane as (N, 3, K) of points there."""
    return np.concatenate([by, np.zeros_like(by[:, :1])], axis=1)
