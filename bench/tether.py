"""Robot and topside on two ends of a tether: what crosses, and what a broken link costs.

    sudo python bench/tether.py BAG [--rate 10mbit] [--delay 0] [--loss 0] [--down 10]
        [--discovery peers|server] [--play-rate 1] [--keep NAME]

BAG is a bag of `binopos simulate`. Two network namespaces are joined by a cable that carries so
much (tbf), takes so many milliseconds each way, and loses such a part of the packets: two tap
devices, between which this process hands packets on. The player and the detector run on the
robot's end, the rest topside; the link is then taken down for so many seconds and set up again. It
needs root, and the machine for itself.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import random
import select
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from binopos_ros.nodes.supervised import STARTER
from figures import Column, Figures

ROBOT, TOPSIDE = ENDS = ('bp_robot', 'bp_topside')
ADDRESSES = {ROBOT: '10.77.0.1', TOPSIDE: '10.77.0.2'}
#: Seconds for the nodes to come up, that are watched before the link goes down, and after.
START, BEFORE, AFTER = 15.0, 10.0, 15.0
PATIENCE = 10.0
#: How the ends find each other: the environment of both.
DISCOVERY = {
    'peers': {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
        'ROS_STATIC_PEERS': ';'.join(ADDRESSES.values()),
    },
    'server': {'ROS_DISCOVERY_SERVER': f'{ADDRESSES[ROBOT]}:11811'},
}
SERVER = ('fastdds', 'discovery', '-i', '0', '-l', ADDRESSES[ROBOT], '-p', '11811')
#: Of the kernel's if_tun.h, and more than a packet of Ethernet.
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x2, 0x1000
LONGEST_PACKET = 1 << 16
#: Runs topside: prints when each pose came, and the books of every node.
LISTENER = """
import json, rclpy, time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import qos_profile_sensor_data
def tell(**values):
    print(json.dumps(values), flush=True)
def books(array):
    for status in array.status:
        tell(node=status.name, message=status.message,
             values={each.key: each.value for each in status.values})
rclpy.init()
node = rclpy.create_node('listener', namespace='stereo')
node.create_subscription(PoseWithCovarianceStamped, 'target/pose',
                         lambda _: tell(pose=time.time()), qos_profile_sensor_data)
node.create_subscription(DiagnosticArray, '/diagnostics', books, 20)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""


def ip(*words: str) -> str:
    """Output of the command `ip`."""
    done = subprocess.run(['ip', *words], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f'ip {" ".join(words)}: {done.stderr.strip()}')
    return done.stdout


class Cable(threading.Thread):
    """Hands packets on between two tap devices, late or not at all.

    Args:
        delay: seconds, each way.
        loss: part of the packets.
    """

    def __init__(self, delay: float, loss: float) -> None:
        super().__init__(daemon=True)
        self._delay, self._loss = delay, loss
        self._ends = []
        for name in ENDS:
            end = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(end, TUNSETIFF, struct.pack('16sH', name.encode(), IFF_TAP | IFF_NO_PI))
            self._ends.append(end)
        self._chance = random.Random(1)

    def run(self) -> None:
        one, other = self._ends
        across = {one: other, other: one}
        waiting: deque[tuple[float, int, bytes]] = deque()
        while True:
            left = max(waiting[0][0] - time.monotonic(), 0.0) if waiting else None
            for end in select.select(self._ends, (), (), left)[0]:
                with suppress(OSError):  # the link is down
                    packet = os.read(end, LONGEST_PACKET)
                    if self._chance.random() >= self._loss:
                        waiting.append((time.monotonic() + self._delay, across[end], packet))
            while waiting and waiting[0][0] <= time.monotonic():
                _, end, packet = waiting.popleft()
                with suppress(OSError):
                    os.write(end, packet)


@contextmanager
def tether(rate: str, delay: float, loss: float) -> Iterator[None]:
    """Two namespaces with a cable between them."""
    for end in ENDS:
        ip('netns', 'add', end)
    try:
        cable = Cable(delay, loss)
        for end in ENDS:
            ip('link', 'set', end, 'netns', end)
            ip('-n', end, 'addr', 'add', f'{ADDRESSES[end]}/24', 'dev', end)
            ip('-n', end, 'link', 'set', 'lo', 'up')
            ip('-n', end, 'link', 'set', end, 'up')
            words = f'tc -n {end} qdisc add dev {end} root tbf rate {rate} burst 64kb latency 50ms'
            subprocess.run(words.split(), check=True)
        cable.start()
        yield
    finally:
        for end in ENDS:
            ip('netns', 'del', end)


def started(end: str, *words: object, **options: Any) -> subprocess.Popen[str]:
    """A process on one end, found in the way that the environment says."""
    command = ['ip', 'netns', 'exec', end, *map(str, words)]
    return subprocess.Popen(command, text=True, start_new_session=True, **options)


def crossed() -> int:
    """Bytes that the robot has sent."""
    (link,) = json.loads(ip('-n', ROBOT, '-json', '-s', 'link', 'show', ROBOT))
    return int(link['stats64']['tx']['bytes'])


def measured(bag: Path, down: float, rate: float, server: bool, output: Path) -> dict[str, object]:
    """What the run shows."""
    given = ('--ros-args', '--params-file', bag / 'binopos.yaml')
    node = (sys.executable, STARTER)
    running = [started(ROBOT, *SERVER, stdout=subprocess.DEVNULL)] if server else []
    running += [
        started(ROBOT, *node, 'detector', *given),
        started(TOPSIDE, *node, 'triangulator', *given),
        started(TOPSIDE, *node, 'smoother', *given),
    ]
    with output.open('w') as stream:
        running.append(started(TOPSIDE, sys.executable, '-c', LISTENER, stdout=stream))
        played = ('--ros-args', '-p', f'bag:={bag}', '-p', 'loop:=true', '-p', f'rate:={rate}')
        running.append(started(ROBOT, *node, 'player', *played))
        time.sleep(START)
        begin, sent = time.time(), crossed()
        time.sleep(BEFORE)
        seconds, sent = time.time() - begin, crossed() - sent
        ip('-n', ROBOT, 'link', 'set', ROBOT, 'down')
        time.sleep(down)
        ip('-n', ROBOT, 'link', 'set', ROBOT, 'up')
        up = time.time()
        time.sleep(AFTER)
        # Groups, as the discovery server is a child of its tool, which does not end it.
        for process in reversed(running):
            os.killpg(process.pid, signal.SIGINT)
        for process in running:
            with suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    told = [json.loads(line) for line in output.read_text().splitlines() if line.startswith('{')]
    poses = [each['pose'] for each in told if 'pose' in each]
    books = {each['node']: each['values'] for each in told if 'node' in each}
    values = books.get('stereo/triangulator: stage', {})
    after = [pose - up for pose in poses if pose > up]
    return {
        'poses per second before': sum(begin < each < begin + seconds for each in poses) / seconds,
        'kilobytes per second across': sent / seconds / 1e3,
        'seconds from the link to the first pose': after[0] if after else None,
        'poses per second after': len(after) / AFTER,
        **{key: int(value) for key, value in values.items() if key.startswith(('Lost', 'Pairs'))},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('bag', type=Path, metavar='BAG')
    parser.add_argument('--rate', default='10mbit', help='what the tether carries, as tc has it')
    parser.add_argument('--down', type=float, default=10.0, help='seconds that the link is down')
    parser.add_argument('--keep', metavar='NAME', help='as bench/results/tether.NAME.json')
    parser.add_argument('--delay', type=float, default=0.0, help='of a packet, ms each way')
    parser.add_argument('--loss', type=float, default=0.0, help='part of the packets')
    parser.add_argument('--discovery', choices=DISCOVERY, default='peers')
    parser.add_argument('--play-rate', type=float, default=1.0, help='of the bag')
    arguments = parser.parse_args()
    kept = Figures(
        f'tether.{arguments.keep}',
        rate=arguments.rate,
        delay_ms=arguments.delay,
        loss=arguments.loss,
        discovery=arguments.discovery,
        play_rate=arguments.play_rate,
    )
    os.environ |= {'ROS_DOMAIN_ID': '91', **DISCOVERY[arguments.discovery]}
    with (
        tether(arguments.rate, 1e-3 * arguments.delay, arguments.loss),
        tempfile.TemporaryDirectory() as folder,
    ):
        result = measured(
            arguments.bag.absolute(),
            arguments.down,
            arguments.play_rate,
            arguments.discovery == 'server',
            Path(folder) / 'told',
        )
    table = kept.table('tether', '', Column('', '.4g'))
    for name, value in result.items():
        table.row(name, value)
    if arguments.keep:
        kept.keep()


if __name__ == '__main__':
    main()
