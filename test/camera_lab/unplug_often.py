"""Runs in the guest: unplugs and replugs a camera under the camera node, many times.

    python unplug_often.py SCENE CYCLES

Prints what the node's process holds as it goes on, and how long the recoveries took. The status is
1 where it holds more at the end than after the first cycles, or the camera stayed away.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from statistics import median

from scene import RATE, SERIALS, SIZE
from virtual_camera.camera import VirtualCamera
from virtual_camera.usbip import free_ports

from binopos_ros.capture.usb import find_cameras
from binopos_ros.nodes.supervised import STARTER

SETTLED = 10
"""Cycles after which nothing may grow any more."""
PATIENCE = 120.0
MEMORY_SLACK = 4096
"""kB that the resident memory may vary by; 190 leaked mappings would be some 450 MB."""


def wait_for(what: str, condition: Callable[[], bool]) -> float:
    """Seconds until the condition holds."""
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > PATIENCE:
            raise SystemExit(f'{what} did not come within {PATIENCE:g} s')
        time.sleep(0.01)
    return time.monotonic() - began


def held(process: int) -> tuple[int, int, int]:
    """Open files, threads and resident memory (kB) of a process."""
    status = dict(
        line.split(':', 1) for line in Path(f'/proc/{process}/status').read_text().splitlines()
    )
    files = len(os.listdir(f'/proc/{process}/fd'))
    return files, int(status['Threads']), int(status['VmRSS'].split()[0])


def opened(process: int) -> int:
    """How many cameras a process has open; a mapped buffer holds a descriptor of its own."""
    cameras = set()
    for link in Path(f'/proc/{process}/fd').iterdir():
        with suppress(FileNotFoundError):  # closed while we look
            cameras.add(os.readlink(link))
    return sum(name.startswith('/dev/video') for name in cameras)


def main(scene: Path, cycles: int) -> int:
    """Unplug the right camera again and again; the exit status."""
    cameras = [
        VirtualCamera(
            [path.read_bytes() for path in sorted((scene / side).iterdir())], SIZE, (RATE,), serial
        )
        for side, serial in SERIALS.items()
    ]
    for camera in cameras:
        camera.plug()
    right = cameras[1]
    node = subprocess.Popen(
        [
            *(sys.executable, STARTER, 'camera'),
            *('--ros-args', '--params-file', str(scene / 'rig.yaml')),
        ],
        stderr=subprocess.DEVNULL,
    )
    wait_for('the first frames', lambda: all(camera.sent > 2 for camera in cameras))
    print(0, *held(node.pid), flush=True)
    recoveries, levels = [], {}
    for cycle in range(1, cycles + 1):
        right.unplug()
        wait_for('the closing', lambda: opened(node.pid) == 1)
        sent = right.sent
        right.plug(free_ports()[cycle % 3])
        wait_for('the device', lambda: any(one.serial == right.serial for one in find_cameras()))
        recoveries.append(wait_for('a frame', lambda sent=sent: right.sent > sent))
        if cycle % SETTLED == 0:
            levels[cycle] = held(node.pid)
            print(
                cycle,
                *levels[cycle],
                f'{median(recoveries):.2f} {max(recoveries):.2f}',
                flush=True,
            )
    node.send_signal(signal.SIGINT)
    status = node.wait(20.0)
    for camera in cameras:
        camera.unplug()
    first, last = levels[SETTLED], levels[max(levels)]
    grown = last[:2] != first[:2] or last[2] > first[2] + MEMORY_SLACK
    print('something was left behind' if grown else 'nothing was left behind', flush=True)
    return int(grown or status != 0)


if __name__ == '__main__':
    # The threads of the virtual cameras are not waited for.
    os._exit(main(Path(sys.argv[1]), int(sys.argv[2])))
