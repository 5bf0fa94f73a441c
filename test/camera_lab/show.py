"""Runs in the guest: plugs in a virtual camera that shows a folder of JPEGs, until it is ended.

python show.py FOLDER SERIAL
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path

from scene import SIZE
from virtual_camera.camera import VirtualCamera

if __name__ == '__main__':
    frames = [path.read_bytes() for path in sorted(Path(sys.argv[1]).iterdir())]
    camera = VirtualCamera(frames, SIZE, (30,), sys.argv[2])
    camera.plug()
    signal.sigwait({signal.SIGINT, signal.SIGTERM})
    camera.unplug()
