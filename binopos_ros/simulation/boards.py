"""Calibration boards as targets: what is printed on them, and where they are held."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.simulation.backdrop import Backdrop
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.view import View

Array = NDArray[np.float64]

#: Texels of the print per square of the board, and the white margin around it in squares.
TEXELS = 48
MARGIN = 1.0
BLACK, WHITE = 0.05, 0.85

WIDEST_TILT = np.deg2rad(45.0)
#: Steepest angle of sight at which a board is shown: corner finders give up beyond.
WIDEST_SIGHT = np.deg2rad(60.0)
TRIES = 4000


class Board(Protocol):
    """A planar board, as `calibration` describes them; prints as the words that it is called."""

    @property
    def square(self) -> float:
        """The side of a square, m."""

    @property
    def points(self) -> Array:
        """(N, 3) in the board's frame: origin in the first point, z away from the viewer, m."""

    def print(self, texels: int) -> tuple[Array, Array]:
        """The share of ink per texel, and the board coordinates (m) of its upper left corner."""


@dataclasses.dataclass(frozen=True)
class ShownBoard:
    """A board that is held somewhere else in every picture, or in every so many.

    Attributes:
        board: what it is; its frame has the origin in the first point, z away from the viewer.
        print: (H, W) reflectance of the whole sheet.
        corner: (2,) board coordinates of the sheet's upper left corner, m.
        positions: (N, 3) of the board's origin, rig frame, m.
        rotations: (N, 3, 3) rig_from_board.
        rate: pictures per second.
        stays: for how many pictures it stays at a place.
    """

    board: Board
    print: NDArray[np.float32]
    corner: Array
    positions: Array
    rotations: Array
    rate: float
    stays: int = 1

    @property
    def texel(self) -> float:
        """Side of a texel of the print, m."""
        return self.board.square / TEXELS

    def number(self, time: float) -> int:
        """Which of the places the board is at."""
        return min(round(time * self.rate) // self.stays, len(self.positions) - 1)

    def poses(self, times: ArrayLike) -> tuple[Array, Array]:
        """(N,) s to (N, 3) positions of the board's origin, m, and (N, 3) normals of its face."""
        chosen = [self.number(float(time)) for time in np.atleast_1d(np.asarray(times, float))]
        return self.positions[chosen], -self.rotations[chosen][:, :, 2]

    def points(self, time: float) -> Array:
        """(M, 3) the board's points at a time (s), rig frame, m."""
        number = self.number(time)
        return self.positions[number] + self.board.points @ self.rotations[number].T


def printed(board: Board) -> tuple[NDArray[np.float32], Array]:
    """The sheet with a board on it, and the board coordinates (m) of its upper left corner."""
    ink, corner = board.print(TEXELS)
    pattern = WHITE + (BLACK - WHITE) * ink
    sheet = np.pad(pattern, round(MARGIN * TEXELS), constant_values=WHITE).astype(np.float32)
    return sheet, corner - MARGIN * board.square


def scatter(
    board: Board,
    views: tuple[View, View],
    backdrop: Backdrop,
    count: int,
    reach: tuple[float, float],
    rate: float,
    rng: np.random.Generator,
    stays: int = 1,
) -> ShownBoard:
    """Hold a board at random places and tilts, each with all its points in both pictures.

    Places are spread evenly over the picture, tilts over 0 to 45 degrees.

    Args:
        board: what to show.
        views: the left and the right camera.
        backdrop: what the board must not poke into.
        count: how many places.
        reach: nearest and farthest distance from the left camera along its axis, m.
        rate: pictures per second.
        rng: where places and tilts are drawn from.
        stays: for how many pictures it stays at a place.

    Raises:
        SimulationError: the board does not fit into both pictures.
    """
    sheet, corner = printed(board)
    middle = board.points.mean(axis=0)
    outline = _outline(sheet, corner, board.square / TEXELS)
    positions: list[Array] = []
    rotations: list[Any] = []
    for _ in range(TRIES):
        if len(positions) == count:
            break
        rotation = _random_rotation(rng)
        pixel = rng.uniform(0, 1, 2) * views[0].lens.size
        depth = rng.uniform(*reach)
        ray = views[0].directions(pixel[None, :])[0]
        position = ray * depth / ray[2] - rotation @ middle
        held = position + outline @ rotation.T
        if backdrop.holds(held) and all(_is_seen(view, held, rotation) for view in views):
            positions.append(position)
            rotations.append(rotation)
    if len(positions) < count:
        msg = (
            f'the {board} fits into both pictures at {len(positions)} of {TRIES} random places: '
            'give a smaller board'
        )
        raise SimulationError(msg)
    return ShownBoard(board, sheet, corner, np.array(positions), np.array(rotations), rate, stays)


def _outline(sheet: NDArray[np.float32], corner: Array, texel: float) -> Array:
    """(8, 3) corners and mid-edges of the sheet in the board frame, m."""
    height, width = sheet.shape
    shares = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]) / 2
    places = corner + shares * texel * np.array([width, height])
    return np.column_stack([places, np.zeros(len(places))])


def _random_rotation(rng: np.random.Generator) -> Array:
    """A turn in the board's plane, then a tilt about an axis in it."""
    roll = rng.uniform(-0.4, 0.4)
    turn = np.array(
        [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]]
    )
    tilt, heading = rng.uniform(0, WIDEST_TILT), rng.uniform(0, 2 * np.pi)
    x, y = np.cos(heading), np.sin(heading)
    cross = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
    return (np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross) @ turn


def _is_seen(view: View, outline: Array, rotation: Array) -> bool:
    pixels = view.apparent(outline, 0.0)
    width, height = view.lens.size
    inside = (pixels > 2) & (pixels < [width - 3, height - 3])
    sight = outline - view.centre
    cosine = (sight @ rotation[:, 2]) / np.linalg.norm(sight, axis=1)
    return bool(inside.all() and cosine.min() > np.cos(WIDEST_SIGHT))
