"""Robot and topside on two ends of a tether: what crosses, and what a broken link costs.

    sudo python bench/tether.py BAG [--rate 10mbit] [--down 10] [--json FILE]

BAG is a bag of `binopos simulate`. Two network namespaces are joined by a virtual cable that
carries so much (tbf). The player and the detector run on the robot's end, the rest topside; the
link is then taken down for so many seconds and set up again. It needs root, and the machine for
itself.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from binopos_ros.nodes.supervised import STARTER

ROBOT, TOPSIDE = ENDS = ('bp_robot', 'bp_topside')
ADDRESSES = {ROBOT: '10.77.0.1', TOPSIDE: '10.77.0.2'}
#: Seconds for the nodes to come up, that are watched before the link goes down, and after.
START, BEFORE, AFTER = 15.0, 10.0, 15.0
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


@contextmanager
def tether(rate: str) -> Iterator[None]:
    """Two namespaces with a cable between them."""
    for end in ENDS:
        ip('netns', 'add', end)
    try:
        ip('link', 'add', ROBOT, 'type', 'veth', 'peer', 'name', TOPSIDE)
        for end in ENDS:
            ip('link', 'set', end, 'netns', end)
            ip('-n', end, 'addr', 'add', f'{ADDRESSES[end]}/24', 'dev', end)
            ip('-n', end, 'link', 'set', 'lo', 'up')
            ip('-n', end, 'link', 'set', end, 'up')
            words = f'tc -n {end} qdisc add dev {end} root tbf rate {rate} burst 64kb latency 50ms'
            subprocess.run(words.split(), check=True)
        yield
    finally:
        for end in ENDS:
            ip('netns', 'del', end)


def started(end: str, *words: object, **options: Any) -> subprocess.Popen[str]:
    """A process on one end."""
    environment = {
        **os.environ,
        'ROS_DOMAIN_ID': '91',
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
        'ROS_STATIC_PEERS': ';'.join(ADDRESSES.values()),
    }
    command = ['ip', 'netns', 'exec', end, sys.executable, *map(str, words)]
    return subprocess.Popen(command, env=environment, text=True, **options)


def crossed() -> int:
    """Bytes that the robot has sent."""
    (link,) = json.loads(ip('-n', ROBOT, '-json', '-s', 'link', 'show', ROBOT))
    return int(link['stats64']['tx']['bytes'])


def measured(bag: Path, down: float, output: Path) -> dict[str, object]:
    """What the run shows."""
    given = ('--ros-args', '--params-file', bag / 'binopos.yaml')
    running = [
        started(ROBOT, STARTER, 'detector', *given),
        started(TOPSIDE, STARTER, 'triangulator', *given),
        started(TOPSIDE, STARTER, 'smoother', *given),
    ]
    with output.open('w') as stream:
        running.append(started(TOPSIDE, '-c', LISTENER, stdout=stream))
        played = ('--ros-args', '-p', f'bag:={bag}', '-p', 'loop:=true')
        running.append(started(ROBOT, STARTER, 'player', *played))
        time.sleep(START)
        begin, sent = time.time(), crossed()
        time.sleep(BEFORE)
        seconds, sent = time.time() - begin, crossed() - sent
        ip('-n', ROBOT, 'link', 'set', ROBOT, 'down')
        time.sleep(down)
        ip('-n', ROBOT, 'link', 'set', ROBOT, 'up')
        up = time.time()
        time.sleep(AFTER)
        for process in reversed(running):
            process.send_signal(signal.SIGINT)
        for process in running:
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
    parser.add_argument('--json', type=Path, metavar='FILE')
    arguments = parser.parse_args()
    with tether(arguments.rate), tempfile.TemporaryDirectory() as folder:
        result = measured(arguments.bag.absolute(), arguments.down, Path(folder) / 'told')
    for name, value in result.items():
        print(
            f'  {name:<40}  {value:.2f}' if isinstance(value, float) else f'  {name:<40}  {value}'
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2), encoding='utf-8')


if __name__ == '__main__':
    main()
