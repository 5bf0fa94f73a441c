"""A dive that was recorded, as a source of the page: play, stand, step, go to a place."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from binopos_ros.view.dive import PICTURES, POSE, Dive, Item
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.screen import Instant
from binopos_ros.view.server import PageServer
from binopos_ros.view.source import Answer, Look

#: s of numbers before a place that are read when it is gone to, and of pictures.
BEFORE, PICTURES_BEFORE = 20.0, 0.5
#: s of the bag within which the pose before this one is looked for.
BACK = 10.0
#: s between looks at what is asked for, while the bag stands or waits for the next message.
LOOK = 0.02
SLOWEST, FASTEST = 0.05, 20.0


class BagPage:
    """Serves the page on a dive; from the making on until `close`.

    Raises:
        ViewError: the page cannot be served.
    """

    def __init__(self, dive: Dive, options: ViewerOptions) -> None:
        self._dive = dive
        self._wishes: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._at = dive.start
        self._rate = 1.0
        self._playing = False
        self._since = 0.0
        self._coming: Iterator[Item] = iter(())
        self._next: Item | None = None
        self._stop = threading.Event()
        self._server = PageServer(options, self)
        self._server.start()
        self._go_to(dive.start)

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return self._server.address

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Play and do what viewers ask for, until it is stopped."""
        while not (stop() or self._stop.is_set()):
            self._work()

    def close(self) -> None:
        """End `run`, and send the viewers away."""
        self._stop.set()
        self._server.close()

    def about(self) -> Mapping[str, Any]:
        """As `Source`."""
        name = ' + '.join(path.name for path in self._dive.paths)
        duration = (self._dive.end - self._dive.start) * 1e-9
        return {
            'title': name,
            'mode': 'bag',
            'buttons': [],
            'duration': duration,
            'at': self._place(),
        }

    def more(self) -> Mapping[str, Any]:
        """As `Source`: the place in the bag."""
        duration = (self._dive.end - self._dive.start) * 1e-9
        return {
            'player': {'at': self._place(), 'duration': duration, 'playing': self._playing},
        }

    def instant(self) -> Instant:
        """As `Source`: in the time of the bag."""
        seconds = self._now() * 1e-9
        return Instant(seconds, seconds)

    def look(self, look: Look) -> None:
        """As `Source`: a bag that nobody looks at stands."""
        if not look.numbers:
            self._wishes.put(self._pause)

    def ask(self, request: Mapping[str, Any], answer: Answer) -> None:
        """As `Source`."""
        kind = request['type']
        if kind == 'play':
            self._wishes.put(self._play)
        elif kind == 'pause':
            self._wishes.put(self._stand)
        elif kind == 'seek' and (place := _figure(request.get('at'))) is not None:
            stamp = self._dive.start + round(max(place, 0.0) * 1e9)
            self._wishes.put(lambda: self._go_to(min(stamp, self._dive.end)))
        elif kind == 'speed' and (rate := _figure(request.get('rate'))) is not None:
            self._wishes.put(lambda: self._set_rate(min(max(rate, SLOWEST), FASTEST)))
        elif kind == 'step' and request.get('by') in (-1, 1):
            self._wishes.put(self._step if request['by'] == 1 else self._step_back)
        else:
            answer(False, 'not known')

    def _work(self) -> None:
        try:
            while True:
                self._wishes.get_nowait()()
        except queue.Empty:
            pass
        if not self._playing:
            self._stop.wait(LOOK)
            return
        now = self._now()
        while self._next is not None and self._next.stamp <= now:
            self._feed(self._next)
            self._next = next(self._coming, None)
        if self._next is None:
            self._stand()
        else:
            self._stop.wait(min((self._next.stamp - now) * 1e-9 / self._rate, LOOK))

    def _now(self) -> int:
        if not self._playing:
            return self._at
        passed = (time.monotonic() - self._since) * self._rate
        return min(self._at + round(passed * 1e9), self._dive.end)

    def _place(self) -> float:
        return (self._now() - self._dive.start) * 1e-9

    def _play(self) -> None:
        if self._at >= self._dive.end:
            self._go_to(self._dive.start)
        self._since = time.monotonic()
        self._playing = True

    def _pause(self) -> None:
        self._at = self._now()
        self._playing = False

    def _stand(self) -> None:
        """Pause, with all that belongs to the place."""
        self._pause()
        self._go_to(self._at)

    def _set_rate(self, rate: float) -> None:
        self._at, self._since = self._now(), time.monotonic()
        self._rate = rate

    def _go_to(self, stamp: int) -> None:
        """Show what was there at a time: the curves that led there, and the pictures."""
        self._at, self._since = stamp, time.monotonic()
        self._server.post(self._server.screen.reset)
        numbers = self._dive.names - set(PICTURES.values())
        for item in self._dive.items(stamp - round(BEFORE * 1e9), numbers):
            if item.stamp > stamp:
                break
            self._feed(item)
        newest: dict[str, Item] = {}
        for item in self._dive.items(stamp - round(PICTURES_BEFORE * 1e9), PICTURES.values()):
            if item.stamp > stamp:
                break
            newest[item.name] = item
        for item in newest.values():
            self._feed(item)
        self._coming = self._dive.items(stamp + 1)
        self._next = next(self._coming, None)

    def _step(self) -> None:
        """To the next pose, with its pictures."""
        self._pause()
        for item in self._dive.items(self._at + 1, (POSE,)):
            self._go_to(item.stamp)
            return

    def _step_back(self) -> None:
        self._pause()
        before = None
        for item in self._dive.items(self._at - round(BACK * 1e9), (POSE,)):
            if item.stamp >= self._at:
                break
            before = item
        if before is not None:
            self._go_to(before.stamp)

    def _feed(self, item: Item) -> None:
        seconds = item.stamp * 1e-9
        if item.name in PICTURES.values():
            picture = self._dive.picture(item)
            if picture is not None:
                self._server.post(self._server.show, picture)
            return
        message = self._dive.message(item)
        if message is not None:
            instant = Instant(seconds, seconds)
            self._server.post(self._server.screen.take, item.name, message, instant)


def _figure(value: Any) -> float | None:
    """A finite number, or None."""
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if is_number and math.isfinite(value) else None
