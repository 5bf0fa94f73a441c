"""What the virtual camera says it is: USB 2.0 descriptors, and those of USB Video Class 1.0.

One configuration with a video control interface (camera terminal 1 -> processing unit 2 -> output
terminal 3) and a video streaming interface with one bulk endpoint that sends motion JPEG.
"""

from __future__ import annotations

import struct

CAMERA_TERMINAL, PROCESSING_UNIT, OUTPUT_TERMINAL = 1, 2, 3
CONTROL_INTERFACE, STREAMING_INTERFACE = 0, 1
ENDPOINT = 1
PAYLOAD = 16384
TICKS_PER_SECOND = 10_000_000
"""Of the unit in which the video class counts frame intervals."""

_VIDEO = 0x0E
_INTERFACE, _ENDPOINT, _ASSOCIATION, _CLASS_SPECIFIC = 0x04, 0x05, 0x0B, 0x24
_AUTO_EXPOSURE_AND_TIME = 0b1010
_BRIGHTNESS_CONTRAST_GAIN = 0b10_0000_0011


def device(vendor: int, product: int) -> bytes:
    """The device descriptor; strings 1 to 3 are maker, name and serial number."""
    return struct.pack(
        '<BBHBBBBHHHBBBB', 18, 1, 0x0200, 0xEF, 2, 1, 64, vendor, product, 0x0100, 1, 2, 3, 1
    )


def qualifier() -> bytes:
    """What the device would be at another speed: the same."""
    return struct.pack('<BBHBBBBBB', 10, 6, 0x0200, 0xEF, 2, 1, 64, 1, 0)


def string(text: str) -> bytes:
    """A string descriptor."""
    letters = text.encode('utf-16-le')
    return bytes([2 + len(letters), 3]) + letters


def languages() -> bytes:
    """The languages of the strings: English."""
    return bytes([4, 3, 0x09, 0x04])


def configuration(width: int, height: int, rates: tuple[int, ...]) -> bytes:
    """The configuration descriptor with everything below it.

    :param width: of the images, px, and `height`.
    :param rates: frames per second, the first by default.
    """
    body = _record(_ASSOCIATION, bytes([CONTROL_INTERFACE, 2, _VIDEO, 3, 0, 2]))
    body += _interface(CONTROL_INTERFACE, endpoints=0, subclass=1)
    body += _control_interface()
    body += _interface(STREAMING_INTERFACE, endpoints=1, subclass=2)
    body += _streaming_interface(width, height, rates)
    body += _record(_ENDPOINT, struct.pack('<BBHB', 0x80 | ENDPOINT, 2, 512, 0))
    return struct.pack('<BBHBBBBB', 9, 2, 9 + len(body), 2, 1, 0, 0x80, 250) + body


def _control_interface() -> bytes:
    units = _specific(
        0x02,
        struct.pack('<BHBBHHHB', CAMERA_TERMINAL, 0x0201, 0, 0, 0, 0, 0, 3)
        + _AUTO_EXPOSURE_AND_TIME.to_bytes(3, 'little'),
    )
    units += _specific(
        0x05,
        struct.pack(
            '<BBHBHB', PROCESSING_UNIT, CAMERA_TERMINAL, 0, 2, _BRIGHTNESS_CONTRAST_GAIN, 0
        ),
    )
    units += _specific(0x03, struct.pack('<BHBBB', OUTPUT_TERMINAL, 0x0101, 0, PROCESSING_UNIT, 0))
    head = struct.pack('<HHIBB', 0x0100, 13 + len(units), 48_000_000, 1, STREAMING_INTERFACE)
    return _specific(0x01, head) + units


def _streaming_interface(width: int, height: int, rates: tuple[int, ...]) -> bytes:
    formats = _specific(0x06, bytes([1, 1, 1, 1, 0, 0, 0, 0]))
    largest = 2 * width * height
    frame = struct.pack(
        '<BBHHIIIIB',
        1,
        0,
        width,
        height,
        8 * largest * min(rates),
        8 * largest * max(rates),
        largest,
        interval(rates[0]),
        len(rates),
    )
    frame += b''.join(struct.pack('<I', interval(rate)) for rate in rates)
    formats += _specific(0x07, frame) + _specific(0x0D, bytes([1, 1, 4]))
    head = struct.pack(
        '<BHBBBBBBBB', 1, 14 + len(formats), 0x80 | ENDPOINT, 0, OUTPUT_TERMINAL, 0, 0, 0, 1, 0
    )
    return _specific(0x01, head) + formats


def interval(rate: float) -> int:
    """The time between frames, in the video class's unit."""
    return round(TICKS_PER_SECOND / rate)


def _interface(number: int, endpoints: int, subclass: int) -> bytes:
    return _record(_INTERFACE, bytes([number, 0, endpoints, _VIDEO, subclass, 0, 0]))


def _specific(subtype: int, content: bytes) -> bytes:
    return _record(_CLASS_SPECIFIC, bytes([subtype]) + content)


def _record(kind: int, content: bytes) -> bytes:
    return bytes([2 + len(content), kind]) + content
