"""USB/IP as far as a virtual device needs it, over a socket whose other end the kernel holds.

The messages are those of the kernel's "USB/IP protocol" document: a header of five big-endian
words (command, sequence number, device, direction, endpoint), and 28 bytes after it.
"""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

CONTROLLER = Path('/sys/devices/platform/vhci_hcd.0')

CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = range(1, 5)
DIRECTION_IN = 1
ECONNRESET, EPIPE = 104, 32

_FREE = 4
_HIGH_SPEED = 3
_HEADER = struct.Struct('>5I')
_SUBMIT = struct.Struct('>I4i8s')
_RETURN = struct.Struct('>5i8x')
_UNLINK = struct.Struct('>I24x')
_UNLINKED = struct.Struct('>i24x')


@dataclass(frozen=True)
class Transfer:
    """A request of the host's: `length` bytes wanted (in), or `data` sent (out)."""

    number: int
    endpoint: int
    inward: bool
    length: int
    setup: bytes
    data: bytes


@dataclass(frozen=True)
class Unlink:
    """The host's wish to have a transfer back."""

    number: int
    victim: int


class Link:
    """One plugged-in device's connection to the kernel."""

    def __init__(self, channel: socket.socket, port: int) -> None:
        self.port = port
        self._channel = channel
        self._sending = threading.Lock()

    def receive(self) -> Transfer | Unlink:
        """Wait for the next request. Raises EOFError once the link is closed."""
        command, number, _, direction, endpoint = _HEADER.unpack(self._read(_HEADER.size))
        rest = self._read(_SUBMIT.size)
        if command == CMD_UNLINK:
            return Unlink(number, *_UNLINK.unpack(rest))
        _, length, _, _, _, setup = _SUBMIT.unpack(rest)
        inward = direction == DIRECTION_IN
        data = b'' if inward or not length else self._read(length)
        return Transfer(number, endpoint, inward, length, setup, data)

    def complete(self, transfer: Transfer, data: bytes = b'', status: int = 0) -> None:
        """Answer a transfer; `status` is a negative errno where it failed."""
        length = len(data) if transfer.inward else len(transfer.data)
        self._send(
            _HEADER.pack(RET_SUBMIT, transfer.number, 0, 0, 0)
            + _RETURN.pack(status, length, 0, 0, 0)
            + data
        )

    def unlinked(self, unlink: Unlink, in_time: bool) -> None:
        """Answer an unlink: in time, or the transfer had been answered already."""
        status = -ECONNRESET if in_time else 0
        self._send(_HEADER.pack(RET_UNLINK, unlink.number, 0, 0, 0) + _UNLINKED.pack(status))

    def close(self) -> None:
        """Pull the plug."""
        with suppress(OSError):
            self._channel.shutdown(socket.SHUT_RDWR)
        self._channel.close()

    def _send(self, message: bytes) -> None:
        with self._sending:
            self._channel.sendall(message)

    def _read(self, count: int) -> bytes:
        parts = []
        while count:
            try:
                part = self._channel.recv(count)
            except OSError as error:
                raise EOFError from error
            if not part:
                raise EOFError
            parts.append(part)
            count -= len(part)
        return b''.join(parts)


def plug(port: int | None = None) -> Link:
    """Plug a high-speed device into a port of the controller, by default the first free one."""
    if port is None:
        port = free_ports()[0]
    ours, kernels = socket.socketpair()
    with kernels:
        device = 0x10001 + port
        # The kernel takes a reference of its own to the socket.
        (CONTROLLER / 'attach').write_text(f'{port} {kernels.fileno()} {device} {_HIGH_SPEED}\n')
    return Link(ours, port)


def free_ports() -> list[int]:
    """The high-speed ports that nothing is plugged into."""
    rows = [line.split() for line in (CONTROLLER / 'status').read_text().splitlines()[1:]]
    return [int(row[1]) for row in rows if row[0] == 'hs' and int(row[2]) == _FREE]
