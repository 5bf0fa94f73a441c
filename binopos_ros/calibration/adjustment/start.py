"""First guesses: Zhang's closed form for a camera, planar poses for boards.

Z. Zhang, A Flexible New Technique for Camera Calibration, IEEE PAMI 22, 2000. OpenCV's
implementation gives the focal length from the views' homographies; lens and centre start at zero
and the middle, and the adjustment does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import FlatInterface
from binopos_ros.optics.rig_state import LEFT, RIGHT, Camera, RigState

FEWEST_POINTS = 4


def guess_camera(views: Sequence[View], side: int, size: tuple[int, int], terms: int) -> Camera:
    """A camera without distortion, good enough to start from.

    Args:
        views: of planar boards (z = 0 in the board frame).
        side: whose pixels.
        size: image width and height (px).
        terms: how many distortion terms the camera will have.
    """
    points, pixels = [], []
    for view in views:
        seen = np.isfinite(view.pixels[side]).all(axis=1)
        if seen.sum() >= FEWEST_POINTS:
            points.append(view.points[seen].astype(np.float32))
            pixels.append(view.pixels[side][seen].astype(np.float32).reshape(-1, 1, 2))
    width, height = size
    focal = float('nan')
    if points:
        matrix = cv2.initCameraMatrix2D(points, pixels, size, aspectRatio=1.0)
        focal = float(matrix[0, 0])
    # Views that hardly tilt give anything at all; fields of view lie between 10 and 150 degrees.
    if not np.isfinite(focal) or not 0.13 * width < focal < 6.0 * width:
        focal = float(width)
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    return Camera(np.array([focal, focal]), centre, np.zeros(terms), size)


def guess_pose(camera: Camera, points: np.ndarray, pixels: np.ndarray) -> Pose | None:
    """The board's pose in the camera frame from one straight view, or None if there is none.

    Args:
        points: (N, 3) board frame (m); pixels: (N, 2), nan where not seen.
    """
    seen, plane = _image_plane(camera, pixels)
    if seen.sum() < FEWEST_POINTS:
        return None
    planar = np.ptp(points[seen][:, 2]) < 1e-12
    method = cv2.SOLVEPNP_IPPE if planar else cv2.SOLVEPNP_ITERATIVE
    origin = points[seen].mean(axis=0)
    found, rotation, translation = cv2.solvePnP(
        points[seen] - origin, plane, np.eye(3), np.zeros(4), flags=method
    )
    if not found or not np.isfinite(translation).all() or translation[2, 0] <= 0:
        return None
    matrix = np.asarray(cv2.Rodrigues(rotation)[0])
    return Pose(matrix, translation.ravel() - matrix @ origin)


def other_pose(camera: Camera, points: np.ndarray, pixels: np.ndarray) -> Pose | None:
    """The second pose in which a planar board looks nearly the same, or None."""
    seen, plane = _image_plane(camera, pixels)
    if seen.sum() < FEWEST_POINTS or np.ptp(points[seen][:, 2]) > 0:
        return None
    origin = points[seen].mean(axis=0)
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        points[seen] - origin, plane, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    if len(rotations) < 2 or translations[1][2, 0] <= 0:
        return None
    matrix = np.asarray(cv2.Rodrigues(rotations[1])[0])
    return Pose(matrix, translations[1].ravel() - matrix @ origin)


def _image_plane(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) which pixels have a ray, and the image-plane coordinates of those.

    OpenCV's own inverse of a lens stops after five rounds, far off in the corners of a wide one.
    """
    rays = camera.pinhole().unproject(pixels)
    seen = np.asarray(np.isfinite(rays).all(axis=1))
    return seen, np.ascontiguousarray(rays[seen, :2] / rays[seen, 2:])


def straight_poses(air: RigState, views: Sequence[View]) -> list[Pose]:
    """Board poses in the rig frame as if there were no interface."""
    poses = []
    for view in views:
        pose = _straight_pose(air.cameras[LEFT], view, LEFT)
        if pose is None and len(air.cameras) == 2:
            pose = _straight_pose(air.cameras[RIGHT], view, RIGHT)
            if pose is not None:
                back = air.rotation.T
                pose = Pose(back @ pose.rotation, back @ (pose.translation - air.translation))
        if pose is None:
            raise CalibrationError(f'{view.name}: the points seen give no pose of the target')
        poses.append(pose)
    return poses


def _straight_pose(camera: Camera, view: View, side: int) -> Pose | None:
    if view.turns:
        return guess_pose(camera, view.points, view.pixels[side])
    seen = np.isfinite(view.pixels[side]).any(axis=1)
    if seen.sum() < 3:
        return None
    # A ball's outline: where it is, and from its width how far.
    middle = np.nanmean(view.pixels[side][seen], axis=0)
    reach = np.nanmean(np.abs(view.pixels[side][seen] - middle)) / camera.focal[0]
    radius = np.linalg.norm(view.points[seen], axis=1).mean()
    return Pose(np.eye(3), camera.pinhole().unproject(middle) * radius / reach)


def sunk(pose: Pose, view: View, state: RigState) -> Pose:
    """Push a board to the depth at which it would look as near as it does, and behind the
    interface. A dome shows it about where it is."""
    interface = state.interfaces[state.last_places[0]]
    if not isinstance(interface, FlatInterface):
        return pose
    normal = np.asarray(interface.normal)
    ratio = interface.indices[-1] / interface.indices[0]
    surface = interface.distance + sum(interface.thicknesses)
    height = pose.apply(view.points) @ normal
    middle = float(height.mean())
    target = surface + max(middle - surface, 0.0) * ratio
    shortfall = surface + 0.02 * middle - (target - middle + float(height.min()))
    return Pose(pose.rotation, pose.translation + (target - middle + max(shortfall, 0.0)) * normal)
