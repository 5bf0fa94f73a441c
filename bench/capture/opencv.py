"""What an MJPG frame costs, beside cv2.VideoCapture and v4l2-ctl, on one device in one run.

    python bench/capture/opencv.py /dev/video0     on a camera of this machine
    python bench/capture/opencv.py                 on a virtual camera in the camera lab

The cost is processor time (user and system) per frame while the stream runs; a camera sets the
pace, so elapsed time would say nothing. "ours" fetches a frame, copies it once into what a ROS
message takes, and looks whether the JPEG is whole. Rounds alternate; their median counts.

Below it: the bytes that are allocated from the driver's buffer to the message for the middleware.
"""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from statistics import median

import cv2

from binopos_ros.capture.formats import jpeg_fault
from binopos_ros.capture.stream import copied
from binopos_ros.capture.v4l2 import Device
from binopos_ros.nodes.camera import image_messages

PROJECT = Path(__file__).resolve().parents[2]
LAB = PROJECT / 'test' / 'camera_lab'
FRAMES, ROUNDS = 150, 5
WARM_UP = 10


def ours(path: str) -> float:
    """Our stream, with the copy into the message."""
    with Device(path) as device:
        device.set_format('MJPG', *size_of(device))
        with device.stream(timeout=5.0) as stream:

            def read() -> None:
                frame = next(stream)
                copied(frame.data)
                jpeg_fault(frame.data)

            return timed(read)


def opencv(path: str, decode: bool) -> float:
    """OpenCV's capture; it decodes by default."""
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*'MJPG'))
    capture.set(cv2.CAP_PROP_CONVERT_RGB, float(decode))

    def read() -> None:
        if not capture.read()[0]:
            raise SystemExit('cv2.VideoCapture gives no frames here')

    try:
        return timed(read)
    finally:
        capture.release()


def v4l2_ctl(path: str) -> float:
    """The tool of the V4L project; it fetches the frames and drops them."""
    words = ['v4l2-ctl', '-d', path, '--set-fmt-video=pixelformat=MJPG', '--stream-mmap=4']
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as tool:

        def read() -> None:
            # It writes this for each frame.
            while os.read(tool.stdout.fileno(), 1) != b'<':
                pass

        try:
            return timed(read, lambda: ran(tool.pid))
        finally:
            tool.terminate()


def ran(process: int) -> float:
    """Seconds that the only thread of a process has run."""
    return int(Path(f'/proc/{process}/schedstat').read_text().split()[0]) * 1e-9


def timed(read: Callable[[], None], clock: Callable[[], float] = time.process_time) -> float:
    """Seconds of processor time per frame."""
    for _ in range(WARM_UP):
        read()
    began = clock()
    for _ in range(FRAMES):
        read()
    return (clock() - began) / FRAMES


def allocated(path: str) -> str:
    """What the way of one frame into its message allocates, most of it at a time."""
    with Device(path) as device:
        form = device.set_format('MJPG', *size_of(device))
        with device.stream(timeout=5.0) as stream:
            image_messages(next(stream).data, form)  # what is allocated once and for all
            frame = next(stream)
            tracemalloc.start()
            (message,) = image_messages(frame.data, form)
            most = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            size = len(frame.data)
    return f'a frame of {size} bytes: {most} bytes allocated, {len(message.data)} in the message'


def size_of(device: Device) -> tuple[int, int]:
    """The largest MJPG size that the camera has."""
    return max(mode.largest for mode in device.modes() if mode.pixel_format == 'MJPG')


def measure(path: str) -> None:
    """Print the table for a device."""
    peers: dict[str, Callable[[], float]] = {
        'ours': lambda: ours(path),
        'v4l2-ctl --stream-mmap': lambda: v4l2_ctl(path),
        'cv2.VideoCapture, bytes as they are': lambda: opencv(path, False),
        'cv2.VideoCapture, decoded': lambda: opencv(path, True),
    }
    spent: dict[str, list[float]] = {name: [] for name in peers}
    for _ in range(ROUNDS):
        for name, read in peers.items():
            spent[name].append(read())
    own = median(spent['ours'])
    version = importlib.metadata.version('opencv-python-headless')
    print(f'{FRAMES} frames, {ROUNDS} rounds, OpenCV {version}')
    print(f'{"":38}{"ms/frame":>9}{"ratio":>8}')
    for name, each in spent.items():
        print(f'{name:38}{1e3 * median(each):9.3f}{median(each) / own:8.2f}')
    print(allocated(path))


def measure_in_lab() -> int:
    """Have the camera lab run this script on a virtual camera."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, 'PYTHONPATH': str(PROJECT)}
        subprocess.run([sys.executable, LAB / 'scene.py', folder], env=environment, check=True)
        script = Path(folder, 'bench.sh')
        script.write_text(
            f'load_uvc; export PYTHONPATH={PROJECT}\n'
            f'{sys.executable} {LAB}/show.py {folder}/left BENCH & camera=$!\n'
            f'wait_for /dev/video0; sleep 1; {sys.executable} {__file__} /dev/video0\n'
            'kill $camera; wait $camera\n'
        )
        return subprocess.run([LAB / 'run_guest', '-t', '400', script], check=False).returncode


if __name__ == '__main__':
    if len(sys.argv) > 1:
        measure(sys.argv[1])
    else:
        sys.exit(measure_in_lab())
