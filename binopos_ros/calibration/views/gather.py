"""From pictures to views: every pair searched for the board, on all cores."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView, find_board, upright_like
from binopos_ros.calibration.views.pairs import BoardPair, Dropped
from binopos_ros.calibration.views.pictures import PicturePair
from binopos_ros.sides import SIDES

Size = tuple[int, int]
Tick = Callable[[], None]
#: Of the pictures of a camera: when so many are of one size, the others are strays.
MOST = 0.5


class Gathered(NamedTuple):
    """What pictures show: pair by pair, the sizes (px) of left and right, and what is left out."""

    pairs: list[BoardPair]
    sizes: tuple[Size, Size]
    dropped: list[Dropped]


def find_boards(
    pictures: Sequence[PicturePair],
    board: Board,
    window: int | None = None,
    tick: Tick = lambda: None,
) -> Gathered:
    """Search every pair for the board. A picture that cannot be read costs its pair.

    Args:
        pictures: the pairs.
        board: what to look for.
        window: half-width of the corners' refinement (px); None chooses it per picture.
        tick: called when a pair is done.

    Raises:
        CalibrationError: no pair can be read, pictures of many sizes, or mirrored ChArUco boards.
    """

    def search(pair: PicturePair) -> tuple[BoardPair, tuple[Size, Size]] | Dropped:
        found: list[BoardView | None] = []
        sizes: list[Size] = []
        try:
            images = pair.left(), pair.right()
        except CalibrationError as error:
            tick()
            return Dropped(pair.name, str(error))
        for side, image in zip(SIDES, images, strict=True):
            try:
                found.append(find_board(image, board, window))
            except CalibrationError as error:
                raise CalibrationError(f'{pair.name}, {side}: {error}') from None
            sizes.append((image.shape[1], image.shape[0]))
        tick()
        left, right = found
        if left is not None and right is not None:
            right = upright_like(right, left, board)
        return BoardPair(pair.name, left, right), (sizes[0], sizes[1])

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        results = list(pool.map(search, pictures))
    dropped = [result for result in results if isinstance(result, Dropped)]
    read = [result for result in results if not isinstance(result, Dropped)]
    if not read:
        raise CalibrationError(
            f'no pair of pictures can be read; {dropped[0]}'
            if dropped
            else 'no pictures to calibrate from'
        )
    usual = _usual_sizes(read)
    strays = [(pair, sizes) for pair, sizes in read if sizes != usual]
    dropped += [Dropped(pair.name, _of_another_size(sizes, usual)) for pair, sizes in strays]
    return Gathered([pair for pair, sizes in read if sizes == usual], usual, dropped)


def _usual_sizes(read: Sequence[tuple[BoardPair, tuple[Size, Size]]]) -> tuple[Size, Size]:
    counts = Counter(sizes for _, sizes in read)
    (usual, count), *_ = counts.most_common(1)
    if count <= MOST * len(read):
        name, sizes = next((pair.name, sizes) for pair, sizes in read if sizes != usual)
        raise CalibrationError(
            f'the pictures have mixed sizes: {name}: {_of_another_size(sizes, usual)}'
        )
    return usual


def _of_another_size(sizes: tuple[Size, Size], usual: tuple[Size, Size]) -> str:
    """Why a pair is left out whose pictures are not as large as the others'."""
    side = next(i for i in (0, 1) if sizes[i] != usual[i])
    (width, height), (as_width, as_height) = sizes[side], usual[side]
    return (
        f'the {SIDES[side]} picture is {width}x{height}, most are {as_width}x{as_height} px; use '
        'one resolution'
    )
