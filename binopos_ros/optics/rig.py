"""A stereo rig that looks through interfaces and ports into another medium (Eq. 4-5, 8-12)."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import ARRAYS, FLOATS, NoRayError
from binopos_ros.optics.batches import in_blocks
from binopos_ros.optics.camera import PinholeCamera, components
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import TARGET_INDEX, FlatInterface, Interface
from binopos_ros.optics.rig_folder import parts_in
from binopos_ros.optics.view import View

FloatArray = NDArray[np.float64]

FEW = 16
"""So many points are projected faster one by one, on floats, than together in arrays."""


class Jacobians(NamedTuple):
    """How both cameras' pixels answer to the point and to the target medium's index.

    Attributes:
        left: (N, 2) px.
        right: (N, 2) px.
        left_by_point: (N, 2, 3) px/m, rig frame.
        right_by_point: (N, 2, 3) px/m.
        left_by_index: (N, 2) px per unit of the target medium's index.
        right_by_index: (N, 2).

    """

    left: FloatArray
    right: FloatArray
    left_by_point: FloatArray
    right_by_point: FloatArray
    left_by_index: FloatArray
    right_by_index: FloatArray


class StereoRig:
    """Two cameras, and what lies between them and the target.

    The rig frame is the left camera's optical frame.

    Args:
        left: the left camera.
        right: the right camera.
        rotation: (3, 3) and
        translation: (3,) m, so that x_right = rotation @ x_left + translation.
        interface: a surface both look through, in the rig frame.
        left_port: the left camera's own port, flat or a dome, in its frame; in front of the
            interface, if any.
        right_port: the right camera's own port, in its frame.

    Raises:
        OpticsError: the parts do not fit together.

    """

    def __init__(
        self,
        left: PinholeCamera,
        right: PinholeCamera,
        rotation: ArrayLike,
        translation: ArrayLike,
        interface: FlatInterface | None = None,
        left_port: Interface | None = None,
        right_port: Interface | None = None,
    ) -> None:
        self.left, self.right = left, right
        _refuse_shared_dome(interface)
        self.rotation = _rotation(rotation)
        self.translation = _baseline(translation)
        self.interface, self.left_port, self.right_port = interface, left_port, right_port
        self.left_view = View(left, np.eye(3), np.zeros(3), left_port, interface, 'left')
        self.right_view = View(
            right, self.rotation, self.translation, right_port, interface, 'right'
        )
        ends = {view.surfaces.indices[-1] for view in self.views if view.surfaces.indices}
        if len(ends) > 1:
            msg = (
                f'the ports end in different media, of indices {sorted(ends)}; the target has one'
            )
            raise OpticsError(msg)
        self.target_index = ends.pop() if ends else None

    @classmethod
    def load(cls, folder: str | PathLike[str]) -> StereoRig:
        """The rig of a folder that `binopos calibrate` or a recording has left.

        Args:
            folder: with left.yaml and right.yaml (camera_info), and with rig.yaml, interface.yaml
                or binopos.yaml, the first of which says what the cameras look through; without
                one, nothing.

        Raises:
            OpticsError: a file is missing, or cannot be used.

        """
        return cls(*parts_in(Path(folder)))

    def __repr__(self) -> str:
        places = ('interface', 'left_port', 'right_port')
        surfaces = [
            f'{place}={each!r}' for place in places if (each := getattr(self, place)) is not None
        ]
        baseline = float(np.linalg.norm(self.translation))
        parts = [f'baseline={baseline:.4g} m', f'left={self.left!r}', f'right={self.right!r}']
        return f'StereoRig({", ".join(parts + surfaces)})'

    @property
    def views(self) -> tuple[View, View]:
        """The left and the right camera with their surfaces."""
        return self.left_view, self.right_view

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The surfaces' parameters, in the order of `parameter_jacobian` and `perturbed`.

        'target_index' first; then per interface its own: of a flat one normal.0 and normal.1 (rad,
        along the two directions of `interface.tangents`), distance and thicknesses.i (m),
        indices.i; of a dome centre.0 to centre.2, radius and thicknesses.0 (m), indices.i. A
        medium that two interfaces share is named once, as the farther one's.
        """
        left, right = (view.surfaces.seeds.names for view in self.views)
        return tuple(dict.fromkeys(left + right))

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Project points of the rig frame along the bent rays.

        Args:
            points: (N, 3) or (3,), m.

        Returns:
            Left and right pixels, (N, 2) or (2,) each; nan where no ray exists (`explain` says
            why). A pixel may lie outside the image.

        """
        points = components(points, 3, 'points')
        rows = points.reshape(-1, 3)
        pixels = self._projected_singly(rows) if len(rows) <= FEW else None
        if pixels is None:
            pixels = self._projected(rows)
        pixels[np.isnan(pixels).any(axis=2)] = np.nan
        left, right = pixels.reshape(2, *points.shape[:-1], 2)
        return left, right

    def _projected(self, rows: FloatArray) -> FloatArray:
        pixels = np.empty((2, len(rows), 2))

        def work(block: slice) -> None:
            point = _columns(rows[block])
            with np.errstate(all='ignore'):
                for out, view in zip(pixels, self.views, strict=True):
                    out[block, 0], out[block, 1] = view.pixel(point, ARRAYS)

        in_blocks(work, len(rows))
        return pixels

    def _projected_singly(self, rows: FloatArray) -> FloatArray | None:
        """The same digits on floats; None where arithmetic ends, which arrays carry on as inf."""
        if not np.isfinite(rows).all():
            return None
        pixels = np.full((2, len(rows), 2), np.nan)
        for out, view in zip(pixels, self.views, strict=True):
            for k, point in enumerate(rows.tolist()):
                try:
                    out[k] = view.pixel(point, FLOATS)
                except NoRayError:
                    continue
                except (ArithmeticError, ValueError):
                    return None
        return pixels

    def explain(self, points: ArrayLike) -> NDArray[np.object_]:
        """Return, for each point, why `project` gives nan; '' where both cameras see it.

        Args:
            points: (N, 3) or (3,), m.

        Returns:
            (N,) of str.

        """
        rows = components(points, 3, 'points').reshape(-1, 3)
        reasons = (self.left_view.reason(row) or self.right_view.reason(row) for row in rows)
        return np.fromiter(reasons, dtype=object, count=len(rows))

    def back_project(
        self, left_px: ArrayLike, right_px: ArrayLike
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        """Trace pixels back along the bent rays into the target's medium.

        Args:
            left_px: (N, 2) or (2,).
            right_px: (N, 2) or (2,).

        Returns:
            For each camera the points (N, 3), m, where the rays leave the last surface (the
            camera's centre, where there is none), and their unit directions (N, 3) from there; rig
            frame, nan where a ray is totally reflected or does not exist.

        """
        left, right = components(left_px, 2, 'left_px'), components(right_px, 2, 'right_px')
        return _rays(self.left_view, left), _rays(self.right_view, right)

    def differentiate(self, points: ArrayLike) -> Jacobians:
        """Project points and differentiate their pixels, analytically.

        Args:
            points: (N, 3), m.

        """
        rows = components(points, 3, 'points').reshape(-1, 3)
        count = len(rows)
        pixels, by_point = np.empty((2, count, 2)), np.empty((2, count, 2, 3))
        by_index = np.empty((2, count, 2))

        def work(block: slice) -> None:
            point = _columns(rows[block])
            with np.errstate(all='ignore'):
                for i, view in enumerate(self.views):
                    sight = view.sight(point, ARRAYS)
                    pixels[i, block, 0], pixels[i, block, 1] = sight.u, sight.v
                    for j in range(3):
                        by_point[i, block, 0, j] = sight.u_by_point[j]
                        by_point[i, block, 1, j] = sight.v_by_point[j]
                    by_index[i, block, 0] = sight.u_by_index
                    by_index[i, block, 1] = sight.v_by_index

        in_blocks(work, count)
        lost = np.isnan(pixels).any(axis=2)
        for out in (pixels, by_point, by_index):
            out[lost] = np.nan
        return Jacobians(*pixels, *by_point, *by_index)

    def parameter_jacobian(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Differentiate the pixels with respect to the surfaces' parameters, analytically.

        Args:
            points: (N, 3), m.

        Returns:
            Left and right, (N, 2, K) each, in px per rad, m or unit of index, in the order of
            `parameter_names`; nan where no ray exists.

        """
        rows = components(points, 3, 'points').reshape(-1, 3)
        names = self.parameter_names
        both = np.zeros((2, len(rows), 2, len(names)))
        with np.errstate(all='ignore'):
            for out, view in zip(both, self.views, strict=True):
                own = [names.index(name) for name in view.surfaces.seeds.names]
                out[:, :, own] = view.parameter_jacobian(rows)
        return both[0], both[1]

    def perturbed(self, change: ArrayLike) -> StereoRig:
        """Return the rig with its surfaces' parameters changed.

        Args:
            change: (K,) to be added, in the order of `parameter_names`.

        Raises:
            OpticsError: the changed surfaces cannot exist.

        """
        values = np.asarray(change, dtype=float)
        names = self.parameter_names
        if values.shape != (len(names),):
            msg = f'the change must hold {len(names)} numbers ({", ".join(names)})'
            raise OpticsError(msg)
        by_name = dict(zip(names, values.tolist(), strict=True))
        beyond_port = TARGET_INDEX if self.interface is None else 'interface.indices.0'
        surfaces = {
            label: surface.changed(_own_changes(surface, label, beyond, by_name))
            for label, surface, beyond in (
                ('interface', self.interface, TARGET_INDEX),
                ('left_port', self.left_port, beyond_port),
                ('right_port', self.right_port, beyond_port),
            )
            if surface is not None
        }
        return StereoRig(self.left, self.right, self.rotation, self.translation, **surfaces)  # type: ignore[arg-type]

    def with_target_index(self, index: float) -> StereoRig:
        """Return the rig with another refractive index of the target's medium.

        Raises:
            OpticsError: the rig has no surface, or the index is impossible.

        """
        if self.target_index is None:
            msg = 'this rig looks through no surface, so it has no target medium of its own'
            raise OpticsError(msg)
        # A live estimate asks for this often: what does not depend on the index is kept.
        rig = type(self).__new__(type(self))
        rig.left, rig.right = self.left, self.right
        rig.rotation, rig.translation = self.rotation, self.translation
        if self.interface is not None:
            rig.interface = self.interface.with_target_index(index)
            rig.left_port, rig.right_port = self.left_port, self.right_port
        else:
            rig.interface = None
            rig.left_port, rig.right_port = (
                port and port.with_target_index(index)
                for port in (self.left_port, self.right_port)
            )
        rig.left_view = self.left_view.with_target_index(index)
        rig.right_view = self.right_view.with_target_index(index)
        rig.target_index = index
        return rig


def _own_changes(
    surface: Interface, label: str, beyond: str, by_name: dict[str, float]
) -> dict[str, float]:
    """Return the changes of one surface under its own names; `beyond` is its last medium's."""
    own = {name: by_name[f'{label}.{name}'] for name in surface.parameter_names}
    return own | {TARGET_INDEX: by_name[beyond]}


def _refuse_shared_dome(interface: FlatInterface | None) -> None:
    if interface is not None and not isinstance(interface, FlatInterface):
        msg = 'a dome belongs to one camera: give it as left_port or right_port, not as interface'
        raise OpticsError(msg)


def _rays(view: View, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    with np.errstate(all='ignore'):
        start, direction = view.ray(pixels[..., 0], pixels[..., 1], ARRAYS)
    starts, directions = np.stack(start, axis=-1), np.stack(direction, axis=-1)
    lost = np.isnan(starts).any(axis=-1) | np.isnan(directions).any(axis=-1)
    starts[lost], directions[lost] = np.nan, np.nan
    return starts, directions


def _columns(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y, z = np.ascontiguousarray(rows.T)
    return x, y, z


def _rotation(rotation: ArrayLike) -> FloatArray:
    matrix = np.array(rotation, dtype=float)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        msg = f'the rotation must be 3x3 finite numbers, not of shape {matrix.shape}'
        raise OpticsError(msg)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0.0:
        msg = 'the rotation is not one: R R^T must be the identity and det R = 1 (to 1e-6)'
        raise OpticsError(msg)
    matrix.flags.writeable = False
    return matrix


def _baseline(translation: ArrayLike) -> FloatArray:
    vector = np.array(translation, dtype=float).ravel()
    if vector.shape != (3,) or not np.isfinite(vector).all():
        msg = f'the translation must be three finite numbers, m, not {translation!r}'
        raise OpticsError(msg)
    if not vector.any():
        msg = 'the translation is zero: both cameras stand in one place, so there is no depth'
        raise OpticsError(msg)
    vector.flags.writeable = False
    return vector
