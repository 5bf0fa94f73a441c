"""Guidance while pictures are taken: which view helps most, and when to stop.

With the calibration so far and its covariance C, a further view with information J about the rig
leaves (C^-1 + J)^-1. Carried on to a target at the working distance, this says in millimetres what
the board, held as it is now, would add, and which of many imagined views would add most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from binopos_ros.calibration.adjustment.adjust import view_information
from binopos_ros.calibration.adjustment.positions import position_jacobians
from binopos_ros.calibration.adjustment.start import guess_pose
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import upright_like
from binopos_ros.calibration.views.pairs import BoardPair, coverage, foreshortening
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState, exponential
from binopos_ros.sides import SIDES

FEWEST_TO_FIT = 6
NEW_LOOK = 0.12  # distance in (tilt, tilt, log scale) or in parts of the picture from other views
WORTH_TAKING = 0.01  # relative gain of a view below which it is passed over
STILL = 1.5  # px between two pictures of a board that is held still

PLACES = {'upper': 0.25, 'middle': 0.5, 'lower': 0.75}
SIDEWAYS = {'left': 0.25, 'middle': 0.5, 'right': 0.75}
TILTS = {
    'flat on': (0.0, 0.0),
    'its upper edge away': (-40.0, 0.0),
    'its lower edge away': (40.0, 0.0),
    'its left edge away': (0.0, 40.0),
    'its right edge away': (0.0, -40.0),
}
DISTANCES = (0.8, 1.2)  # of the mean distance so far


@dataclass(frozen=True)
class Solution:
    """A calibration so far: state, covariance (P, P), free (P,), sigma (px), board poses."""

    state: RigState
    covariance: np.ndarray
    free: np.ndarray
    sigma: float
    poses: tuple[Pose, ...]


Sizes = tuple[tuple[int, int], tuple[int, int]]
Solve = Callable[[Sequence[BoardPair], Sizes], Solution]


@dataclass(frozen=True)
class Guide:
    """What to tell the user after a pair of pictures.

    Attributes:
        views: taken so far.
        taken: whether this pair was taken; `reason` says why not.
        error: predicted standard deviation of a position at the working distance that comes from
            the calibration (m); nan before the first fit.
        gain: by how much this view lowers it (m); nan where not known.
        hint: the next thing to do.
        done: whether `error` is below what was wanted.
        outlines: per camera (4, 2), where the board's outer points would then be seen (px); empty
            where the hint names no place.
    """

    views: int
    taken: bool
    reason: str
    error: float
    gain: float
    hint: str
    done: bool
    outlines: tuple[np.ndarray, ...] = ()


@dataclass
class Guidance:
    """Collects the views worth having.

    Args:
        board: the board.
        sizes: of the left and the right pictures (px).
        solve: calibrates from pairs; raises CalibrationError while they are too few.
        wanted: standard deviation of a position that is good enough (m).
        distance: the working distance (m).
    """

    board: Board
    sizes: Sizes
    solve: Solve
    wanted: float
    distance: float
    pairs: list[BoardPair] = field(default_factory=list)
    solution: Solution | None = None
    _before: BoardPair | None = None
    _next: str = ''
    _outlines: tuple[np.ndarray, ...] = ()

    def add(self, pair: BoardPair) -> Guide:
        """Judge a pair, take it if it helps, and say what to do next."""
        reason, gain = self._judge(pair)
        if not reason:
            self.pairs.append(pair)
            self._fit()
        error = self.error()
        done = bool(error < self.wanted)
        if not reason or not self._next:
            self._next, self._outlines = self._hint(done)  # only a view taken changes it
        return Guide(
            len(self.pairs), not reason, reason, error, gain, self._next, done, self._outlines
        )

    def error(self) -> float:
        """Predicted standard deviation at the working distance from the calibration (m)."""
        if self.solution is None:
            return float('nan')
        return self._error_of(self.solution.covariance)

    def coverage(self, side: int) -> np.ndarray:
        """Points per cell of a camera's picture so far."""
        pixels = [pair.view(self.board).pixels[side] for pair in self.pairs]
        return coverage(np.concatenate([np.zeros((0, 2)), *pixels]), self.sizes[side])

    def _judge(self, pair: BoardPair) -> tuple[str, float]:
        """Why not to take a pair ('' to take it), and what it would gain (m)."""
        before, self._before = self._before, pair
        if pair.left is None or pair.right is None:
            missing = SIDES[LEFT] if pair.left is None else SIDES[RIGHT]
            return f'no board in the {missing} picture', float('nan')
        if before is not None and before.left is not None:
            _, now, then = pair.left.common(before.left)
            if len(now) and np.abs(now - then).max() > STILL:
                return 'hold the board still', float('nan')
        right = upright_like(pair.right, pair.left, self.board)
        view = BoardPair(pair.name, pair.left, right).view(self.board)
        gain = self._gain_of(view)
        if self.solution is not None and np.isfinite(gain):
            if gain < WORTH_TAKING * self.error():
                return 'adds next to nothing', gain
            return '', gain
        if any(self._alike(view, other.view(self.board)) for other in self.pairs):
            return 'too much like a view already taken', gain
        return '', gain

    def _alike(self, view: View, other: View) -> bool:
        looks = [foreshortening(one.pixels[LEFT], self.board) for one in (view, other)]
        places = [np.nanmean(one.pixels[LEFT], axis=0) / self.sizes[LEFT] for one in (view, other)]
        return bool(
            np.linalg.norm(looks[0] - looks[1]) < NEW_LOOK
            and np.linalg.norm(places[0] - places[1]) < NEW_LOOK
        )

    def _fit(self) -> None:
        if len(self.pairs) < FEWEST_TO_FIT:
            return
        try:
            self.solution = self.solve(self.pairs, self.sizes)
        except CalibrationError:
            self.solution = None  # not determined yet: more views will do it

    def _gain_of(self, view: View, pose: Pose | None = None) -> float:
        if self.solution is None:
            return float('nan')
        solution = self.solution
        if pose is None:
            pose = guess_pose(solution.state.cameras[LEFT], view.points, view.pixels[LEFT])
        if pose is None:
            return float('nan')
        free = solution.free
        information = view_information(solution.state, pose, view, free, solution.sigma)
        if not np.isfinite(information).all():
            return float('nan')
        covariance = solution.covariance.copy()
        own = covariance[np.ix_(free, free)]
        # (C^-1 + J)^-1 without inverting C, which is nearly singular where lens terms trade off.
        covariance[np.ix_(free, free)] = np.linalg.solve(np.eye(len(own)) + own @ information, own)
        return self.error() - self._error_of(covariance)

    def _error_of(self, covariance: np.ndarray) -> float:
        assert self.solution is not None
        state = self.solution.state
        centre = -state.rotation.T @ state.translation / 2.0
        points = centre + self.distance * np.array(
            [[0.0, 0.0, 1.0], [0.15, 0.0, 1.0], [-0.15, 0.0, 1.0], [0.0, 0.12, 1.0]]
        )
        _, jacobian = position_jacobians(state, points)
        square = np.einsum('nij,jk,nik->n', jacobian, covariance, jacobian)
        return float(np.sqrt(np.nanmean(square)))

    def _hint(self, done: bool) -> tuple[str, tuple[np.ndarray, ...]]:
        """The next thing to do, and the outlines of the board that it asks for."""
        if done:
            return 'good enough: stop here', ()
        if self.solution is None:
            missing = FEWEST_TO_FIT - len(self.pairs)
            more = f'{missing} more to begin with' if missing > 0 else 'tilt more, about both axes'
            return f'show the board tilted in different ways and places: {more}', ()
        gains = [(self._gain_of(view, pose), text, view) for text, view, pose in self._imagined()]
        gain, text, view = max(gains, key=lambda one: one[0], default=(0.0, '', None))
        if view is None or gain <= 0.0:
            return 'fill the empty parts of both pictures', ()
        columns, rows = self.board.shape
        corners = [0, columns - 1, columns * rows - 1, columns * (rows - 1)]
        return f'{text}: -{1000 * gain:.2f} mm', tuple(seen[corners] for seen in view.pixels)

    def _imagined(self) -> list[tuple[str, View, Pose]]:
        """Views that could be taken next: nine places, five tilts, two distances."""
        assert self.solution is not None
        state = self.solution.state
        points = self.board.points
        middle = points.mean(axis=0)
        mean = float(np.mean([pose.apply(points)[:, 2].mean() for pose in self.solution.poses]))
        width, height = self.sizes[LEFT]
        rig = state.rig()
        found = []
        for up, v in PLACES.items():
            for aside, u in SIDEWAYS.items():
                pixel = np.array([[u * (width - 1), v * (height - 1)]])
                ray = state.cameras[LEFT].pinhole().unproject(pixel)[0]
                for tilt, degrees in TILTS.items():
                    rotation = exponential(np.radians([*degrees, 0.0]))
                    for part in DISTANCES:
                        place = ray * part * mean / ray[2]
                        pose = Pose(rotation, place - rotation @ middle)
                        seen = rig.project(pose.apply(points))
                        if not self._inside(seen):
                            continue
                        text = (
                            f'hold it {part * mean:.2f} m away in the {up} {aside} of the left '
                            f'picture, {tilt}'
                        )
                        found.append((text, View(text, points, seen), pose))
        return found

    def _inside(self, seen: tuple[np.ndarray, np.ndarray]) -> bool:
        return all(
            np.isfinite(p).all() and (p >= 0).all() and (p < np.array(size)).all()
            for p, size in zip(seen, self.sizes, strict=True)
        )
