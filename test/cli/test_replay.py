"""`binopos replay`: the live nodes, over real middleware, against `process` on the same bag."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.nodes.supervised import STARTER
from verbs import binopos, simulated

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
from rclpy.node import Node  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

pytestmark = pytest.mark.live

PAIRS = 90
POSE = '/stereo/target/pose'
#: Without it a busy machine leaves out pairs that newer ones have overtaken.
EVERY = ('--wait-for-all-acked', '10000')


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated(tmp_path_factory.mktemp('replay') / 'bag', 'washbowl', PAIRS)


@pytest.fixture(scope='module')
def offline(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, np.ndarray]:
    """Filtered and raw position (6,) by stamp in nanoseconds, from `process`."""
    table = tmp_path_factory.mktemp('offline') / 'out.csv'
    done = binopos('process', bag, '-o', table.with_name('out.mcap'), '--csv', table)
    assert done.returncode == 0, done.stderr
    names = ('x', 'y', 'z', 'raw_x', 'raw_y', 'raw_z')
    with table.open() as stream:
        return {
            int(row['stamp'].replace('.', '')): np.array([float(row[name]) for name in names])
            for row in csv.DictReader(stream)
        }


def figure(report: str, name: str) -> str:
    found = re.search(rf'^  {re.escape(name)} +(\S+)', report, re.MULTILINE)
    assert found, report
    return found[1]


def test_every_pair_reaches_the_pose_and_agrees_with_process(bag, offline, ros_domain, tmp_path):
    recorder = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'record', '-o', str(tmp_path / 'live')],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert 'recording to' in recorder.stderr.readline()
    replay = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'replay', str(bag), '--start-paused', *EVERY],
        stdout=subprocess.PIPE,
        text=True,
    )
    awaited = {POSE, '/stereo/target/position'}
    while awaited:
        # Not before the recorder hears all that it is to record.
        awaited -= {recorder.stderr.readline().split()[-1]}
    with neighbour() as node:
        resume = node.create_client(Trigger, 'player/resume')
        assert resume.wait_for_service(60.0)
        resume.call(Trigger.Request())
        out, _ = replay.communicate(timeout=120)
    recorder.send_signal(2)
    _, errors = recorder.communicate(timeout=60)
    assert replay.returncode == 0
    assert recorder.returncode == 0, errors
    for name in ('pairs seen', 'pairs used', 'poses'):
        assert figure(out, name) == str(PAIRS)
    assert figure(out, 'dropped') == '0'
    assert 'latency from stamp to pose, median' in out
    with BagReader(tmp_path / 'live') as reader:
        live = {}
        for topic, part in ((POSE, slice(0, 3)), ('/stereo/target/position', slice(3, 6))):
            for record in reader.messages([topic]):
                message = reader.decode(record)
                live.setdefault(stamp_of(message), np.full(6, np.nan))[part] = position_of(message)
                assert np.linalg.eigvalsh(covariance_of(message)).min() > 0
    assert live.keys() == offline.keys()
    worst = max(np.abs(live[stamp] - offline[stamp]).max() for stamp in live)
    print(f'live and process differ by at most {worst:.1e} m')
    assert worst <= 1e-9
    # The recording holds the interface and the calibration that it needs.
    again = binopos('process', tmp_path / 'live', '-o', tmp_path / 'again.mcap')
    assert again.returncode == 0, again.stderr
    assert figure(again.stdout, 'pairs used') == str(PAIRS)


def check_sum(report: str) -> dict[str, int]:
    """Pairs by the reason why they gave no pose; fails where they and the poses are not all."""
    found = re.findall(r'^  dropped: (.*?) +(\d+)$', report, re.MULTILINE)
    dropped = {reason: int(count) for reason, count in found}
    total = int(figure(report, 'poses')) + sum(dropped.values())
    assert int(figure(report, 'pairs seen')) == total, report
    return dropped


def test_pairs_seen_are_poses_and_reasons_whatever_holds_the_nodes_up(bag, ros_domain):
    """The detector and the triangulator stand still for a while, and go on."""
    running = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'replay', str(bag), '--rate', '0.3'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert is_under_way(running)
    for name in ('detector', 'triangulator'):
        (pid,) = processes(running.pid, name)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(1.2)
        os.kill(pid, signal.SIGCONT)
    report, errors = running.communicate(timeout=90)
    assert running.returncode == 0, errors
    assert figure(report, 'pairs seen') == str(PAIRS)
    # Overtaken, or lost with a node that stood for so long that it was replaced.
    assert check_sum(report)


def test_an_interrupted_replay_accounts_for_its_pairs_too(bag, ros_domain):
    running = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'replay', str(bag), '--loop'],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert is_under_way(running)
    running.send_signal(signal.SIGINT)
    report, _ = running.communicate(timeout=60)
    assert running.returncode == 130
    check_sum(report)


def is_under_way(replay: subprocess.Popen[str]) -> bool:
    """Wait for a status with a position in it; whether one came."""
    return any(' m \u00b1' in line for line in replay.stdout)


def processes(parent: int, name: str) -> list[int]:
    """Process ids of a parent's nodes of that name."""
    found = []
    for entry in Path('/proc').glob('[0-9]*'):
        try:
            words = (entry / 'cmdline').read_bytes().decode().split('\0')
            stat = (entry / 'stat').read_text()
        except OSError:
            continue
        if STARTER in words and name in words and f' {parent} ' in stat.rpartition(')')[2]:
            found.append(int(entry.name))
    return found


def test_in_a_pipe_it_tells_calmly_how_it_goes(bag, ros_domain):
    done = binopos('replay', bag)
    # One for each ten seconds, of which the bag has three.
    assert done.stdout.count(' m \u00b1') == 1
    assert '\r' not in done.stdout
    assert 'Traceback' not in done.stderr


def test_all_nodes_in_one_process_give_the_same_report(bag, ros_domain):
    view = ('--view', '--ros-args', '-p', 'viewer:port:=0')
    done = binopos('replay', bag, '--single-process', '--rate', '0.5', *EVERY, *view)
    assert done.returncode == 0, done.stderr
    assert figure(done.stdout, 'poses') == str(PAIRS)
    assert 'the page is served at http://127.0.0.1:' in done.stdout


def test_a_bag_of_another_namespace_is_played_in_it(bag, ros_domain, tmp_path):
    """With a parameter file that mixes whole numbers with others, and calibrations of its own."""
    from binopos_ros.bag import BagWriter

    mixed = tmp_path / 'mixed.yaml'
    text = (bag / 'binopos.yaml').read_text()
    assert '[1.0, 1.333]' in text
    mixed.write_text(text.replace('[1.0, 1.333]', '[1, 1.333]'))
    moved = tmp_path / 'moved'
    with BagReader(bag) as reader, BagWriter(moved) as writer:
        topics = [topic for topic in reader.topics if not topic.endswith('/camera_info')]
        for topic in topics:
            writer.add_topic(topic.replace('/stereo/', '/rig_2/'), reader.topics[topic].type)
        for record in reader.messages(topics):
            writer.write(record.topic.replace('/stereo/', '/rig_2/'), record.stamp_ns, record.data)
    words = ('--config', mixed, '--calibration', bag, '--rate', '0.5', *EVERY)
    done = binopos('replay', moved, *words)
    assert done.returncode == 0, done.stderr
    assert figure(done.stdout, 'poses') == str(PAIRS)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--rate', '0'], "'rate'"),
        (['--start-offset', '-1'], "'start_offset'"),
        (['--topics', '/nothing'], '/nothing'),
        (['--remap', 'a=b'], 'FROM:=TO'),
        (['--config', 'no_such.yaml'], 'no_such.yaml'),
        (['--calibration', 'no_such'], 'no_such/left.yaml'),
        (['--ros-args', '-p', 'smoother:max_jmp:=1.0'], "did you mean 'max_jump'?"),
        (['--ros-args', '-p', 'smother:max_jump:=1.0'], "did you mean 'smoother'?"),
    ],
)
def test_a_bad_argument_is_one_line(bag, ros_domain, words, said):
    done = binopos('replay', bag, *EVERY, *words)
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1, done.stderr
    assert said in done.stderr


@pytest.fixture(scope='module')
def small_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('small') / 'bag'
    done = binopos('simulate', '-o', folder, '--preset', 'demo', '--pairs', PAIRS)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope='module')
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of the washbowl."""
    folder = tmp_path_factory.mktemp('short') / 'bag'
    done = binopos('simulate', '-o', folder, '--preset', 'washbowl', '--pairs', 30)
    assert done.returncode == 0, done.stderr
    return folder


def joined(bag: Path, copy: Path) -> Path:
    """The bag's two views side by side in one topic, under names that tell nothing."""
    import cv2

    from binopos_ros.bag import BagWriter, messages

    views: dict[str, np.ndarray] = {}
    with BagReader(bag) as reader, BagWriter(copy) as writer:
        writer.add_topic('/zed/both', messages.IMAGE)
        for side in ('left', 'right'):
            writer.add_topic(f'/zed/{side}/camera_info', messages.CAMERA_INFO)
        for record in reader.messages():
            _, _, side, rest = record.topic.split('/', 3)
            if rest == 'camera_info':
                # Too late for all pictures but for a reader of the whole bag.
                name, stamp = f'/zed/{side}/camera_info', record.stamp_ns + 3 * 10**9
                writer.write(name, stamp, record.data)
            elif rest == 'image_raw/compressed':
                message = reader.decode(record)
                views[side] = cv2.imdecode(message.data, cv2.IMREAD_COLOR)
                if side == 'right':
                    both = np.hstack([views['left'], views['right']])
                    size = (both.shape[1], both.shape[0])
                    picture = messages.image(
                        stamp_of(message), 'cam', both.ravel(), size, 'bgr8', both.shape[1] * 3
                    )
                    writer.write('/zed/both', record.stamp_ns, picture)
    return copy


def test_side_by_side_views_with_late_calibrations_are_played_as_the_rig(
    small_bag, ros_domain, tmp_path
):
    copy = joined(small_bag, tmp_path / 'both')
    config = ('--config', small_bag / 'binopos.yaml')
    done = binopos('replay', copy, '--side-by-side', '/zed/both', *config, *EVERY)
    assert done.returncode == 0, done.stderr
    assert figure(done.stdout, 'poses') == str(PAIRS)


def test_images_of_other_names_are_played_as_the_rig(small_bag, ros_domain, tmp_path):
    from binopos_ros.bag import BagWriter

    names = {'/stereo/left/': '/port/', '/stereo/right/': '/starboard/'}

    def name(topic: str) -> str:
        for old, new in names.items():
            topic = topic.replace(old, new)
        return topic.replace('image_raw/compressed', 'jpeg')

    copy = tmp_path / 'named'
    with BagReader(small_bag) as reader, BagWriter(copy) as writer:
        for topic, info in reader.topics.items():
            writer.add_topic(name(topic), info.type)
        for record in reader.messages():
            writer.write(name(record.topic), record.stamp_ns, record.data)
    words = ('--config', small_bag / 'binopos.yaml')
    done = binopos(
        'replay', copy, '--left', '/port/jpeg', '--right', '/starboard/jpeg', *EVERY, *words
    )
    assert done.returncode == 0, done.stderr
    assert figure(done.stdout, 'poses') == str(PAIRS)


def test_cameras_that_are_swapped_by_remap_are_swapped_once(short, ros_domain):
    """Twice is not at all: the nodes then find every pair where it was."""
    sides = ('left', 'right')
    rules = [
        f'/stereo/{a}/image_raw/compressed:=/stereo/{b}/image_raw/compressed'
        for a, b in (sides, sides[::-1])
    ]
    done = binopos('replay', short, '--remap', *rules, *EVERY)
    assert 'Traceback' not in done.stderr
    assert figure(done.stdout, 'pairs seen') == '30'
    assert figure(done.stdout, 'pairs used') == '0'


@pytest.mark.parametrize(
    'words',
    [
        ['--clock'],
        ['--ros-args', '-p', 'use_sim_time:=true'],
        # A busy machine's positions may be older than the time for which poses are foretold.
        [
            '--ros-args',
            *('-p', 'smoother:sensor_timeout:=30.0'),
            *('-p', 'smoother:output_rate:=60.0'),
        ],
    ],
    ids=['clock', 'use_sim_time', 'output_rate'],
)
def test_it_ends_and_gives_poses_by_whatever_clock(short, ros_domain, words):
    done = binopos('replay', short, *EVERY, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert figure(done.stdout, 'pairs used') == '30'
    assert int(figure(done.stdout, 'poses')) >= (30 if 'output_rate' not in words[-1] else 20)


@contextmanager
def neighbour() -> Iterator[Node]:
    """A node of somebody else on the same domain, which spins beside the test."""
    context = rclpy.Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node('neighbour', namespace='stereo', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    yield node
    executor.shutdown()
    thread.join(5.0)
    rclpy.try_shutdown(context=context)


def test_other_suites_are_told_from_ones_own(short, ros_domain):
    """A neighbour's drops are not counted; a second suite on the same topics is refused."""
    status = DiagnosticStatus(name='rig_2/detector: stage')
    status.values = [KeyValue(key='Dropped: left: nothing red', value='7')]
    with neighbour() as node:
        diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        node.create_timer(0.2, lambda: diagnostics.publish(DiagnosticArray(status=[status])))
        done = binopos('replay', short, *EVERY)
        assert done.returncode == 0, done.stderr
        assert figure(done.stdout, 'dropped') == '0'
        node.create_publisher(PoseWithCovarianceStamped, 'target/pose', 10)
        done = binopos('replay', short, *EVERY)
    assert done.returncode == 2
    (line,) = (line for line in done.stderr.splitlines() if line.startswith('binopos replay'))
    assert '/stereo/target/pose is published by 2 nodes: /stereo/neighbour, ' in line
