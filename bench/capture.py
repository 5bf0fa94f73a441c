"""What an MJPG frame costs, beside cv2.VideoCapture and v4l2-ctl, on one device in one run.

    python bench/capture.py /dev/video0     on a camera of this machine
    python bench/capture.py                 on a virtual camera in the camera lab

The cost is processor time (user and system) per frame, start and end of the stream taken off; a
camera sets the pace, so elapsed time would say nothing. "ours" fetches a frame, copies it once
into what a ROS message takes, and looks whether the JPEG is whole. Rounds alternate.

Below it: the bytes that are allocated from the driver's buffer to the message for the middleware.
"""

from __future__ import annotations

import importlib.metadata
import os
import resource
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from statistics import median

import cv2

from binopos_ros.capture.formats import jpeg_fault
from binopos_ros.capture.stream import copied
from binopos_ros.capture.v4l2 import Device
from binopos_ros.nodes.camera import image_messages

PROJECT = Path(__file__).resolve().parent.parent
LAB = PROJECT / 'test' / 'camera_lab'
FRAMES, ROUNDS = 60, 3


def ours(path: str, frames: int) -> None:
    """Our stream, with the copy into the message."""
    with Device(path) as device:
        device.set_format('MJPG', *size_of(device))
        with device.stream(timeout=5.0) as stream:
            for _ in range(frames):
                frame = next(stream)
                copied(frame.data)
                jpeg_fault(frame.data)


def opencv(path: str, frames: int, decode: bool) -> None:
    """OpenCV's capture; it decodes by default."""
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*'MJPG'))
    capture.set(cv2.CAP_PROP_CONVERT_RGB, float(decode))
    for _ in range(frames):
        if not capture.read()[0]:
            raise SystemExit('cv2.VideoCapture gives no frames here')
    capture.release()


def v4l2_ctl(path: str, frames: int) -> None:
    """The tool of the V4L project; it fetches the frames and drops them."""
    words = ['v4l2-ctl', '-d', path, '--set-fmt-video=pixelformat=MJPG', '--stream-mmap=4']
    words += [f'--stream-count={frames}']
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


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


def processor_time() -> float:
    """Seconds of user and system time of this process and its ended children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def cost(read: Callable[[int], None]) -> float:
    """Seconds of processor time per frame: a long stretch less a short one."""
    spent = []
    for frames in (1, FRAMES + 1):
        began = processor_time()
        read(frames)
        spent.append(processor_time() - began)
    return (spent[1] - spent[0]) / FRAMES


def measure(path: str) -> None:
    """Print the table for a device."""
    peers: dict[str, Callable[[int], None]] = {
        'ours': lambda frames: ours(path, frames),
        'v4l2-ctl --stream-mmap': lambda frames: v4l2_ctl(path, frames),
        'cv2.VideoCapture, bytes as they are': lambda frames: opencv(path, frames, False),
        'cv2.VideoCapture, decoded': lambda frames: opencv(path, frames, True),
    }
    spent: dict[str, list[float]] = {name: [] for name in peers}
    for _ in range(ROUNDS):
        for name, read in peers.items():
            spent[name].append(cost(read))
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
        return subprocess.run([LAB / 'run_guest', '-t', '280', script], check=False).returncode


if __name__ == '__main__':
    if len(sys.argv) > 1:
        measure(sys.argv[1])
    else:
        sys.exit(measure_in_lab())
