"""What the page costs: the viewer with 0, 1 and 3 pages open, and the latency of the pipeline.

    python bench/view.py [--rate 30] [--seconds 10] [--rounds 3] [--browser]

Pictures of 1280 x 960 (JPEG, about 115 kB) of both sides, centroids and poses are published at a
rate. The pages are WebSocket clients in this process, which take what they are sent and do not
draw it. Processor time and memory are those of the viewer's process alone; the time to a page is
from the pose's publication to the state that holds it. With --browser a page is shown in a
headless Chromium as well. Then `binopos replay` plays the demo's bag with a page that looks and
without one, in turns.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np

from figures import Column, Figures

PROJECT = Path(__file__).resolve().parents[1]
TICKS = os.sysconf('SC_CLK_TCK')
SIZE = (1280, 960)
JPEG_BYTES = 115_000
SETTLE = 2.0
CLIENTS = (0, 1, 3)


def picture() -> bytes:
    """A JPEG of about as many bytes as a camera makes."""
    noise = np.random.default_rng(1).normal(110, 22, (SIZE[1] // 4, SIZE[0] // 4, 3))
    pixels = cv2.resize(noise.clip(0, 255).astype(np.uint8), SIZE, interpolation=cv2.INTER_CUBIC)
    return min(
        (
            cv2.imencode('.jpg', pixels, (cv2.IMWRITE_JPEG_QUALITY, q))[1].tobytes()
            for q in range(20, 99)
        ),
        key=lambda data: abs(len(data) - JPEG_BYTES),
    )


class Page(threading.Thread):
    """A page that looks: counts pictures, and times the poses that it is shown."""

    def __init__(self, address: str, sent: dict[str, float]) -> None:
        super().__init__(daemon=True)
        self.pictures, self.delays = 0, []
        self._address, self._sent = address.replace('http', 'ws') + 'ws', sent
        self._loop = asyncio.new_event_loop()
        self._task = self._loop.create_task(self._look())
        self.start()

    def run(self) -> None:
        try:
            self._loop.run_until_complete(self._task)
        except asyncio.CancelledError:
            self._loop.close()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._task.cancel)
        self.join()

    async def _look(self) -> None:
        from websockets.asyncio.client import connect

        shown = ''
        async with connect(self._address, max_size=None) as page:
            await page.send('{"type": "watch", "pictures": true}')
            async for message in page:
                if isinstance(message, bytes):
                    self.pictures += 1
                    continue
                told = json.loads(message)
                stamp = (told.get('pose') or {}).get('stamp', '')
                if stamp != shown and stamp in self._sent:
                    shown = stamp
                    self.delays.append(time.monotonic() - self._sent[stamp])


class Rig:
    """Publishes what the rig and the nodes would."""

    def __init__(self, rate: float) -> None:
        import rclpy
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from rclpy.serialization import serialize_message
        from sensor_msgs.msg import CompressedImage

        rclpy.init()
        self.sent: dict[str, float] = {}
        self._node = rclpy.create_node('bench_rig', namespace='stereo')
        pose, image = PoseWithCovarianceStamped, CompressedImage
        self._poses = self._node.create_publisher(pose, 'target/pose', 10)
        self._marks = [
            self._node.create_publisher(pose, f'{s}/centroid', 10) for s in ('left', 'right')
        ]
        self._images = [
            self._node.create_publisher(image, f'{s}/image_raw/compressed', 10)
            for s in ('left', 'right')
        ]
        self._pose, self._image = (
            pose,
            bytearray(serialize_message(image(format='jpeg', data=picture()))),
        )
        self._period, self._stop = 1 / rate, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            stamp = time.time_ns()
            message = self._pose()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            self._image[4:12] = np.array(divmod(stamp, 10**9), '<u4').tobytes()
            for images in self._images:
                images.publish(bytes(self._image))
            for marks in self._marks:
                marks.publish(message)
            self.sent[str(stamp)] = time.monotonic()
            self._poses.publish(message)
            due += self._period
            time.sleep(max(due - time.monotonic(), 0.0))

    def close(self) -> None:
        import rclpy

        self._stop.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.try_shutdown()


def viewer() -> tuple[subprocess.Popen[str], str]:
    """A viewer, and the address of its page."""
    starter = PROJECT / 'binopos_ros' / 'nodes' / '__main__.py'
    words = [sys.executable, str(starter), 'viewer', '--ros-args', '-p', 'viewer:port:=0']
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline().split()[-1]


def used(pid: int) -> tuple[float, float]:
    """Processor time, s, and memory, MB, of a process."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    resident = int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')
    return (int(fields[11]) + int(fields[12])) / TICKS, resident / 1e6


def cost(clients: int, rig: Rig, seconds: float) -> tuple[str, float, float, float, float]:
    """What the viewer takes with so many pages: a row of the table."""
    process, address = viewer()
    pages = [Page(address, rig.sent) for _ in range(clients)]
    time.sleep(SETTLE)
    before, begun = used(process.pid)[0], time.monotonic()
    seen = sum(page.pictures for page in pages)
    for page in pages:
        page.delays.clear()
    time.sleep(seconds)
    after, memory = used(process.pid)
    span = time.monotonic() - begun
    delays = [delay for page in pages for delay in page.delays]
    seen = sum(page.pictures for page in pages) - seen
    for page in pages:
        page.close()
    process.terminate()
    process.wait()
    return (
        str(clients),
        100 * (after - before) / span,
        memory,
        seen / span / clients if clients else 0.0,
        1000 * float(np.percentile(delays, 99)) if delays else 0.0,
    )


#: What a page shows within some milliseconds: pictures per second of one camera, and for each
#: pose how old it was when it stood on the page, ms.
SHOWN = """new Promise((done) => {
  const pictures = new Set(), ages = [], begun = performance.now();
  let newest = '';
  (function look() {
    pictures.add(binopos.eyes.left.shown?.stamp);
    const stamp = binopos.page.state?.pose?.stamp;
    if (stamp && stamp !== newest) { newest = stamp; ages.push(Date.now() - Number(stamp) / 1e6); }
    if (performance.now() - begun < MILLISECONDS) requestAnimationFrame(look);
    else done({pictures: pictures.size, ages});
  })();
})"""


def in_browser(seconds: float) -> tuple[float, float]:
    """Pictures per second of one camera on a page in Chromium, and the 99 % age of a pose, ms."""
    sys.path.insert(0, str(PROJECT / 'test' / 'scenes'))
    from browser import Browser

    process, address = viewer()
    browser = Browser()
    browser.open(address)
    browser.wait_for('window.binopos?.eyes.left.shown')
    shown = browser.run(SHOWN.replace('MILLISECONDS', str(round(1000 * seconds))))
    browser.close()
    process.terminate()
    process.wait()
    return shown['pictures'] / seconds, float(np.percentile(shown['ages'], 99))


def latency(looked_at: bool) -> tuple[float, float]:
    """Median and 99th percentile of a replay of the demo's bag, ms."""
    words = [sys.executable, '-m', 'binopos_ros', 'replay', 'bags/demo']
    if looked_at:
        words += ['--view', '--ros-args', '-p', 'viewer:port:=0']
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=PROJECT)
    assert process.stdout is not None
    page, told = None, ''
    for line in process.stdout:
        told += line
        if looked_at and page is None and 'http://' in line:
            page = Page(line.split()[-1], {})
    process.wait()
    if page is not None:
        page.join()
    figures = re.findall(
        r'latency from stamp to pose, (?:median|99th percentile) +([\d.]+) ms', told
    )
    return float(figures[0]), float(figures[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rate', type=float, default=30.0)
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--browser', action='store_true', help='show a page in Chromium, too')
    arguments = parser.parse_args()
    os.environ.setdefault('ROS_DOMAIN_ID', '86')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    kept = Figures('view', rate=arguments.rate, seconds=arguments.seconds)
    rig = Rig(arguments.rate)
    rows = [cost(clients, rig, arguments.seconds) for clients in CLIENTS]
    seen = in_browser(arguments.seconds) if arguments.browser else None
    rig.close()
    table = kept.table(
        'pages',
        'pages',
        Column('processor, %', '.1f'),
        Column('memory, MB', '.0f'),
        Column('pictures/s and page', '.1f'),
        Column('pose to page, 99 %, ms', '.0f'),
    )
    for row in rows:
        table.row(*row)
    if seen is not None:
        table.row('in Chromium', None, None, *seen)
    turns = [(latency(False), latency(True)) for _ in range(arguments.rounds)]
    columns = Column('without a page, ms', '.1f'), Column('with one, ms', '.1f')
    table = kept.table('latency', "latency of a replay's poses", *columns)
    for name, number in (('median', 0), ('99th percentile', 1)):
        table.row(name, *([turn[looked][number] for turn in turns] for looked in (0, 1)))
    kept.keep()


if __name__ == '__main__':
    main()
