"""A camera's stage in a process of its own, so that both cameras are looked at at the same time.

Threads of one interpreter do not do that. To find a target takes some hundred short calls, each of
which lets go of the interpreter's lock and asks for it again: two threads that do so keep waking
each other up. They take twice the processor time of one after the other, and longer.

Pictures cross in memory that both processes share, all else through a socket.
"""

from __future__ import annotations

import math
import mmap
import os
import signal
import subprocess
import sys
from collections import deque
from contextlib import suppress
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import cv2

from binopos_ros.optics import CameraInfo

from .images import Bytes, JpegImage, RawImage
from .options import DetectorOptions
from .stage import CameraStage
from .target import Detection

#: Memories for pictures, in turns: while one is filled, the one before may still be looked over.
MEMORIES = 2
#: Seconds between looks at a process that does not answer, and how many of them in a row find it
#: stopped, or waiting and without a tick of processor time in between, where it hangs.
LOOK_AFTER, LOOKS = 0.4, 3
#: Seconds of processor time for one picture after which the process runs in circles: the largest
#: picture that is taken at all needs less than two.
CIRCLING = 5.0
TICKS = os.sysconf('SC_CLK_TCK')
#: What Python runs: with the modules of this process, whatever lies in the working folder.
STARTER = (
    'import sys; sys.path[:] = sys.argv[1].split(":"); '
    'from binopos_ros.detection.apart import serve; serve(*map(int, sys.argv[2:]))'
)


class StageApart:
    """A `CameraStage` in another process. A picture is given by `begin`, and answered by `end`.

    Where that process ends or hangs, the picture that it had gets no target, and another one is
    started. `configure` and `set_camera` may be called by another thread than the rest.

    Args:
        options: of the detector.
        phase: see `Detector`.
    """

    def __init__(self, options: DetectorOptions, phase: int = 0) -> None:
        self._options, self._phase = options, phase
        self._info: CameraInfo | None = None
        self._news: deque[tuple[object, ...]] = deque()
        self._memories = [_Memory(os.memfd_create('picture')) for _ in range(MEMORIES)]
        self._turn = 0
        self._start()

    def configure(self, options: DetectorOptions) -> None:
        """Take new options; where the target was is forgotten."""
        self._options = options
        self._news.append(('configure', options))

    def set_camera(self, info: CameraInfo) -> None:
        """Take the calibration that the images must agree with in size.

        Raises:
            OpticsError: the calibration cannot be used.
        """
        if info != self._info:
            info.camera()
            self._info = info
            self._news.append(('set_camera', info))

    def begin(self, stamp: int, image: JpegImage | RawImage, survey: bool = False) -> None:
        """Give the next picture.

        Args:
            stamp: nanoseconds.
            image: as it arrived.
            survey: see `CameraStage.detect`.
        """
        self._turn = (self._turn + 1) % MEMORIES
        size = self._memories[self._turn].put(image.data)
        with suppress(OSError):
            # Where the process has ended, `end` will find out.
            while self._news:
                self._link.send(self._news.popleft())
            self._link.send(('look', self._turn, size, stamp, replace(image, data=b''), survey))

    def end(self) -> Detection:
        """Wait for the answer to the picture."""
        try:
            trouble = self._trouble()
            if not trouble:
                found: Detection = self._link.recv()
                return found
        except (EOFError, OSError):
            trouble = ''
        self._process.kill()
        status = self._process.wait()
        told = trouble or (f'was killed by signal {-status}' if status < 0 else 'has ended')
        self._link.close()
        self._start()
        return Detection(None, f'the process that looks at these pictures {told}: a new one does')

    def close(self) -> None:
        """End the process."""
        self._link.close()
        self._process.kill()
        self._process.wait()
        for memory in self._memories:
            os.close(memory.descriptor)

    def _start(self) -> None:
        self._link, other = Pipe()
        passed = [other.fileno(), *(memory.descriptor for memory in self._memories)]
        words = [':'.join(sys.path), *map(str, passed)]
        self._process = subprocess.Popen(
            [sys.executable, '-c', STARTER, *words], pass_fds=passed, stdin=subprocess.DEVNULL
        )
        other.close()
        self._news.clear()
        self._link.send(('start', self._options, self._phase))
        if self._info is not None:
            self._link.send(('set_camera', self._info))

    def _trouble(self) -> str:
        """Wait until there is an answer, or the process hangs, which is told."""
        idle: deque[float] = deque(maxlen=LOOKS)
        at_first = math.inf
        while not self._link.poll(LOOK_AFTER):
            state, used = _state(self._process.pid)
            at_first = min(at_first, used)
            if used - at_first > CIRCLING:
                return f'was busy for {used - at_first:.1f} s with one picture'
            if state not in 'ST':
                idle.clear()
                continue
            idle.append(used)
            if len(idle) == LOOKS and idle[0] == idle[-1]:
                return 'was stopped' if state == 'T' else 'only waited'
        return ''


def serve(link: int, *memories: int) -> None:
    """Be the other process, until the one that has started this is gone.

    Args:
        link: descriptor of the socket's end.
        memories: descriptors of what holds pictures.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        # They go to the whole group of processes; the one that has started this ends it.
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError):
        # What `ps` and `top` show.
        Path('/proc/self/comm').write_text('detector apart')
    cv2.setNumThreads(1)
    with suppress(EOFError, ConnectionError):
        _answer(Connection(link), [_Memory(each) for each in memories])


def _answer(link: Connection, memories: list[_Memory]) -> None:
    _, options, phase = link.recv()
    stage = CameraStage(options, phase)
    while True:
        word, *values = link.recv()
        if word == 'configure':
            stage.configure(*values)
        elif word == 'set_camera':
            stage.set_camera(*values)
        else:
            turn, size, stamp, image, survey = values
            frame = stage.prepare(replace(image, data=memories[turn].picture(size)))
            link.send(stage.detect(stamp, frame, survey))
            stage.look_over()


class _Memory:
    """Memory that two processes share, by a file that lies in no folder."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._mapped: mmap.mmap | None = None

    def put(self, data: Bytes) -> int:
        """Copy a picture's data in; its size in bytes."""
        octets = memoryview(data).cast('B')  # type: ignore[arg-type]
        if self._mapped is None or len(self._mapped) < octets.nbytes:
            os.ftruncate(self.descriptor, 2 * octets.nbytes + mmap.PAGESIZE)
        self._map(octets.nbytes)[: octets.nbytes] = octets
        return octets.nbytes

    def picture(self, size: int) -> memoryview:
        """The picture's data, until another one is put in their place."""
        return memoryview(self._map(size))[:size]

    def _map(self, size: int) -> mmap.mmap:
        if self._mapped is None or len(self._mapped) < size:
            # Whoever still looks at a part of the former one keeps it.
            self._mapped = mmap.mmap(self.descriptor, 0)
        return self._mapped


def _state(pid: int) -> tuple[str, float]:
    """The state of a process as proc(5) writes it, and seconds of processor time it has used."""
    try:
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    except OSError:
        return 'X', 0.0
    return fields[0], (int(fields[11]) + int(fields[12])) / TICKS
