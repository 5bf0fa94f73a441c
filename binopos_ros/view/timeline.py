"""The timeline: what happened, when, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from binopos_ros.reasons import shown
from binopos_ros.view.remedies import remedy_for
from binopos_ros.view.ring import Ring

#: Events that are kept.
LENGTH = 500
#: s; a stamp that goes back, or ahead of the one before, by more than this is a jump of the clock.
JUMP_BACK, JUMP_AHEAD = 0.5, 30.0
GOOD, NOTE, WARNING, ALARM = 'good', 'note', 'warning', 'alarm'
_TARGET = {'degraded': WARNING, 'lost': ALARM}
#: Of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = range(4)
WELL = (OK, '')


class Event(NamedTuple):
    """Something that happened."""

    wall: float  #: s since the epoch
    grade: str  #: good, note, warning or alarm
    about: str  #: 'target', 'clock' or a node's name
    text: str
    remedy: str = ''


@dataclass
class Timeline:
    """Makes events of what changes; what goes on as it was is none."""

    events: Ring[Event] = field(default_factory=lambda: Ring(LENGTH))
    _found: bool = False
    _word: str = ''
    _troubles: dict[str, tuple[int, str]] = field(default_factory=dict)
    _stamp: int = 0

    def add(self, wall: float, grade: str, about: str, text: str, remedy: str = '') -> None:
        """Add an event."""
        self.events.add(Event(wall, grade, about, shown(text), remedy))

    def health(self, wall: float, word: str, reason: str) -> None:
        """The word on the target, whenever it is told."""
        if word in ('coasting', self._word):
            # Coasting comes and goes between two pictures; what it leads to is an event.
            return
        self._word = word
        if word == 'tracking':
            self.add(wall, GOOD, 'target', 'target found' if not self._found else 'target is well')
        elif word != 'starting':
            text = f'target {word}: {reason}' if reason else f'target {word}'
            self.add(wall, _TARGET.get(word, NOTE), 'target', text, remedy_for(reason, word))
        self._found = word in ('tracking', 'degraded')

    def node(self, wall: float, name: str, level: int, message: str) -> None:
        """What a node says of itself, once per second: an event where its trouble is another."""
        # Single drops are counted elsewhere; they come and go from second to second.
        is_count = level == WARN and message[:1].isdigit()
        trouble = WELL if is_count or level == OK else (level, message)
        before = self._troubles.get(name)
        if before is None and level == STALE:
            # It waits for its first input, and has lost nothing yet.
            return
        self._troubles[name] = trouble
        if trouble == WELL and before not in (None, WELL):
            self.add(wall, GOOD, name, 'runs well again')
        elif trouble not in (before, WELL):
            self.add(
                wall, ALARM if level == ERROR else WARNING, name, message, remedy_for(message)
            )

    def absent(self, wall: float, name: str) -> None:
        """A node has said nothing for long."""
        trouble = (ERROR, 'says nothing any more')
        if self._troubles.get(name) != trouble:
            self._troubles[name] = trouble
            self.add(wall, ALARM, name, trouble[1], remedy_for(trouble[1]))

    def stamp(self, wall: float, stamp: int) -> bool:
        """A pose's stamp, ns; whether the clock has jumped back before it."""
        step = (stamp - self._stamp) * 1e-9 if self._stamp else 0.0
        self._stamp = stamp
        if step > JUMP_AHEAD:
            self.add(wall, NOTE, 'clock', f"no pose for {step:.0f} s of the pictures' time")
        elif step < -JUMP_BACK:
            text = f"the pictures' time jumped back by {-step:.1f} s"
            self.add(wall, WARNING, 'clock', text, remedy_for(text))
            return True
        return False
