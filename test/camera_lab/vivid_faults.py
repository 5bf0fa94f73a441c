"""Runs in the guest: the kernel's own test driver fails in its own ways.

    python vivid_faults.py OUT

For each error that vivid can inject, a camera that streams is hit, and the time until good frames
come again is measured. OUT receives `vivid.json`.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from timing import Result, shortest

from binopos_ros.capture.options import Wanted
from binopos_ros.capture.recovery import SteadyCamera

INJECTIONS = {
    'inject_fatal_streaming_error': 'failed',
    'inject_vidioc_qbuf_error': 'failed',
    'inject_v4l2_buf_flag_error': '',
}
"""The control that brings the error about -> the cause that the loss is counted under."""

REFUSALS = ('inject_vidioc_reqbufs_error', 'inject_vidioc_streamon_error')
PATIENCE = 60.0


def wait_for(condition: Callable[[], object]) -> bool:
    """Wait until the condition holds; False where it does not in time."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def descriptors() -> int:
    """How many files this process has open."""
    return len(os.listdir('/proc/self/fd'))


@contextmanager
def reading(controls: dict[str, int | str] | None = None) -> Iterator[tuple[SteadyCamera, Result]]:
    """A steady camera that is read in a thread, and the result to fill in."""
    camera = SteadyCamera('/dev/video0', Wanted('YUYV', 320, 180, 30.0), controls=controls)
    result: Result = {}
    before = descriptors()
    thread = threading.Thread(target=lambda: [None for _ in camera.frames()])
    thread.start()
    try:
        yield camera, result
    finally:
        camera.stop()
        thread.join()
    result['descriptors_left'] = descriptors() - before


def hit(name: str, cause: str) -> Result:
    """Stream, inject the error, and see what comes of it."""
    with reading() as (camera, result):
        wait_for(lambda: camera.health.good > 5)
        good = camera.health.good
        camera.set_control(name, 1)
        camera.leave_control(name)
        injected = time.monotonic()
        health = camera.health
        result['noticed'] = wait_for(lambda: health.losses[cause] if cause else health.corrupt)
        result['recovered'] = wait_for(lambda: health.good > good + 5)
        result['seconds'] = time.monotonic() - injected
    return result


def refuse(name: str) -> Result:
    """Have the driver refuse the next start of a stream, then start one."""
    with reading({name: 1}) as (camera, result):
        result['noticed'] = wait_for(lambda: 'cannot start streaming' in camera.health.trouble)
        camera.leave_control(name)
        began = time.monotonic()
        result['recovered'] = wait_for(lambda: camera.health.good > 5)
        result['seconds'] = time.monotonic() - began
    return result


def disconnect() -> Result:
    """Disconnect the device, which is final."""
    with reading() as (camera, result):
        wait_for(lambda: camera.health.good > 5)
        camera.set_control('disconnect', 1)
        result['noticed'] = wait_for(lambda: camera.health.losses['gone'])
        result['trouble'] = camera.health.trouble
    return result


def main(out: Path) -> None:
    """Go through all errors; the disconnect last, for it is final."""
    results = {name: shortest(partial(refuse, name), 'seconds') for name in REFUSALS}
    results |= {
        name: shortest(partial(hit, name, cause), 'seconds') for name, cause in INJECTIONS.items()
    }
    results['disconnect'] = disconnect()
    (out / 'vivid.json').write_text(json.dumps(results, indent=1))


if __name__ == '__main__':
    main(Path(sys.argv[1]))
