"""Finding a board's points in a picture, to a few hundredths of a pixel.

A corner is refined as the saddle of the grey values in a window around it (cv2.cornerSubPix).
The window must not reach the next corner: on `opencv-stereo-samples` a half-width of 11 px finds a
neighbour in view 02 and multiplies its error by six, 5 px does not, and 7 px is better still
where the squares allow it. So the window follows the squares, picture by picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from binopos_ros.calibration.views import charuco
from binopos_ros.calibration.views.board import ASYMMETRIC_CIRCLES, CHARUCO, CHESSBOARD, Board

WINDOW_PER_SPACING = 0.3  # with 0.35 a neighbour is reached in strongly tilted views
SMALLEST_WINDOW = 2
LARGEST_WINDOW = 7
REFINEMENT_TOLERANCE = 0.001  # px
#: Equalising the grey values helps in the dark, and hides boards on a white wall.
CHESSBOARD_SEARCHES = (
    cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK,
    cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK,
)
COARSE_WIDTH = 1000  # px; a board that fills a usable part of the picture is found at this width


@dataclass(frozen=True)
class BoardView:
    """A board seen in one picture.

    Attributes:
        indices: (N,) which of the board's points these are.
        pixels: (N, 2) where they are seen (px).
        sharpness: the 10-90 % rise of the board's edges (px): about 1.5 in a sharp picture; nan
            for circles.
    """

    indices: np.ndarray
    pixels: np.ndarray
    sharpness: float

    def common(self, other: BoardView) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Indices, own pixels and the other's pixels of the points seen in both."""
        indices, own, others = np.intersect1d(self.indices, other.indices, return_indices=True)
        return indices, self.pixels[own], other.pixels[others]


def find_board(
    image: np.ndarray,
    board: Board,
    window: int | None = None,
    tolerance: float = REFINEMENT_TOLERANCE,
) -> BoardView | None:
    """Find the board's points in a grey or bgr picture.

    Args:
        image: (H, W) or (H, W, 3) uint8.
        board: what to look for.
        window: half-width of the refinement (px); None chooses it from the squares' size.
        tolerance: the refinement ends when a step is shorter (px).

    Returns:
        The view, or None where there is no board. Chessboards and circle grids are found whole
        or not at all; of a ChArUco board at least six corners.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if board.kind == CHARUCO:
        found = charuco.find_corners(grey, board)
        if found is None:
            return None
        indices, pixels = found
        half = window if window is not None else charuco_window(indices, pixels, board)
        # Up to OpenCV 4.9 its own corners lie half a pixel off; from 5 on this changes nothing.
        pixels = refine(grey, pixels, half, tolerance)
        return BoardView(indices, pixels, edge_rise(grey, board, indices, pixels))
    if board.kind == CHESSBOARD:
        corners = _find_chessboard(grey, board)
        if corners is None:
            return None
        half = window if window is not None else refinement_window(corners, board)
        pixels = refine(grey, corners, half, tolerance)
        pixels = _dark_square_first(grey, pixels, board)
    else:
        circles = _find_circles(grey, board)
        if circles is None:
            return None
        pixels = circles
    indices = np.arange(len(pixels))
    return BoardView(indices, pixels, edge_rise(grey, board, indices, pixels))


def refinement_window(corners: np.ndarray, board: Board) -> int:
    """The half-width (px) that stays clear of the neighbours of every corner of a whole board."""
    columns, rows = board.shape
    grid = corners.reshape(rows, columns, 2)
    spacing = min(
        np.linalg.norm(np.diff(grid, axis=0), axis=2).min(),
        np.linalg.norm(np.diff(grid, axis=1), axis=2).min(),
    )
    return int(np.clip(WINDOW_PER_SPACING * spacing, SMALLEST_WINDOW, LARGEST_WINDOW))


def charuco_window(indices: np.ndarray, pixels: np.ndarray, board: Board) -> int:
    """The half-width (px) that stays clear of the markers around every corner."""
    columns = board.shape[0]
    row = np.flatnonzero((np.diff(indices) == 1) & ((indices[:-1] + 1) % columns != 0))
    if not len(row):
        return SMALLEST_WINDOW
    spacing = float(np.min(np.linalg.norm(pixels[row + 1] - pixels[row], axis=1)))
    clear = 0.5 * (board.square - board.marker) / board.square * spacing
    return int(np.clip(clear, SMALLEST_WINDOW, LARGEST_WINDOW))


def refine(
    grey: np.ndarray, corners: np.ndarray, half: int, tolerance: float = REFINEMENT_TOLERANCE
) -> np.ndarray:
    """(N, 2) saddles of the grey values nearest to `corners`, in windows of 2 half + 1 pixels."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, tolerance)
    start = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria)
    return refined.reshape(-1, 2).astype(float)


def _find_chessboard(grey: np.ndarray, board: Board) -> np.ndarray | None:
    # The search costs with the area, the refinement not at all: search small, refine large.
    scale = max(1.0, grey.shape[1] / COARSE_WIDTH)
    for factor in (scale, 1.0) if scale > 1.0 else (1.0,):
        image = grey
        if factor > 1.0:
            size = (round(grey.shape[1] / factor), round(grey.shape[0] / factor))
            image = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        for flags in CHESSBOARD_SEARCHES:
            found, corners = cv2.findChessboardCorners(image, board.shape, flags=flags)
            if found:
                break
        else:
            # Slower, but finds boards in blur and noise.
            found, corners = cv2.findChessboardCornersSB(image, board.shape)
        if found:
            ratio = np.array([grey.shape[1] / image.shape[1], grey.shape[0] / image.shape[0]])
            return (corners.reshape(-1, 2) + 0.5) * ratio - 0.5
    return None


def _find_circles(grey: np.ndarray, board: Board) -> np.ndarray | None:
    layout = (
        cv2.CALIB_CB_ASYMMETRIC_GRID
        if board.kind == ASYMMETRIC_CIRCLES
        else cv2.CALIB_CB_SYMMETRIC_GRID
    )
    opencv: Any = cv2  # its type stubs lack the blob detector
    parameters = opencv.SimpleBlobDetector_Params()
    parameters.minArea = 12.0
    parameters.maxArea = grey.size / 50.0
    parameters.minDistBetweenBlobs = 4.0
    for light in (False, True):
        picture = 255 - grey if light else grey
        blobs = opencv.SimpleBlobDetector_create(parameters)
        for extra in (0, cv2.CALIB_CB_CLUSTERING):
            found, centres = cv2.findCirclesGrid(
                picture, board.shape, flags=layout | extra, blobDetector=blobs
            )
            if found:
                return _blob_centres(picture, centres.reshape(-1, 2).astype(float))
    return None


def _blob_centres(grey: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Grey-weighted centres of dark blobs; thresholded contours lose the edge's grey values."""
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(distances, np.inf)
    refined = centres.copy()
    for i, ((u, v), nearest) in enumerate(zip(centres, distances.min(axis=1), strict=True)):
        # A dot's radius is less than half of that, seen at 60 degrees less than all of it.
        half = max(3, int(np.ceil(nearest)))
        left, top = max(round(u) - half, 0), max(round(v) - half, 0)
        patch = grey[top : top + 2 * half + 1, left : left + 2 * half + 1].astype(float)
        low, high = np.percentile(patch, (5, 95))
        dot = _dot_at(patch < 0.5 * (low + high), round(u) - left, round(v) - top)
        if dot is None:
            continue
        weight = np.clip((0.5 * (low + high) + 0.3 * (high - low) - patch) / (high - low), 0, 0.6)
        weight[~dot] = 0.0
        rows_, columns_ = np.mgrid[: patch.shape[0], : patch.shape[1]]
        total = weight.sum()
        refined[i] = (
            left + (weight * columns_).sum() / total,
            top + (weight * rows_).sum() / total,
        )
    return refined


def _dot_at(dark: np.ndarray, column: int, row: int) -> np.ndarray | None:
    """(H, W) the dot there with its soft edge, nothing of its neighbours; None where it is cut."""
    _, labels = cv2.connectedComponents(dark.astype(np.uint8))
    own = labels == labels[row, column]
    border = np.concatenate([own[0], own[-1], own[:, 0], own[:, -1]])
    if not dark[row, column] or border.any():
        return None
    around = np.ones((3, 3), np.uint8)
    grown = cv2.dilate(own.astype(np.uint8), around, iterations=2)
    others = cv2.dilate((dark & ~own).astype(np.uint8), around)
    return np.asarray((grown > 0) & ((others == 0) | own))


def _dark_square_first(grey: np.ndarray, pixels: np.ndarray, board: Board) -> np.ndarray:
    """Turn a board so that it begins at a dark inner square, where a turn changes that."""
    columns, rows = board.shape
    # A quarter turn takes the first inner square of a square board to the end of its row.
    quarter = columns == rows and columns % 2 == 1
    if board.turns_onto_itself and not quarter:
        return pixels
    grid = pixels.reshape(rows, columns, 2)
    middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4.0
    values = grey[
        np.clip(np.rint(middles[..., 1]).astype(int), 0, grey.shape[0] - 1),
        np.clip(np.rint(middles[..., 0]).astype(int), 0, grey.shape[1] - 1),
    ].astype(float)
    row, column = np.indices(values.shape)
    even = (row + column) % 2 == 0
    if values[even].mean() <= values[~even].mean():
        return pixels
    return _turned(pixels, board, 1 if quarter else 2)


def _turned(pixels: np.ndarray, board: Board, quarters: int) -> np.ndarray:
    """A whole board's points (N, 2) numbered from another corner; odd turns of square boards."""
    columns, rows = board.shape
    return np.rot90(pixels.reshape(rows, columns, 2), quarters).reshape(-1, 2).copy()


def edge_rise(grey: np.ndarray, board: Board, indices: np.ndarray, pixels: np.ndarray) -> float:
    """The median 10-90 % rise (px) of the edges between neighbouring corners of a row."""
    if board.kind not in (CHESSBOARD, CHARUCO):
        return float('nan')
    columns = board.shape[0]
    place = {int(index): i for i, index in enumerate(indices)}
    rises = []
    for index, i in place.items():
        j = place.get(index + 1)
        if (index + 1) % columns == 0 or j is None:
            continue
        along = pixels[j] - pixels[i]
        length = float(np.linalg.norm(along))
        if length < 6.0:
            continue
        across = np.array([-along[1], along[0]]) / length
        reach = 0.4 * length
        steps = np.arange(-reach, reach + 1e-9, 0.25)
        middle = pixels[i] + 0.5 * along
        line = (middle + steps[:, None] * across).astype(np.float32)
        profile = (
            cv2.remap(grey, line[None, :, 0], line[None, :, 1], cv2.INTER_LINEAR)
            .ravel()
            .astype(float)
        )
        if profile[-1] < profile[0]:
            profile = profile[::-1]
        low, high = np.median(profile[:4]), np.median(profile[-4:])
        if high - low < 20.0:
            continue
        relative = (profile - low) / (high - low)
        inside = (relative > 0.1) & (relative < 0.9)
        rises.append(0.25 * float(inside.sum()))
    return float(np.median(rises)) if rises else float('nan')


def upright_like(view: BoardView, reference: BoardView, board: Board) -> BoardView:
    """Number a board that turns onto itself as in the other camera's picture.

    The two cameras of a rig are taken to be turned against each other by less than 90 degrees, or
    45 where a quarter turn looks the same.
    """
    if not board.turns_onto_itself or board.kind == CHARUCO:
        return view
    columns, rows = board.shape
    of_reference = reference.pixels - reference.pixels.mean(axis=0)

    def agreement(pixels: np.ndarray) -> float:
        return float(np.sum((pixels - pixels.mean(axis=0)) * of_reference))

    quarters = range(4) if columns == rows and board.kind != ASYMMETRIC_CIRCLES else (0, 2)
    pixels = max((_turned(view.pixels, board, turn) for turn in quarters), key=agreement)
    return BoardView(view.indices, pixels, view.sharpness)
