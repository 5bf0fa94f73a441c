"""From pictures to views: every pair searched for the board, on all cores."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView, find_board
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.calibration.views.sources import PicturePair
from binopos_ros.sides import SIDES

Size = tuple[int, int]
Tick = Callable[[], None]


def find_boards(
    pictures: Sequence[PicturePair],
    board: Board,
    window: int | None = None,
    tick: Tick = lambda: None,
) -> tuple[list[BoardPair], tuple[Size, Size]]:
    """Search every pair for the board.

    Args:
        pictures: the pairs.
        board: what to look for.
        window: half-width of the corners' refinement (px); None chooses it per picture.
        tick: called when a pair is done.

    Returns:
        What was found, pair by pair, and the sizes of the left and the right pictures.

    Raises:
        CalibrationError: pictures of mixed sizes, or mirrored ChArUco boards.
    """

    def search(pair: PicturePair) -> tuple[BoardPair, tuple[Size, Size]]:
        found: list[BoardView | None] = []
        sizes: list[Size] = []
        for side, load in zip(SIDES, (pair.left, pair.right), strict=True):
            image = load()
            try:
                found.append(find_board(image, board, window))
            except CalibrationError as error:
                raise CalibrationError(f'{pair.name}, {side}: {error}') from None
            sizes.append((image.shape[1], image.shape[0]))
        tick()
        return BoardPair(pair.name, found[0], found[1]), (sizes[0], sizes[1])

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        results = list(pool.map(search, pictures))
    pairs = [pair for pair, _ in results]
    return pairs, _one_size([sizes for _, sizes in results], pictures)


def _one_size(
    sizes: Sequence[tuple[Size, Size]], pictures: Sequence[PicturePair]
) -> tuple[Size, Size]:
    if not sizes:
        raise CalibrationError('no pictures to calibrate from')
    for side in (0, 1):
        counts = Counter(pair[side] for pair in sizes)
        if len(counts) > 1:
            (usual, _), *_ = counts.most_common(1)
            odd = next(i for i, pair in enumerate(sizes) if pair[side] != usual)
            width, height = sizes[odd][side]
            raise CalibrationError(
                f'the {SIDES[side]} pictures have mixed sizes: {pictures[odd].name} is '
                f'{width}x{height}, most are {usual[0]}x{usual[1]} px; use one resolution'
            )
    return sizes[0]
