"""The lenses there are, by name, and what a camera asks of one.

A lens moves ideal image-plane coordinates (x, y) = (X / Z, Y / Z) to where it puts them, in units
of the focal length; so it ends at 90 degrees off the axis, where they do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import Arithmetic, Component
from binopos_ros.optics.distortion import Distortion
from binopos_ros.optics.equidistant import EquidistantLens

BROWN, EQUIDISTANT = Distortion.model, EquidistantLens.model


class Lens(Protocol):
    """What a camera asks of its lens.

    Attributes:
        model: its name in `LENSES`.
        behind: why there is no pixel of what lies 90 degrees or more off the axis.
        coefficients: its terms.
        fold_radius_squared: where the lens's field ends on the image plane, inf where never.

    """

    model: str
    behind: str
    coefficients: NDArray[np.float64]
    fold_radius_squared: float

    def distort(
        self, x: Component, y: Component, arithmetic: Arithmetic, /
    ) -> tuple[Component, Component]:
        """Move ideal image-plane coordinates to where the lens puts them."""

    def distort_with_jacobian(
        self, x: Component, y: Component, arithmetic: Arithmetic, /
    ) -> tuple[Component, Component, Component, Component, Component, Component]:
        """Return xd, yd, and d(xd)/dx, d(xd)/dy, d(yd)/dx, d(yd)/dy."""

    def within_fold(self, x: Component, y: Component) -> Component:
        """Tell where the lens is one-to-one."""

    def undistort(
        self, xd: Component, yd: Component, arithmetic: Arithmetic, /
    ) -> tuple[Component, Component]:
        """Invert `distort` to rounding; nan where nothing images there."""


LENSES: dict[str, Callable[[ArrayLike], Lens]] = {
    BROWN: Distortion,
    EQUIDISTANT: EquidistantLens,
}
