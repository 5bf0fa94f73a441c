"""Two cameras' messages merged by the stamps of their images, however late they were logged.

A recorder writes what arrives when it arrives: one camera's images may lie seconds behind those of
the other in the file, although they were taken together. A reader of the whole bag can do better
than the order of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.messages import serialized_stamp, serialized_transform_stamp
from binopos_ros.bag.reader import BagReader
from binopos_ros.bag.records import Record
from binopos_ros.bag.rig_topics import RigTopics
from binopos_ros.pairing import RESTART
from binopos_ros.sides import SIDES


class _Stream:
    """One camera's records in the order of the file, each with its place in the merged order.

    The place is the stamp of the last image. Where stamps jump, because a recording was started
    anew, it goes on by the time of logging instead, so that both cameras go through the jump
    together.
    """

    def __init__(self, records: Iterator[Record], images: Collection[str]) -> None:
        self._records = records
        self._images = images
        self._shift = 0  # place minus stamp
        self._logged: int | None = None
        self.place = 0
        self.head: Record | None = None
        self.advance()

    def advance(self) -> None:
        """Go on to the next record."""
        self.head = next(self._records, None)
        if self.head is not None and self.head.topic in self._images:
            # One that is too short for a stamp is refused where it is decoded.
            with suppress(BagError):
                self._move(serialized_stamp(self.head.data), self.head.stamp_ns)

    def _move(self, stamp: int, logged: int) -> None:
        if self._logged is not None:
            expected = self.place + logged - self._logged
            if stamp + self._shift < self.place - RESTART:
                # Back where it was before a jump, or somewhere new.
                self._shift = 0 if abs(stamp - expected) < RESTART else expected - stamp
            elif self._shift and abs(stamp - expected) < RESTART:
                self._shift = 0
        self.place, self._logged = stamp + self._shift, logged


class _Robot:
    """The records of a robot's motion in the order of the file, by their stamps.

    Some transforms are stamped ahead of their time, so that nobody waits for them; these come by
    the time of logging.
    """

    def __init__(
        self, records: Iterator[Record], stamp_of: dict[str, Callable[[bytes], int]]
    ) -> None:
        self._records = records
        self._stamp_of = stamp_of
        self.place = 0
        self.head: Record | None = None
        self.advance()

    def advance(self) -> None:
        """Go on to the next record."""
        self.head = next(self._records, None)
        if self.head is not None:
            self.place = self.head.stamp_ns
            with suppress(BagError):
                stamp = self._stamp_of[self.head.topic](self.head.data)
                self.place = min(self.place, stamp)


def by_stamp(reader: BagReader, topics: RigTopics) -> Iterator[Record]:
    """The rig's messages by the stamps of its images, left first where equal.

    The others stay before the image that they precede in the file. How the robot moves comes by
    its own stamps, after an image of the same; what of it is static comes first of all.
    """
    images = {side: topics.of('image', side) for side in SIDES}
    of_side: dict[str, list[str]] = {side: [] for side in SIDES}
    robot: dict[str, Callable[[bytes], int]] = {}
    static = []
    for topic, role in topics.roles.items():
        if role.kind == 'static transforms':
            static.append(topic)
        elif role.kind == 'transforms':
            robot[topic] = serialized_transform_stamp
        elif role.kind == 'odometry':
            robot[topic] = serialized_stamp
        else:
            # The truth is of no camera, and views that lie side by side cannot part.
            of_side['left' if role.side not in SIDES else role.side].append(topic)
    if static:
        yield from reader.messages(static)
    if images['left'] == images['right']:
        of_side = {'left': of_side['left'] + of_side['right'], 'right': []}
    streams: list[_Stream | _Robot] = [
        _Stream(reader.messages(of_side[side]), images[side]) for side in SIDES if of_side[side]
    ]
    if robot:
        streams.append(_Robot(reader.messages(robot), robot))
    while waiting := [stream for stream in streams if stream.head is not None]:
        stream = min(waiting, key=lambda each: each.place)
        assert stream.head is not None
        yield stream.head
        stream.advance()
