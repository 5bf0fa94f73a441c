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
from pathlib import Path

from binopos_ros.capture.recovery import SteadyCamera, Wanted

INJECTIONS = {
    'inject_fatal_streaming_error': 'failed',
    'inject_vidioc_qbuf_error': 'failed',
    'inject_v4l2_buf_flag_error': '',
    'disconnect': 'gone',
}
"""The control that brings the error about -> the cause that the loss is counted under."""

REFUSALS = ('inject_vidioc_reqbufs_error', 'inject_vidioc_streamon_error')
PATIENCE = 15.0


def wait_for(condition) -> bool:
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


def hit(name: str, cause: str) -> dict[str, object]:
    """Stream, inject the error, and see what comes of it."""
    camera = SteadyCamera('/dev/video0', Wanted('YUYV', 320, 180, 30.0))
    before = descriptors()
    thread = threading.Thread(target=lambda: [None for _ in camera.frames()])
    thread.start()
    streamed = wait_for(lambda: camera.health.good > 5)
    good = camera.health.good
    camera.set_control(name, 1)
    camera.leave_control(name)
    injected = time.monotonic()
    noticed = wait_for(lambda: camera.health.losses[cause] if cause else camera.health.corrupt)
    result: dict[str, object] = {'streamed': streamed, 'noticed': noticed}
    if name != 'disconnect':
        # A device that vivid has disconnected does not come back.
        result['recovered'] = wait_for(lambda: camera.health.good > good + 5)
        result['seconds'] = time.monotonic() - injected
    result['trouble'] = camera.health.trouble
    camera.stop()
    thread.join()
    result['descriptors_left'] = descriptors() - before
    return result


def refuse(name: str) -> dict[str, object]:
    """Have the driver refuse the next start of a stream, then start one."""
    camera = SteadyCamera('/dev/video0', Wanted('YUYV', 320, 180, 30.0), controls={name: 1})
    thread = threading.Thread(target=lambda: [None for _ in camera.frames()])
    before = descriptors()
    thread.start()
    noticed = wait_for(lambda: 'cannot start streaming' in camera.health.trouble)
    camera.leave_control(name)
    began = time.monotonic()
    recovered = wait_for(lambda: camera.health.good > 5)
    seconds = time.monotonic() - began
    camera.stop()
    thread.join()
    return {
        'noticed': noticed,
        'recovered': recovered,
        'seconds': seconds,
        'descriptors_left': descriptors() - before,
    }


def main(out: Path) -> None:
    """Go through all errors; the disconnect last, for it is final."""
    results = {name: refuse(name) for name in REFUSALS}
    results |= {name: hit(name, cause) for name, cause in INJECTIONS.items()}
    (out / 'vivid.json').write_text(json.dumps(results, indent=1))


if __name__ == '__main__':
    main(Path(sys.argv[1]))
