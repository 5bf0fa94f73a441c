"""A bag as the live nodes want it played: the contract's names, one stream of pictures per camera.

What the bag calls its topics, that two views lie side by side in one picture, that pictures are
rectified: all this ends here, so that the nodes see the rig that they know.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from binopos_ros.bag import BagError, BagReader, Record, TopicInfo, messages
from binopos_ros.bag.definitions import definition_of, jazzy
from binopos_ros.bag.playback import absolute, renaming
from binopos_ros.bag.rig_topics import BOTH, SUFFIXES, RigTopics, Role
from binopos_ros.cli.recorded_calibration import camera_info_of
from binopos_ros.detection import DetectionError
from binopos_ros.detection.images import decode, halves, image_of
from binopos_ros.sides import SIDES


class RigBag:
    """A view of a bag for the player, with the attributes of a `BagReader`.

    Args:
        reader: the bag.
        found: which of its topics are the rig's.
        remap: FROM:=TO, for the other topics.

    Attributes:
        rig: the rig's topics by the names that they have here.
        dropped: pictures that could not be halved, by reason.
        notes: calibrations that were left out.
    """

    def __init__(self, reader: BagReader, found: RigTopics, remap: Collection[str] = ()) -> None:
        self._reader = reader
        self._found = found
        self._rename = renaming(tuple(remap))
        self._in_bag: dict[str, str] = {}
        self.topics: dict[str, TopicInfo] = {}
        self.dropped: dict[str, int] = {}
        self.notes: list[str] = []
        self._bodies: dict[str, tuple[bytes, bytes]] = {}
        roles: dict[str, Role] = {}
        for topic, role in found.roles.items():
            for name, own in self._names_of(topic, role):
                roles[name] = own
                self._in_bag[name] = topic
                self.topics[name] = self._info(topic, own)
        for topic, info in reader.topics.items():
            name = self._rename(topic)
            if topic not in found.roles and name not in self.topics:
                self._in_bag[name] = topic
                self.topics[name] = info
        self.rig = replace(found, roles=roles)

    @property
    def path(self) -> Path:
        """Where the bag lies."""
        return self._reader.path

    @property
    def start_ns(self) -> int:
        """Time of the first message."""
        return self._reader.start_ns

    @property
    def end_ns(self) -> int:
        """Time of the last message."""
        return self._reader.end_ns

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return self._reader.message_count

    def name_of(self, topic: str) -> str:
        """The name here of a topic that is named as in the bag, or as here."""
        names = {absolute(old): new for new, old in self._in_bag.items()}
        name = absolute(topic)
        return name if name in self.topics else names.get(name, name)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Messages in the order of their log time, as `BagReader.messages` gives them."""
        names = list(self.topics) if topics is None else list(topics)
        wanted: dict[str, list[str]] = {}
        for name in names:
            wanted.setdefault(self._in_bag[name], []).append(name)
        for record in self._reader.messages(wanted, start_ns):
            yield from self._translated(record, wanted[record.topic])

    def _names_of(self, topic: str, role: Role) -> list[tuple[str, Role]]:
        if role.side != BOTH:
            return [(self._found.name_of(topic), role)]
        namespace = self._found.namespace
        return [(f'{namespace}/{side}/{SUFFIXES["raw"]}', Role('raw', side)) for side in SIDES]

    def _info(self, topic: str, own: Role) -> TopicInfo:
        info = self._reader.topics[topic]
        if self._found.roles[topic].side == BOTH:
            return replace(info, type=messages.IMAGE, definition=definition_of(messages.IMAGE))
        return info

    def _translated(self, record: Record, names: list[str]) -> Iterable[Record]:
        role = self._found.roles.get(record.topic)
        if role is not None and role.side == BOTH:
            return self._halved(record, names)
        if role is not None and role.kind == 'camera_info':
            return self._calibration(record, role.side, names[0])
        return [record._replace(topic=names[0])]

    def _calibration(self, record: Record, side: str, name: str) -> Iterable[Record]:
        """A camera_info for the pictures as they are; one that cannot be used is left out."""
        # Cameras repeat it with every image; only the stamp in front differs.
        body = record.data[messages.STAMP_END :]
        if self._bodies.get(side, (b'', b''))[0] != body:
            self._bodies[side] = body, self._usable(record, side)
        own = self._bodies[side][1]
        if not own:
            return []
        return [record._replace(topic=name, data=record.data[: messages.STAMP_END] + own)]

    def _usable(self, record: Record, side: str) -> bytes:
        """What follows the stamp in the serialised camera_info, b'' where it cannot be used."""
        try:
            message = self._reader.decode(record)
            info = camera_info_of(message, side, rectified=self._found.rectified)
        except ValueError as error:
            self.notes.append(f'a camera_info of the {side} camera is left out: {error}')
            return b''
        self.notes += info.contradictions()
        if not self._found.rectified:
            return record.data[messages.STAMP_END :]
        own = messages.camera_info(messages.stamp_of(message), str(message.header.frame_id), info)
        return bytes(jazzy().serialize_cdr(own, messages.CAMERA_INFO))[messages.STAMP_END :]

    def _halved(self, record: Record, names: list[str]) -> Iterable[Record]:
        try:
            message = self._reader.decode(record)
            frames = dict(zip(SIDES, halves(decode(image_of(message))), strict=True))
        except (BagError, DetectionError) as error:
            self._drop(str(error))
            return []
        header = messages.stamp_of(message), str(message.header.frame_id)
        records: list[Record] = []
        for name in names:
            frame = frames[self.rig.roles[name].side]
            pixels = frame.window(0, 0, frame.width, frame.height)
            own = messages.image(
                *header, pixels.ravel(), (frame.width, frame.height), 'bgr8', 3 * frame.width
            )
            data = bytes(jazzy().serialize_cdr(own, messages.IMAGE))
            records.append(record._replace(topic=name, data=data))
        return records

    def _drop(self, reason: str) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1
