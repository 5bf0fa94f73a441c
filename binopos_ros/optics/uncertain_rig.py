"""A rig whose cameras are uncertain, too: the calibration's whole covariance for a position.

`StereoRig` names the parameters of its surfaces alone. This one adds the cameras' intrinsics and
their mutual pose, so that whatever takes a covariance in the order of `parameter_names` (as
`triangulate` and the live estimate of the index do) carries on that of the whole calibration.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.rig import StereoRig
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState


class UncertainRig(StereoRig):
    """A `StereoRig` with the parameters of its surfaces first, its cameras' after them.

    The cameras' bear the names of `RigState`: 'left.fx' .. 'right.k3' (px, and lens terms),
    'rotation.x' .. (rad) and 'translation.x' .. (m) of right_from_left.
    """

    @cached_property
    def _state(self) -> RigState:
        return RigState.of(self)

    @cached_property
    def _surfaces(self) -> tuple[str, ...]:
        return super().parameter_names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self._surfaces, *self._state.names)))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The surfaces' parameters (`StereoRig.parameter_names`), then the cameras'."""
        return self._names

    def parameter_jacobian(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Differentiate the pixels with respect to all parameters, analytically.

        Args:
            points: (N, 3), m.

        Returns:
            Left and right, (N, 2, K) each, in the order of `parameter_names`; nan without a ray.
        """
        rows = np.asarray(points, float).reshape(-1, 3)
        names, state = self._names, self._state
        cameras = [names.index(name) for name in names[len(self._surfaces) :]]
        own = [state.names.index(names[i]) for i in cameras]
        left, right = super().parameter_jacobian(rows)
        for side, jacobian in ((LEFT, left), (RIGHT, right)):
            jacobian[:, :, cameras] = project(state, side, rows).by_rig[:, :, own]
        return left, right

    def perturbed(self, change: ArrayLike) -> UncertainRig:
        """Return the rig with its parameters changed.

        Args:
            change: (K,) to be added, in the order of `parameter_names`.

        Raises:
            OpticsError: the changed rig cannot exist.
        """
        values = np.asarray(change, float)
        names = self._names
        if values.shape != (len(names),):
            msg = f'the change must hold {len(names)} numbers ({", ".join(names)})'
            raise OpticsError(msg)
        by_name = dict(zip(names, values.tolist(), strict=True))
        plain = StereoRig(
            self.left,
            self.right,
            self.rotation,
            self.translation,
            self.interface,
            self.left_port,
            self.right_port,
        ).perturbed([by_name.pop(name) for name in self._surfaces])
        state = RigState.of(plain)
        moved = state.plus(np.array([by_name.get(name, 0.0) for name in state.names]))
        left, right = moved.cameras
        return UncertainRig(
            left.pinhole(),
            right.pinhole(),
            moved.rotation,
            moved.translation,
            plain.interface,
            plain.left_port,
            plain.right_port,
        )
