"""What goes over the WebSocket: JSON texts both ways, pictures as binary frames.

A picture's frame is a header of sixteen bytes and the JPEG as the camera made it:

    bytes 0-3    'BPV1'
    byte  4      0 left, 1 right, 2 what `calibrate --live` sees of its board in both
    byte  5      0 as the camera made it, 1 with what the detector has drawn over it
    bytes 6-7    0
    bytes 8-15   stamp, ns, unsigned, big-endian

Stamps in texts are decimal strings of nanoseconds: a browser's numbers are too short for them.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

from binopos_ros.sides import SIDES
from binopos_ros.view.errors import ViewError

#: The pictures of the calibrator: both cameras', with what it finds and asks for.
BOARD = 'board'
KINDS = (*SIDES, BOARD)
MAGIC = b'BPV1'
HEADER = struct.Struct('>4sBBHQ')
#: Bytes; the longest text that a viewer has reason to send has about fifty.
LONGEST_REQUEST = 1024
#: Encapsulation of a serialised message.
_CDR = 4


class Picture(NamedTuple):
    """A JPEG on its way to the viewers."""

    side: str  #: or `BOARD`
    stamp: int  #: ns
    jpeg: bytes | memoryview
    drawn: bool = False  #: whether the detector has drawn over it what it sees


def picture_frame(picture: Picture) -> bytes:
    """A picture as a binary frame."""
    head = HEADER.pack(MAGIC, KINDS.index(picture.side), picture.drawn, 0, picture.stamp)
    return b''.join((head, picture.jpeg))


def read_picture_frame(frame: bytes) -> Picture:
    """The picture in a binary frame.

    Raises:
        ViewError: it is none.
    """
    if len(frame) < HEADER.size or frame[:4] != MAGIC or frame[4] >= len(KINDS):
        msg = f'binary frame of {len(frame)} bytes holds no picture'
        raise ViewError(msg)
    _, side, drawn, _, stamp = HEADER.unpack_from(frame)
    return Picture(KINDS[side], stamp, memoryview(frame)[HEADER.size :], bool(drawn))


def serialized_picture(side: str, data: bytes) -> Picture:
    """The picture in a serialised sensor_msgs/CompressedImage (CDR), without a copy of the JPEG.

    Raises:
        ViewError: the message is cut short or holds no JPEG.
    """
    try:
        order = '<' if data[1] & 1 else '>'
        seconds, rest = struct.unpack_from(f'{order}iI', data, _CDR)
        place = _CDR + 8
        for _ in range(2):
            # frame_id and format: a length, the text, and what aligns the next length.
            (length,) = struct.unpack_from(f'{order}I', data, place)
            place += 4 + length
            place += -(place - _CDR) % 4
        (length,) = struct.unpack_from(f'{order}I', data, place)
    except (struct.error, IndexError) as error:
        msg = f'{side} picture: a message of {len(data)} bytes is cut short'
        raise ViewError(msg) from error
    jpeg = memoryview(data)[place + 4 : place + 4 + length]
    if len(jpeg) < length or jpeg[:2] != b'\xff\xd8':
        msg = f'{side} picture is no JPEG, or cut short'
        raise ViewError(msg)
    return Picture(side, seconds * 10**9 + rest, jpeg)


def text(kind: str, values: Mapping[str, Any]) -> str:
    """A text of a kind for the viewers; what is not finite becomes null."""
    return json.dumps(_finite({'type': kind, **values}), separators=(',', ':'))


def read_request(words: str) -> dict[str, Any]:
    """What a viewer asks for: an object with a `type`.

    Raises:
        ViewError: it is not JSON, or no such object.
    """
    try:
        request = json.loads(words)
    except (ValueError, RecursionError) as error:
        msg = 'request is not JSON'
        raise ViewError(msg) from error
    if not isinstance(request, dict) or not isinstance(request.get('type'), str):
        msg = "request is not an object with a 'type'"
        raise ViewError(msg)
    return request


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return value
