"""A tree of transforms, static and moving, and where one of its frames is in another."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.platform.errors import PlatformError
from binopos_ros.platform.history import SECOND, Bracket, History, Limits, Missing
from binopos_ros.platform.quaternions import Vector, matrix_of
from binopos_ros.platform.rig_pose import AT_REST, PlacedRig, rates
from binopos_ros.platform.transforms import SAME, Transform, inverse, joined, transform_of

Array = NDArray[np.float64]

#: More frames than any robot has.
MOST_FRAMES = 2000
#: Names of frames that a reason quotes.
_QUOTED = 6


@dataclass
class _Edge:
    """The transform of a frame to its parent: static, or moving."""

    parent: str
    static: Transform | None = None
    history: History | None = None


class _Chain(NamedTuple):
    """Frames whose edges lead from the rig up to what it shares with the fixed frame, and down."""

    up: tuple[str, ...]
    down: tuple[str, ...]


@dataclass
class TransformTree:
    """Transforms as they come, and poses out of them.

    Args:
        limits: between which samples of a moving transform nothing is interpolated.
    """

    limits: Limits
    _edges: dict[str, _Edge] = field(default_factory=dict)
    _chains: dict[tuple[str, str], _Chain] = field(default_factory=dict)

    def add(
        self,
        stamp: int,
        parent: str,
        child: str,
        translation: Vector,
        rotation: tuple[float, float, float, float],
        static: bool = False,
    ) -> str:
        """Take a transform in; '' or why it cannot be used.

        Args:
            stamp: ns.
            parent, child: the frames; a leading slash is not part of a name.
            translation: of the child in its parent, m.
            rotation: x, y, z, w.
            static: it holds for all time.
        """
        parent, child = parent.lstrip('/'), child.lstrip('/')
        name = f"the transform '{parent}' -> '{child}'"
        try:
            transform = transform_of(translation, rotation)
        except PlatformError as error:
            return f'{name} has {error}'
        edge = self._edges.get(child)
        if edge is None:
            problem = self._refusal(parent, child)
            if problem:
                return problem
            edge = self._edges[child] = _Edge(parent)
            self._chains.clear()
        if edge.parent != parent:
            return f"'{child}' has two parents: '{edge.parent}' and now '{parent}'"
        if static:
            known, edge.static = edge.static, transform
            return '' if known in (None, transform) else f'{name} is static and has changed'
        if edge.static is not None:
            return f'{name} is static and comes as a moving one too'
        if edge.history is None:
            edge.history = History(name, self.limits)
        edge.history.drop_oldest(edge.history.too_old())
        return edge.history.add(stamp, transform)[1]

    def rig_in(self, fixed: str, rig: str, stamp: int, moving: bool) -> PlacedRig | Missing:
        """Where the frame `rig` is in `fixed` at a stamp (ns), or why that is unknown.

        `moving`: how fast it moves and turns is wanted too.
        """
        chain = self._chain(fixed, rig)
        if isinstance(chain, Missing):
            return chain
        brackets: dict[str, Bracket] = {}
        for child in (*chain.up, *chain.down):
            edge = self._edges[child]
            if edge.static is None and edge.history is not None:
                found = edge.history.bracket(stamp)
                if isinstance(found, Missing):
                    return found
                brackets[child] = found
        pose, pivot = self._along(chain, brackets)
        white, span = 1.0, 0.0
        for child, bracket in brackets.items():
            own = self._history(child).span(bracket)
            if own > span:
                span, weight = own, bracket.weight
                white = (1 - weight) ** 2 + weight**2
        velocity = turn = AT_REST
        if span and moving:
            later = {
                child: _moved(self._history(child), bracket, span)
                for child, bracket in brackets.items()
            }
            velocity, turn = rates(pose, self._along(chain, later)[0], span)
        return PlacedRig(pose, pivot, white, span, velocity, turn)

    def covariance_of(self, fixed: str, rig: str, stamp: int, pivot: Vector) -> Array | None:
        """(6, 6) of how samples differ from a smooth motion, about the fixed frame's axes.

        Transforms come without covariance; this much they tell themselves. None while they are
        too few.

        Args:
            fixed, rig, stamp: that `rig_in` knows.
            pivot: place in the fixed frame about which errors of rotation turn, m.
        """
        chain = self._chain(fixed, rig)
        assert isinstance(chain, _Chain)
        whole = np.zeros((6, 6))
        for child in (*chain.up, *chain.down):
            if self._edges[child].static is not None:
                continue
            history = self._history(child)
            measure = history.measures[bisect_right(history.stamps, stamp) - 1]
            if measure is None:
                return None
            parent = self.rig_in(fixed, self._edges[child].parent, stamp, moving=False)
            own = self.rig_in(fixed, child, stamp, moving=False)
            assert isinstance(parent, PlacedRig)
            assert isinstance(own, PlacedRig)
            axes = matrix_of(parent.pose.rotation)
            x, y, z = np.array(pivot) - own.pose.translation
            error = np.zeros((6, 6))
            error[:3, :3] = error[3:, 3:] = axes
            error[:3, 3:] = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]]) @ axes
            whole += error * np.array(measure.variances) @ error.T
        return whole

    def _history(self, child: str) -> History:
        history = self._edges[child].history
        assert history is not None
        return history

    def _along(self, chain: _Chain, brackets: dict[str, Bracket]) -> tuple[Transform, Vector]:
        """The rig in the fixed frame; and there the origin of the last frame that moves."""
        down = SAME
        for child in chain.down:
            down = joined(self._edge_at(child, brackets), down)
        pose = inverse(down)
        pivot = pose.translation
        for child in reversed(chain.up):
            pose = joined(pose, self._edge_at(child, brackets))
            if child in brackets:
                pivot = pose.translation
        return pose, pivot

    def _edge_at(self, child: str, brackets: dict[str, Bracket]) -> Transform:
        edge = self._edges[child]
        if edge.static is not None:
            return edge.static
        return self._history(child).at(brackets[child])

    def _refusal(self, parent: str, child: str) -> str:
        """Why a new frame cannot be hung there, or ''."""
        if not parent or not child:
            return f"a transform '{parent}' -> '{child}' names no frame"
        way = [child, parent]
        while way[-1] != child and way[-1] in self._edges:
            way.append(self._edges[way[-1]].parent)
        if way[-1] == child:
            return f'transforms go in a circle: {" -> ".join(reversed(way))}'
        if len(self._edges) >= MOST_FRAMES:
            return f'more than {MOST_FRAMES} frames'
        return ''

    def _chain(self, fixed: str, rig: str) -> _Chain | Missing:
        known = self._chains.get((fixed, rig))
        if known is not None:
            return known
        above, below = self._ancestors(rig), self._ancestors(fixed)
        shared = next((frame for frame in above if frame in below), None)
        if shared is None:
            return Missing(self._unconnected(fixed, rig), may_come=True)
        up, down = above[: above.index(shared)], below[: below.index(shared)]
        chain = self._chains[fixed, rig] = _Chain(tuple(up), tuple(down))
        return chain

    def _ancestors(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the root."""
        way = [frame]
        while way[-1] in self._edges:
            way.append(self._edges[way[-1]].parent)
        return way

    def _unconnected(self, fixed: str, rig: str) -> str:
        frames = {*self._edges, *(edge.parent for edge in self._edges.values())}
        if not frames:
            return 'no transform has come'
        for frame in (fixed, rig):
            if frame not in frames:
                there = sorted(frames)
                more = ', ...' if len(there) > _QUOTED else ''
                return f"no transform has the frame '{frame}'; known: " + (
                    ', '.join(there[:_QUOTED]) + more
                )
        return f"no transforms lead from '{fixed}' to '{rig}'"


def _moved(history: History, bracket: Bracket, seconds: float) -> Bracket:
    """A bracket for so many seconds later, on the straight way of its samples."""
    if bracket.first == bracket.second:
        last = len(history.stamps) - 1
        if not last:
            return bracket
        first = min(bracket.first, last - 1)
        bracket = Bracket(first, first + 1, float(bracket.first - first))
    span = (history.stamps[bracket.second] - history.stamps[bracket.first]) * SECOND
    return bracket._replace(weight=bracket.weight + seconds / span)
