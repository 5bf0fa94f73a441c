"""The parameters of a rig as the adjustment sees them: values, names, small changes.

Rotations change by a left factor exp(d), d in radians; a normal changes along the two directions
of `optics.interface.tangents`; everything else adds. The surfaces' parameters bear the names of
`StereoRig.parameter_names`; the index of the cameras' own medium is no parameter, nor is that of
the medium between the ports and a shared surface behind them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.interface import TARGET_INDEX, FlatInterface, Interface, tangents
from binopos_ros.optics.lens import BROWN, EQUIDISTANT
from binopos_ros.optics.rig import StereoRig
from binopos_ros.sides import SIDES

LEFT, RIGHT = 0, 1
LENS_TERMS = {
    BROWN: ('k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'k5', 'k6', 's1', 's2', 's3', 's4', 'tx', 'ty'),
    EQUIDISTANT: ('k1', 'k2', 'k3', 'k4'),
}
#: Of the cameras' own medium.
OWN_MEDIUM = 'indices.0'
SHARED, LEFT_PORT, RIGHT_PORT = 'interface', 'left_port', 'right_port'


@dataclass(frozen=True)
class Camera:
    """focal: (fx, fy) px; centre: (cx, cy) px; lens: the distortion terms of its model.

    The skew (px, K[0, 1]) is no parameter: it stays what it is.
    """

    focal: np.ndarray
    centre: np.ndarray
    lens: np.ndarray
    size: tuple[int, int]
    model: str = BROWN
    skew: float = 0.0

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) K."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, self.skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @classmethod
    def of(cls, camera: PinholeCamera) -> Camera:
        """The parameters of a camera."""
        matrix = np.asarray(camera.matrix)
        return cls(
            matrix[[0, 1], [0, 1]].copy(),
            matrix[:2, 2].copy(),
            np.array(camera.distortion, float).ravel(),
            (int(camera.size[0]), int(camera.size[1])),
            camera.model,
            float(matrix[0, 1]),
        )

    def pinhole(self) -> PinholeCamera:
        """The camera for the other rooms."""
        return PinholeCamera(self.matrix, self.lens, self.size, self.model)


@dataclass(frozen=True)
class RigState:
    """One or two cameras, the pose of the second, and the interfaces they look through.

    Attributes:
        cameras: the left, and where there are two the right.
        rotation, translation: right_from_left, x_right = rotation @ x_left + translation (m).
        interfaces: by place, 'interface' (shared, rig frame), 'left_port', 'right_port' (each in
            its own camera's frame).
    """

    cameras: tuple[Camera, ...]
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    interfaces: dict[str, Interface] = field(default_factory=dict)

    @classmethod
    def of(cls, rig: StereoRig) -> RigState:
        """The parameters of a rig."""
        places = {SHARED: rig.interface, LEFT_PORT: rig.left_port, RIGHT_PORT: rig.right_port}
        return cls(
            (Camera.of(rig.left), Camera.of(rig.right)),
            np.array(rig.rotation, float),
            np.array(rig.translation, float).ravel(),
            {place: interface for place, interface in places.items() if interface is not None},
        )

    def rig(self) -> StereoRig:
        """The rig for the other rooms."""
        left, right = self.cameras
        return StereoRig(
            left.pinhole(),
            right.pinhole(),
            self.rotation,
            self.translation,
            **self.interfaces,  # type: ignore[arg-type]
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters, in the order of `plus` and `minus`."""
        names: list[str] = []
        for side, camera in zip(SIDES, self.cameras, strict=False):
            terms = ('fx', 'fy', 'cx', 'cy', *LENS_TERMS[camera.model][: len(camera.lens)])
            names += [f'{side}.{term}' for term in terms]
        if len(self.cameras) == 2:
            names += [f'rotation.{axis}' for axis in 'xyz']
            names += [f'translation.{axis}' for axis in 'xyz']
        if self.interfaces:
            names += [TARGET_INDEX]
        for place in self.interfaces:
            names += self.names_of(place)
        return tuple(names)

    def names_of(self, place: str) -> list[str]:
        """The names of one interface's own parameters: all but the target's index."""
        names = self.interfaces[place].parameter_names
        return [f'{place}.{name}' for name in names if name != OWN_MEDIUM]

    @cached_property
    def bases(self) -> dict[str, np.ndarray]:
        """By place, the two directions (2, 3) along which a flat one's normal changes."""
        return {
            place: tangents(interface.normal)
            for place, interface in self.interfaces.items()
            if isinstance(interface, FlatInterface)
        }

    @property
    def target_index(self) -> float:
        """The refractive index of the target's medium; 1 without interfaces."""
        return next((self.interfaces[place].target_index for place in self.last_places), 1.0)

    @property
    def last_places(self) -> list[str]:
        """The interfaces behind which the target's medium begins."""
        return [SHARED] if SHARED in self.interfaces else list(self.interfaces)

    def plus(self, change: np.ndarray) -> RigState:
        """The state after a small change of all parameters."""
        rest = list(np.asarray(change, float))

        def take(count: int) -> np.ndarray:
            taken, rest[:count] = rest[:count], []
            return np.array(taken)

        cameras = tuple(
            replace(
                camera,
                focal=camera.focal + take(2),
                centre=camera.centre + take(2),
                lens=camera.lens + take(len(camera.lens)),
            )
            for camera in self.cameras
        )
        rotation, translation = self.rotation, self.translation
        if len(cameras) == 2:
            rotation = exponential(take(3)) @ rotation
            translation = translation + take(3)
        deeper = float(take(1)[0]) if self.interfaces else 0.0
        interfaces = {}
        for place, old in self.interfaces.items():
            own = [name for name in old.parameter_names if name != OWN_MEDIUM]
            changes = dict(zip(own, take(len(own)).tolist(), strict=True))
            if place in self.last_places:
                changes[TARGET_INDEX] = deeper
            interfaces[place] = old.changed(changes)
        return RigState(cameras, rotation, translation, interfaces)

    def minus(self, other: RigState) -> np.ndarray:
        """The small change that leads from `other` here."""
        parts: list[np.ndarray] = []
        for camera, old in zip(self.cameras, other.cameras, strict=True):
            parts += [camera.focal - old.focal, camera.centre - old.centre, camera.lens - old.lens]
        if len(self.cameras) == 2:
            parts += [logarithm(self.rotation @ other.rotation.T)]
            parts += [self.translation - other.translation]
        if self.interfaces:
            parts += [np.array([self.target_index - other.target_index])]
        for place, interface in self.interfaces.items():
            changes = interface.change_since(other.interfaces[place])
            parts += [np.array([d for name, d in changes.items() if name != OWN_MEDIUM])]
        return np.concatenate(parts)


def exponential(vector: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) rad to rotation matrix."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, float))[0], float)


def logarithm(rotation: np.ndarray) -> np.ndarray:
    """Rotation matrix to rotation vector (3,) rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(rotation, float))[0], float).ravel()


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """(..., 3) v to (..., 3, 3) with [v] w = v x w."""
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*x.shape, 3, 3)


def places_seen_through(state: RigState, side: int) -> Sequence[str]:
    """The interfaces in front of a camera; all of them where there is but one."""
    if len(state.cameras) == 1:
        return list(state.interfaces)
    own = LEFT_PORT if side == LEFT else RIGHT_PORT
    return [place for place in state.interfaces if place in (SHARED, own)]
