"""What the nodes say of themselves on /diagnostics, as the page shows it."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, NamedTuple

from binopos_ros.reasons import count_reason, shown
from binopos_ros.view.remedies import remedy_for
from binopos_ros.view.timeline import Timeline

#: s; nodes say something each second.
SILENT = 3.5
#: Nodes that are kept; a suite has eight.
MOST_NODES = 24
STAGE = ': stage'
#: Who shows the page need not stand on it.
OWN = 'viewer'
DROPPED, PAIR_LOST = 'Dropped: ', 'Pairs: '
WAVES = "Waves in the rays' miss (pixel noises)"
LEVELS = ('ok', 'warning', 'error', 'no input')


class NodesSeen:
    """Keeps the newest status of each node, and tells the timeline of changes."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._nodes: dict[str, _Node] = {}
        self._own: Counter[str] = Counter()

    def take(self, instant: Any, status: Any) -> None:
        """Take one status of a DiagnosticArray; those of other programs are left alone."""
        if not status.name.endswith(STAGE):
            return
        name = shown(status.name.removesuffix(STAGE).rpartition('/')[2])
        if name == OWN or (name not in self._nodes and len(self._nodes) >= MOST_NODES):
            return
        level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
        values = {each.key: each.value for each in status.values}
        self._nodes[name] = _Node(instant.now, level, shown(status.message), values)
        self._timeline.node(instant.wall, name, level, status.message)

    def drop(self, name: str, reason: str) -> None:
        """Count what the page itself could not use."""
        count_reason(self._own, f'{name}: {reason}')

    def look(self, wall: float, now: float) -> None:
        """See who says nothing any more."""
        for name, node in self._nodes.items():
            if now - node.came > SILENT:
                self._timeline.absent(wall, name)

    def told(self, now: float) -> list[dict[str, Any]]:
        """Each node: its name, level, message, remedy and how long ago it spoke, s."""
        told = []
        for name, node in self._nodes.items():
            silent = now - node.came > SILENT
            message = 'says nothing any more' if silent else node.message
            level = 'silent' if silent else LEVELS[min(node.level, 3)]
            told.append(
                {
                    'name': name,
                    'level': level,
                    'message': message,
                    'remedy': '' if level == 'ok' else remedy_for(message),
                    'age': now - node.came,
                }
            )
        return told

    def drops(self) -> list[dict[str, Any]]:
        """What gave no result, by node and reason, the most frequent first."""
        found = self._counts(DROPPED)
        found += [
            {'node': reason.partition(': ')[0], 'reason': reason.partition(': ')[2], 'count': n}
            for reason, n in self._own.items()
        ]
        return sorted(found, key=lambda each: -each['count'])

    def pairs_lost(self) -> list[dict[str, Any]]:
        """Pairs that gave no pose, each once, as `drops` tells them."""
        return sorted(self._counts(PAIR_LOST), key=lambda each: -each['count'])

    def _counts(self, kind: str) -> list[dict[str, Any]]:
        return [
            {'node': name, 'reason': shown(key.removeprefix(kind)), 'count': _whole(value)}
            for name, node in self._nodes.items()
            for key, value in node.values.items()
            if key.startswith(kind)
        ]

    def refused(self, side: str) -> str:
        """Why the best candidate in a picture was refused; '' where there was none."""
        node = self._nodes.get('detector')
        return shown(node.values.get(f'{side}: best candidate refused', '')) if node else ''

    @property
    def detector_is_off(self) -> bool:
        """Whether somebody has told the detector to leave pictures alone."""
        node = self._nodes.get('detector')
        return node is not None and node.values.get('Enabled') == 'False'

    @property
    def waves(self) -> float:
        """Wave level in pixel noises; nan where the rig looks through no free surface."""
        try:
            return float(self._nodes['triangulator'].values[WAVES])
        except (KeyError, ValueError):
            return math.nan

    def recorder(self, now: float) -> dict[str, Any] | None:
        """What the recorder says, where one runs."""
        node = self._nodes.get('recorder')
        if node is None or now - node.came > SILENT:
            return None
        return {
            'bag': node.values.get('Bag', ''),
            'state': node.values.get('State', ''),
            'free': _figure(node.values.get('Free space (GB)', '')),
            'duration': _figure(node.values.get('Recorded (s)', '')),
        }


class _Node(NamedTuple):
    """What a node has said last."""

    came: float
    level: int
    message: str
    values: dict[str, str]


def _whole(value: str) -> int:
    return int(value) if value.isdigit() else 0


def _figure(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        return math.nan
