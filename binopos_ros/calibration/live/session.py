"""Guidance on live pictures: finds the boards, draws the overlay, writes the terminal's view."""

from __future__ import annotations

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.live.guidance import Guidance, Guide, Solve
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView, find_board
from binopos_ros.calibration.views.pairs import CELLS, BoardPair
from binopos_ros.optics.rig_state import LEFT, RIGHT
from binopos_ros.sides import SIDES

OVERLAY_WIDTH = 640  # px per camera
ENOUGH_POINTS = 10  # per cell
SHADES = ' ░▒▓█'
GREEN, RED, YELLOW, WHITE = (80, 220, 80), (60, 60, 230), (40, 220, 255), (255, 255, 255)
FONT = cv2.FONT_HERSHEY_SIMPLEX
BAND = 26  # px, height of a line of text


class LiveSession:
    """One taking of views, from the first picture to good enough.

    Args:
        board: the board.
        solve: see `Guidance`.
        wanted: standard deviation of a position that is good enough (m).
        distance: working distance (m).
        window: half-width of the corners' refinement (px); None follows the squares.
    """

    def __init__(
        self,
        board: Board,
        solve: Solve,
        wanted: float,
        distance: float,
        window: int | None = None,
    ) -> None:
        self._board, self._solve, self._window = board, solve, window
        self._wanted, self._distance = wanted, distance
        self.guidance: Guidance | None = None
        self.done = False

    @property
    def pairs(self) -> list[BoardPair]:
        """The pairs taken so far."""
        return self.guidance.pairs if self.guidance is not None else []

    def show(self, name: str, left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, str]:
        """Take in a pair of grey pictures (H, W); the overlay (bgr) and the terminal's text.

        Raises:
            CalibrationError: the pictures' size changed.
        """
        images = (left, right)
        sizes = ((left.shape[1], left.shape[0]), (right.shape[1], right.shape[0]))
        if self.guidance is None:
            self.guidance = Guidance(self._board, sizes, self._solve, self._wanted, self._distance)
        if sizes != self.guidance.sizes:
            raise CalibrationError('the pictures changed their size: keep one resolution')
        found = [self._find(image) for image in images]
        guide = self.guidance.add(BoardPair(name, found[LEFT], found[RIGHT]))
        self.done = guide.done
        halves = [self._draw(images[side], found[side], side, guide) for side in (LEFT, RIGHT)]
        height = min(half.shape[0] for half in halves)
        overlay = np.hstack([half[:height] for half in halves])
        return overlay, self._text(guide)

    def _find(self, image: np.ndarray) -> BoardView | None:
        try:
            return find_board(image, self._board, self._window)
        except CalibrationError:
            return None  # a mirrored board, held the wrong way round for a moment

    def _draw(
        self, image: np.ndarray, view: BoardView | None, side: int, guide: Guide
    ) -> np.ndarray:
        assert self.guidance is not None
        scale = OVERLAY_WIDTH / image.shape[1]
        size = (OVERLAY_WIDTH, round(scale * image.shape[0]))
        picture = cv2.cvtColor(
            cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR
        )
        counts = self.guidance.coverage(side)
        share = np.clip(counts / ENOUGH_POINTS, 0.0, 1.0).astype(np.float32)
        tint = cv2.resize(share, size, interpolation=cv2.INTER_NEAREST)[..., None]
        picture = (picture * (1.0 - 0.35 * tint) + 0.35 * tint * np.array(GREEN)).astype(np.uint8)
        if view is not None:
            colour = GREEN if guide.taken else RED
            for u, v in (view.pixels + 0.5) * scale - 0.5:
                cv2.circle(picture, (round(u), round(v)), 3, colour, 1, cv2.LINE_AA)
        if guide.outlines:
            outline = np.rint((guide.outlines[side] + 0.5) * scale - 0.5).astype(np.int32)
            cv2.polylines(picture, [outline], True, YELLOW, 2, cv2.LINE_AA)
        lines = (guide.hint, _standing(guide)) if side == LEFT else (guide.reason,)
        for row, line in enumerate(line for line in lines if line):
            _write(picture, line, row)
        return np.asarray(picture)

    def _text(self, guide: Guide) -> str:
        assert self.guidance is not None
        maps = [self.guidance.coverage(side) for side in (LEFT, RIGHT)]
        lines = ['   '.join(f'{name:<{CELLS[0] * 2}}' for name in SIDES)]
        for row in range(CELLS[1]):
            lines.append('   '.join(_shaded(counts[row]) for counts in maps))
        state = 'taken' if guide.taken else f'not taken: {guide.reason}'
        return '\n'.join([*lines, state, _standing(guide), f'next: {guide.hint}'])


def _write(picture: np.ndarray, line: str, row: int) -> None:
    """A line of white text on a darkened band."""
    band = picture[row * BAND : (row + 1) * BAND]
    band[:] = band // 4
    # A long hint shrinks until it fits.
    size = 0.5
    while size > 0.3 and cv2.getTextSize(line, FONT, size, 1)[0][0] > OVERLAY_WIDTH - 16:
        size -= 0.02
    place = (8, row * BAND + 18)
    cv2.putText(picture, line, place, FONT, size, WHITE, 1, cv2.LINE_AA)


def _shaded(counts: np.ndarray) -> str:
    level = np.ceil(np.clip(counts / ENOUGH_POINTS, 0.0, 1.0) * (len(SHADES) - 1)).astype(int)
    return ''.join(2 * SHADES[i] for i in level)


def _standing(guide: Guide) -> str:
    words = f'{guide.views} views'
    if np.isfinite(guide.error):
        words += f', positions to {1000 * guide.error:.2f} mm'
    if np.isfinite(guide.gain):
        words += f', this view {-1000 * guide.gain:+.2f} mm'
    return words
