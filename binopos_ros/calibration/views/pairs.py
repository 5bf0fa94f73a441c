"""Views of a board: gathering them, and choosing the ones worth computing with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView
from binopos_ros.calibration.views.view import View

CELLS = (8, 6)  # of the coverage map, columns and rows
BLURRED = 2.0  # times the median rise of the edges
LEAST_BLUR = 3.5  # px; a rise below this is sharp enough whatever the others are
REPEATED = 1.0  # px; corners that lie nearer err alike: the finder's grid, the lens, the board


@dataclass(frozen=True)
class Dropped:
    """A view that is not used, and why."""

    name: str
    reason: str

    def __str__(self) -> str:
        return f'{self.name}: {self.reason}'


@dataclass(frozen=True)
class BoardPair:
    """What both cameras found in one pair of pictures; None where no board was found."""

    name: str
    left: BoardView | None
    right: BoardView | None

    @property
    def sides(self) -> tuple[BoardView | None, BoardView | None]:
        """Left and right."""
        return self.left, self.right

    @property
    def complete(self) -> bool:
        """Whether both cameras found the board."""
        return self.left is not None and self.right is not None

    def view(self, board: Board) -> View:
        """The pair for the adjustment."""
        return View(self.name, board.points, tuple(_whole(side, board) for side in self.sides))


def _whole(found: BoardView | None, board: Board) -> np.ndarray:
    pixels = np.full((len(board.points), 2), np.nan)
    if found is not None:
        pixels[found.indices] = found.pixels
    return pixels


def drop_blurred(pairs: Sequence[BoardPair]) -> tuple[list[BoardPair], list[Dropped]]:
    """Part the pairs whose edges are much softer than the others' from the rest."""
    rises = np.array(
        [max((v.sharpness for v in pair.sides if v is not None), default=np.nan) for pair in pairs]
    )
    if not np.isfinite(rises).any():
        return list(pairs), []
    limit = max(LEAST_BLUR, BLURRED * float(np.nanmedian(rises)))
    kept, dropped = [], []
    for pair, rise in zip(pairs, rises, strict=True):
        if rise > limit:
            dropped.append(
                Dropped(
                    pair.name,
                    f'blurred: edges rise over {rise:.1f} px, in the others over '
                    f'{np.nanmedian(rises):.1f} px; hold the board still',
                )
            )
        else:
            kept.append(pair)
    return kept, dropped


def repeats(views: Sequence[View]) -> dict[int, Dropped]:
    """The places of views that show the board where an earlier one has shown it.

    Pictures of a resting board average the noise away, but not what all of them have in common:
    counted as many they would claim what one does not know.
    """
    kept: list[View] = []
    found = {}
    for i, view in enumerate(views):
        first = next((one for one in kept if _alike(one, view)), None)
        if first is None:
            kept.append(view)
        else:
            reason = f'repeats {first.name}: the board had not moved, it counts once'
            found[i] = Dropped(view.name, reason)
    return found


def _alike(one: View, other: View) -> bool:
    for own, theirs in zip(one.pixels, other.pixels, strict=True):
        if own.shape != theirs.shape:
            return False
        apart = np.linalg.norm(own - theirs, axis=1)
        apart = apart[np.isfinite(apart)]
        if not len(apart) or apart.mean() > REPEATED:
            return False
    return True


def coverage(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(rows, columns) of `CELLS`: how many points fall into each cell of the picture."""
    seen = pixels[np.isfinite(pixels).all(axis=1)]
    columns, rows = CELLS
    column = np.clip((seen[:, 0] * columns / size[0]).astype(int), 0, columns - 1)
    row = np.clip((seen[:, 1] * rows / size[1]).astype(int), 0, rows - 1)
    counts = np.zeros((rows, columns), int)
    np.add.at(counts, (row, column), 1)
    return counts


def foreshortening(pixels: np.ndarray, board: Board) -> np.ndarray:
    """(3,) how a board is seen: two tilt components and the logarithm of its scale.

    The tilt comes from the affine part of the homography: no camera is needed to compare views.
    """
    seen = np.isfinite(pixels).all(axis=1)
    homography, _ = cv2.findHomography(board.points[seen, :2], pixels[seen])
    if homography is None:
        return np.zeros(3)
    centre = board.points[seen, :2].mean(axis=0)
    weight = homography[2] @ [*centre, 1.0]
    seen_centre = homography[:2] @ [*centre, 1.0] / weight
    affine = (homography[:2, :2] - np.outer(seen_centre, homography[2, :2])) / weight
    stretch = affine.T @ affine
    mean = 0.5 * np.trace(stretch)
    return np.array(
        [
            (stretch[0, 0] - stretch[1, 1]) / (2 * mean),
            stretch[0, 1] / mean,
            0.5 * np.log(max(mean, 1e-12)),
        ]
    )


def select(
    pairs: Sequence[BoardPair],
    board: Board,
    sizes: tuple[tuple[int, int], tuple[int, int]],
    most: int,
) -> tuple[list[BoardPair], list[Dropped]]:
    """Choose at most `most` pairs: new parts of both pictures first, other tilts and distances
    next, sharp before soft.

    Each step takes the pair that adds most: cells that still have fewer than ten points, and the
    distance in (tilt, tilt, log scale) from the nearest pair already chosen.
    """
    if len(pairs) <= most:
        return list(pairs), []
    maps = np.array(
        [
            [
                coverage(_whole(found, board), size)
                for found, size in zip(pair.sides, sizes, strict=True)
            ]
            for pair in pairs
        ]
    )
    looks = np.array(
        [
            foreshortening(_whole(next(v for v in pair.sides if v is not None), board), board)
            for pair in pairs
        ]
    )
    rises = np.array(
        [
            np.nanmax([v.sharpness if v is not None else np.nan for v in pair.sides] + [0.0])
            for pair in pairs
        ]
    )
    softest = max(float(rises.max()), 1e-6)
    chosen: list[int] = []
    total = np.zeros(maps.shape[1:])
    nearest = np.full(len(pairs), 2.0)
    while len(chosen) < most:
        gain = np.array([np.minimum(total + m, 10.0).sum() for m in maps])
        gain = (gain - np.minimum(total, 10.0).sum()) / len(board.points)
        score = gain + np.minimum(nearest, 2.0) - 0.3 * rises / softest
        score[chosen] = -np.inf
        best = int(np.argmax(score))
        chosen.append(best)
        total += maps[best]
        nearest = np.minimum(nearest, np.linalg.norm(looks - looks[best], axis=1))
    kept = [pairs[i] for i in sorted(chosen)]
    spare = [
        Dropped(pair.name, f'not needed: {most} other views cover the same')
        for i, pair in enumerate(pairs)
        if i not in set(chosen)
    ]
    return kept, spare
