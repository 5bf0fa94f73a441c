"""Pixels of board points, with the derivatives by every parameter of the rig and the board's pose.

The chain is board -> rig frame -> camera frame -> through the interface -> lens. Rotations are
differentiated by a left factor exp(d) (see `state`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.refracted import apparent_points
from binopos_ros.calibration.state import (
    RIGHT,
    SHARED,
    SIDES,
    TARGET_INDEX,
    Camera,
    RigState,
    cross_matrices,
    places_seen_through,
)


@dataclass(frozen=True)
class Pose:
    """x_rig = rotation @ x_board + translation (m)."""

    rotation: np.ndarray
    translation: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) board points in the rig frame."""
        return points @ self.rotation.T + self.translation


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
    zero = np.zeros(3)
    lens = camera.lens if len(camera.lens) else np.zeros(4)
    pixels, jacobian = cv2.projectPoints(safe.reshape(-1, 1, 3), zero, zero, camera.matrix, lens)
    pixels = np.where(ahead[:, None], pixels.reshape(-1, 2), np.nan)
    jacobian = jacobian.reshape(len(points), 2, -1)
    return pixels, jacobian[:, :, 3:6], jacobian[:, :, 6 : 10 + len(camera.lens)]


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
    if len(places) > 1:
        raise CalibrationError(
            f'the {SIDES[side]} camera looks through {" and ".join(places)}: calibrate either a '
            'shared surface or ports, not both'
        )
    (place,) = places
    interface = state.interfaces[place]
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
