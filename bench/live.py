"""The live nodes beside the plain pipeline that a user would write, on the same bag in one run.

    python bench/live.py [BAG] [--rate 30] [--seconds 20] [--rounds 2] [--alone]
        [--raw] [--single-process] [--load 0] [--keep NAME]

BAG is a bag of `binopos simulate` (JPEG); without it one is made. Its pictures are published
again and again at a rate, with the present as their stamp, to one of the two at a time, in
turns (`--alone`: to the suite only). A latency is the time from a pair's stamp to the arrival of
its pose in this process; processor time is that of the processes that make the pose, all their
threads, divided by the pairs sent; what gave no pose is lost. Their memory, threads and open
files are told for each minute of a run. `--raw` publishes pictures as bgr8, to the suite only,
with the shared memory that `binopos run` gives. `--load` keeps so many processes busy beside it,
and `--single-process` composes the suite's nodes. The plain pipeline is one rclpy node: OpenCV
decodes, finds red by inRange, takes the moments and triangulates along straight rays; pairs by
equal stamps alone, and no covariance and no filter.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from binopos_ros.capture.transport import profile_variable
from binopos_ros.cli.installation import PROFILE, needed
from figures import Column, Figures

SIDES = ('left', 'right')
SUITE = ('detector', 'triangulator', 'smoother')
PLAIN = 'plain pipeline'
TICKS, PAGE = os.sysconf('SC_CLK_TCK'), os.sysconf('SC_PAGESIZE')
SETTLE, DRAIN, START = 1.0, 1.5, 60.0
DOMAIN = '87'
#: Pictures of each camera that are kept raw: 4 MB each.
RAW = 20
INPUTS = ('image_raw/compressed', 'camera_info')


def plain() -> None:
    """What a user would write first."""
    import rclpy
    from geometry_msgs.msg import PoseStamped
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import CameraInfo, CompressedImage

    class Plain(Node):
        def __init__(self) -> None:
            super().__init__('plain')
            self.infos: dict[str, Any] = {}
            self.seen: dict[str, tuple[int, Any]] = {}
            self.poses = self.create_publisher(PoseStamped, '/plain/pose', 10)
            for side in SIDES:
                self.create_subscription(
                    CompressedImage,
                    f'/stereo/{side}/image_raw/compressed',
                    lambda message, side=side: self.take(side, message),
                    qos_profile_sensor_data,
                )
                self.create_subscription(
                    CameraInfo,
                    f'/stereo/{side}/camera_info',
                    lambda message, side=side: self.infos.update({side: message}),
                    latched(),
                )

        def take(self, side: str, message: Any) -> None:
            picture = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
            hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
            mask = cv2.inRange(hsv, (0, 110, 60), (8, 255, 255))
            mask |= cv2.inRange(hsv, (168, 110, 60), (180, 255, 255))
            m = cv2.moments(mask, binaryImage=True)
            if m['m00'] == 0 or len(self.infos) < 2:
                return
            info = self.infos[side]
            centre = np.array([[[m['m10'] / m['m00'], m['m01'] / m['m00']]]])
            k, r, p = (np.reshape(each, (3, -1)) for each in (info.k, info.r, info.p))
            point = cv2.undistortPoints(centre, k, np.array(info.d), R=r, P=p).reshape(2, 1)
            stamp = message.header.stamp
            self.seen[side] = stamp.sec * 10**9 + stamp.nanosec, point
            (one, left), (other, right) = (self.seen.get(each, (-1, None)) for each in SIDES)
            if one != other or left is None:
                return
            matrices = [np.reshape(self.infos[each].p, (3, 4)) for each in SIDES]
            x, y, z, w = cv2.triangulatePoints(*matrices, left, right).ravel()
            pose = PoseStamped(header=message.header)
            place = pose.pose.position
            place.x, place.y, place.z = x / w, y / w, z / w
            self.poses.publish(pose)

    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        rclpy.spin(Plain())


def latched() -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile

    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def with_children(pids: Iterable[int]) -> Iterator[int]:
    """Processes, and those that they have started."""
    for pid in pids:
        yield pid
        for task in Path(f'/proc/{pid}/task').iterdir():
            yield from with_children(map(int, (task / 'children').read_text().split()))


def processor_seconds(processes: list[subprocess.Popen[bytes]]) -> float:
    """What the processes, and those that they have started, have used so far."""
    total = 0
    for pid in with_children(process.pid for process in processes):
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
        total += int(fields[11]) + int(fields[12])
    return total / TICKS


def resources(processes: list[subprocess.Popen[bytes]]) -> tuple[float, int, int]:
    """Resident memory in MB, threads and open files of the processes and their children."""
    memory = threads = files = 0
    for pid in with_children(process.pid for process in processes):
        folder = Path(f'/proc/{pid}')
        memory += int((folder / 'statm').read_text().split()[1]) * PAGE
        threads += len(list((folder / 'task').iterdir()))
        files += len(list((folder / 'fd').iterdir()))
    return 1e-6 * memory, threads, files


def started(name: str, bag: Path, single: bool) -> list[subprocess.Popen[bytes]]:
    quiet: dict[str, Any] = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL}
    if name == PLAIN:
        return [subprocess.Popen([sys.executable, __file__, '--plain'], **quiet)]
    words = ['--ros-args', '--params-file', str(bag / 'binopos.yaml')]
    command = [sys.executable, '-m', 'binopos_ros.nodes']
    groups = [SUITE] if single else [(each,) for each in SUITE]
    return [subprocess.Popen([*command, *each, *words], **quiet) for each in groups]


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that take all the processor time that they get."""
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def raw_picture(message: Any) -> bytearray:
    """A compressed picture as a serialised bgr8 one."""
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import Image

    picture = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
    height, width, channels = picture.shape
    raw = Image(height=height, width=width, encoding='bgr8', step=channels * width)
    raw.header.frame_id = message.header.frame_id
    raw.data = picture.tobytes()
    return bytearray(serialize_message(raw))


class Feed:
    """Publishes the bag's pictures, and notes when poses come."""

    def __init__(self, bag: Path, raw: bool = False) -> None:
        import rclpy
        from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image

        from binopos_ros.bag import BagReader

        rclpy.init()
        self.node = rclpy.create_node('feed')
        self.pictures, self.publishers, self.infos = {}, {}, {}
        with BagReader(bag) as reader:
            for side in SIDES:
                topics = [f'/stereo/{side}/{each}' for each in INPUTS]
                records = itertools.islice(reader.messages(topics[:1]), RAW if raw else None)
                self.pictures[side] = [
                    raw_picture(reader.decode(r)) if raw else bytearray(r.data) for r in records
                ]
                info = next(iter(reader.messages(topics[1:]))).data
                kind, topic = (
                    (Image, f'/stereo/{side}/image_raw') if raw else (CompressedImage, topics[0])
                )
                self.publishers[side] = self.node.create_publisher(kind, topic, 10)
                self.infos[side] = self.node.create_publisher(CameraInfo, topics[1], latched())
                self.infos[side].publish(bytes(info))
        self.came: dict[int, int] = {}
        for kind, topic in (
            (PoseWithCovarianceStamped, '/stereo/target/pose'),
            (PoseStamped, '/plain/pose'),
        ):
            self.node.create_subscription(kind, topic, self.note, 100)

    def note(self, message: Any) -> None:
        stamp = message.header.stamp
        self.came.setdefault(stamp.sec * 10**9 + stamp.nanosec, time.time_ns())

    def spin(self, until: float) -> None:
        import rclpy

        while (left := until - time.monotonic()) > 0:
            rclpy.spin_once(self.node, timeout_sec=left)

    def connect(self, topic: str) -> None:
        end = time.monotonic() + START
        publishers = [*self.publishers.values(), *self.infos.values()]
        while not (
            all(each.get_subscription_count() for each in publishers)
            and self.node.count_publishers(topic)
        ):
            if time.monotonic() > end:
                sys.exit(f'nobody serves {topic} after {START:.0f} s')
            self.spin(time.monotonic() + 0.1)
        self.spin(time.monotonic() + SETTLE)

    def send(self, side: str, k: int, stamp: int) -> None:
        data = self.pictures[side][k % len(self.pictures[side])]
        # Every message begins with its header's stamp.
        struct.pack_into('<iI', data, 4, *divmod(stamp, 10**9))
        self.publishers[side].publish(bytes(data))

    def run(
        self, name: str, bag: Path, rate: float, seconds: float, single: bool
    ) -> dict[str, Any]:
        processes = started(name, bag, single)
        try:
            self.connect('/plain/pose' if name == PLAIN else '/stereo/target/pose')
            # The first second warms up and is not counted.
            sent, warm, begin = [], round(rate), time.monotonic()
            spent, minutes = 0.0, []
            for k in range(warm + round(rate * seconds)):
                self.spin(begin + k / rate)
                if k == warm:
                    spent = processor_seconds(processes)
                stamp = time.time_ns()
                for side in SIDES:
                    self.send(side, k, stamp)
                if k >= warm:
                    sent.append(stamp)
                if len(sent) % round(60 * rate) == 1:
                    minutes.append(resources(processes))
            self.spin(time.monotonic() + DRAIN)
            spent = processor_seconds(processes) - spent
            minutes.append(resources(processes))
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait()
        taken = [1e-6 * (self.came[each] - each) for each in sent if each in self.came]
        median, high = np.percentile(taken, (50, 99)) if taken else (np.nan, np.nan)
        return {
            'name': name,
            'pairs': len(sent),
            'lost': len(sent) - len(taken),
            'median_ms': float(median),
            'p99_ms': float(high),
            'oldest_ms': max(taken, default=np.nan),
            'cpu_ms_per_pair': 1e3 * spent / len(sent),
            'minutes': minutes,
        }


def main() -> int:
    if sys.argv[1:] == ['--plain']:
        plain()
        return 0
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('bag', type=Path, nargs='?')
    parser.add_argument('--rate', type=float, default=30.0, help='pairs per second')
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--rounds', type=int, default=2)
    parser.add_argument('--alone', action='store_true', help='without the plain pipeline')
    parser.add_argument('--raw', action='store_true', help='bgr8 instead of JPEG')
    parser.add_argument('--single-process', action='store_true')
    parser.add_argument('--load', type=int, default=0, help='processes that are busy beside it')
    parser.add_argument('--keep', metavar='NAME', help='as bench/results/live.NAME.json')
    options = parser.parse_args()
    os.environ['ROS_DOMAIN_ID'] = DOMAIN
    if options.raw:
        os.environ[profile_variable()] = str(needed(PROFILE))
    with tempfile.TemporaryDirectory() as folder:
        bag = options.bag
        if bag is None:
            bag = Path(folder) / 'washbowl'
            words = [sys.executable, '-m', 'binopos_ros', 'simulate', '-o', str(bag)]
            subprocess.run(words, check=True, capture_output=True)
        kept = Figures(
            f'live.{options.keep}',
            peers=('simplejpeg',),
            rate=options.rate,
            seconds=options.seconds,
            raw='yes' if options.raw else None,
            single_process='yes' if options.single_process else None,
            busy_processes=options.load,
        )
        with busy(options.load):
            measure(kept, bag, options)
    if options.keep:
        kept.keep()
    return 0


def measure(kept: Figures, bag: Path, options: argparse.Namespace) -> None:
    """Add the figures of each round and pipeline."""
    from binopos_ros.detection import JPEG_DECODER

    feed, rate = Feed(bag, options.raw), options.rate
    name = f'the suite ({JPEG_DECODER})'
    names = (name,) if options.alone or options.raw else (name, PLAIN)
    print(f'{rate:g} pairs/s, load {os.getloadavg()[0]:.1f} of {os.cpu_count()} cores')
    table = kept.table(
        'latency',
        '',
        Column('pairs', '.0f'),
        Column('lost', '.0f'),
        Column('median, ms', '.1f'),
        Column('99 %, ms', '.1f'),
        Column('oldest, ms', '.1f'),
        Column('processor, ms a pair', '.1f'),
    )
    for _, name in itertools.product(range(options.rounds), names):
        found = feed.run(name, bag, rate, options.seconds, options.single_process)
        keys = 'pairs', 'lost', 'median_ms', 'p99_ms', 'oldest_ms', 'cpu_ms_per_pair'
        table.row(name, *(found[key] for key in keys))
        for memory, threads, files in found['minutes'] if options.seconds > 60 else ():
            print(f'{"":28}{memory:9.1f} MB, {threads} threads, {files} open files', flush=True)


if __name__ == '__main__':
    raise SystemExit(main())
