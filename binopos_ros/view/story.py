"""A dive in short: its path, how sure that was, what was dropped, what happened."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.detection import DetectionError
from binopos_ros.view.dive import PICTURES, POSE, Dive, Item
from binopos_ros.view.encoding import thumbnail
from binopos_ros.view.screen import DIAGNOSTICS, Instant, Screen
from binopos_ros.view.timeline import Event

#: Events that get a picture.
MOST_PICTURES = 12
HEALTH = 'target/health'
LEFT = PICTURES['left']


@dataclass
class Story:
    """What there is to tell of a dive.

    Attributes:
        start, end: s since the epoch.
        frame: of the positions.
        stamps: (N,) s since the epoch, of the pictures.
        positions, deviations: (N, 3) m.
        health: when each word on the target began, and the word.
        events: what happened, with a thumbnail of the left picture (JPEG) where there is one.
        drops: (node, reason, count).
        messages: by name, how many were read.
    """

    start: float
    end: float
    frame: str = ''
    stamps: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    positions: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    deviations: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    health: list[tuple[float, str]] = field(default_factory=list)
    events: list[tuple[Event, bytes]] = field(default_factory=list)
    drops: list[tuple[str, str, int]] = field(default_factory=list)
    messages: Counter[str] = field(default_factory=Counter)

    @property
    def length(self) -> float:
        """Of the path, m, over steps longer than their own uncertainty."""
        if len(self.positions) < 2:
            return 0.0
        total, last, sure = 0.0, self.positions[0], self.deviations[0]
        for place, deviation in zip(self.positions[1:], self.deviations[1:], strict=True):
            step = float(np.linalg.norm(place - last))
            if step > 2 * float(np.hypot(np.linalg.norm(deviation), np.linalg.norm(sure))):
                total, last, sure = total + step, place, deviation
        return total


def tell(dive: Dive) -> Story:
    """Read a dive from its beginning to its end; pictures only near events."""
    screen = Screen()
    story = Story(dive.start * 1e-9, dive.end * 1e-9)
    rows: list[tuple[float, Any, Any]] = []
    for item in dive.items(names=dive.names - set(PICTURES.values())):
        message = dive.message(item)
        if message is None:
            continue
        story.messages[item.name] += 1
        seconds = item.stamp * 1e-9
        screen.take(item.name, message, Instant(seconds, seconds))
        if item.name == POSE:
            position, covariance = position_of(message), covariance_of(message)[:3, :3]
            if np.isfinite(position).all() and np.isfinite(covariance).all():
                deviations = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
                rows.append((stamp_of(message) * 1e-9, position, deviations))
                story.frame = str(message.header.frame_id)
        elif item.name == HEALTH:
            word = str(message.message)
            if not story.health or story.health[-1][1] != word:
                story.health.append((seconds, word))
        elif item.name == DIAGNOSTICS:
            screen.numbers(Instant(seconds, seconds))
    if rows:
        story.stamps = np.array([row[0] for row in rows])
        story.positions = np.array([row[1] for row in rows])
        story.deviations = np.array([row[2] for row in rows])
    events = screen.timeline.events.since(0)
    story.events = [
        (event, _picture_at(dive, event.wall) if number < MOST_PICTURES else b'')
        for number, event in enumerate(events)
    ]
    last = screen.numbers(Instant(story.end, story.end))
    story.drops = [(each['node'], each['reason'], each['count']) for each in last['drops']]
    return story


def _picture_at(dive: Dive, seconds: float) -> bytes:
    """A thumbnail of the first left picture from a time on; b'' where there is none."""
    first: Item | None = next(iter(dive.items(round(seconds * 1e9), (LEFT,))), None)
    picture = None if first is None else dive.picture(first)
    try:
        return b'' if picture is None else thumbnail(picture)
    except DetectionError:
        return b''
