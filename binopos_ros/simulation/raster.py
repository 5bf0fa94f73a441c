"""Boxes of pixels, and grids of rays from which every pixel's ray is interpolated."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Spacing of the rays that tell where the water's surface bends the view, px.
NODE_SPACING = 6


@dataclasses.dataclass(frozen=True)
class Box:
    """A rectangle of pixels: columns left .. right - 1, rows top .. bottom - 1."""

    left: int
    top: int
    right: int
    bottom: int

    def grown(self, margin: int, size: tuple[int, int]) -> Box:
        """The box with a margin, inside an image of size (width, height)."""
        return Box(
            max(self.left - margin, 0),
            max(self.top - margin, 0),
            min(self.right + margin, size[0]),
            min(self.bottom + margin, size[1]),
        )

    def within(self, outer: Box) -> tuple[slice, slice]:
        """Rows and columns of this box in an array that covers the outer one."""
        return (
            slice(self.top - outer.top, self.bottom - outer.top),
            slice(self.left - outer.left, self.right - outer.left),
        )

    @property
    def rows_and_columns(self) -> tuple[slice, slice]:
        """Rows and columns of this box in the whole image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.bottom - self.top, self.right - self.left

    def pixels(self) -> Array:
        """(N, 2) centres of the pixels, row by row."""
        v, u = np.mgrid[self.top : self.bottom, self.left : self.right]
        return np.column_stack([u.ravel(), v.ravel()]).astype(float)


def node_grid(box: Box) -> Array:
    """(R, C, 2) pixels every NODE_SPACING px, with what `interpolate` needs around a box."""
    height, width = box.shape
    columns = np.arange(-2, -(-width // NODE_SPACING) + 4) * NODE_SPACING + box.left
    rows = np.arange(-2, -(-height // NODE_SPACING) + 4) * NODE_SPACING + box.top
    u, v = np.meshgrid(columns, rows)
    return np.stack([u, v], axis=-1).astype(float)


def interpolate(nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values on every pixel from values every NODE_SPACING px, by Lagrange's quintic.

    Args:
        nodes: (R, C), of which two rows and columns before the first pixel and three after the
            last one serve the polynomial alone.

    Returns:
        ((R - 5) NODE_SPACING, (C - 5) NODE_SPACING).
    """
    return _along_rows(np.ascontiguousarray(_along_rows(nodes.T).T))


def _along_rows(nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    intervals = nodes.shape[0] - 5
    values = np.zeros((intervals * NODE_SPACING, nodes.shape[1]), np.float32)
    for phase in range(NODE_SPACING):
        for tap, weight in enumerate(_lagrange_weights(phase / NODE_SPACING)):
            values[phase::NODE_SPACING] += np.float32(weight) * nodes[tap : tap + intervals]
    return values


def _lagrange_weights(place: float) -> Array:
    """Weights of the values at -2 .. 3 for the value at a place between 0 and 1."""
    ticks = np.arange(-2, 4)
    return np.array(
        [
            np.prod([(place - other) / (tick - other) for other in ticks if other != tick])
            for tick in ticks
        ]
    )
