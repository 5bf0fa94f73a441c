"""Copies of bags as other people's rigs record them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from binopos_ros.bag import BagReader, BagWriter, messages

#: Of the bag that is copied.
PAIRS = 8
LEFT, RIGHT = '/stereo/left', '/stereo/right'
JPEG, INFO = 'image_raw/compressed', 'camera_info'


class Entry(NamedTuple):
    """A message on its way into a bag."""

    topic: str
    log_ns: int
    message: Any
    type: str = ''  #: '' keeps that of the topic it came from


Change = Callable[[Entry], 'Entry | list[Entry] | None']


def rewritten(bag: Path, copy: Path, change: Change, *, repeat: int = 1) -> Path:
    """A copy of a bag: `change` gives what becomes of each message; `repeat` plays it again."""
    entries: list[Entry] = []
    with BagReader(bag) as reader:
        length = reader.end_ns - reader.start_ns + 33_333_333
        for turn in range(repeat):
            for record in reader.messages():
                message = reader.decode(record)
                stamp = messages.stamp_of(message) + turn * length
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
                log_ns = record.stamp_ns + turn * length
                kind = reader.topics[record.topic].type
                changed = change(Entry(record.topic, log_ns, message, kind))
                entries += changed if isinstance(changed, list) else [changed] if changed else []
    with BagWriter(copy) as writer:
        for topic, kind in {entry.topic: entry.type for entry in entries}.items():
            writer.add_topic(topic, kind)
        for entry in sorted(entries, key=lambda each: each.log_ns):
            writer.write(entry.topic, entry.log_ns, entry.message)
    (copy / 'binopos.yaml').write_text((bag / 'binopos.yaml').read_text())
    return copy


def renamed(names: dict[str, str]) -> Change:
    """Topics that begin with a name begin with another."""

    def rename(entry: Entry) -> Entry:
        for old, new in names.items():
            if entry.topic.startswith(old):
                return entry._replace(topic=new + entry.topic.removeprefix(old))
        return entry

    return rename


def pixels_of(entry: Entry) -> np.ndarray:
    """A compressed picture's pixels, (height, width, 3), BGR."""
    return np.asarray(cv2.imdecode(entry.message.data, cv2.IMREAD_COLOR))


def raw(entry: Entry, pixels: np.ndarray | None = None, encoding: str = 'bgr8') -> Entry:
    """The same picture, or another, as sensor_msgs/Image."""
    pixels = np.ascontiguousarray(pixels_of(entry) if pixels is None else pixels)
    height, width = pixels.shape[:2]
    message = messages.image(
        messages.stamp_of(entry.message),
        entry.message.header.frame_id,
        pixels.view(np.uint8).ravel(),
        (width, height),
        encoding,
        pixels.nbytes // height,
    )
    return entry._replace(message=message, type=messages.IMAGE)
