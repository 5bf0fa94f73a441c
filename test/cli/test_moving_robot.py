"""A rig that a robot carries, from images to the pose in the fixed frame."""

from __future__ import annotations

import csv
import importlib.util
import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from binopos_ros.bag import BagReader, BagWriter
from binopos_ros.bag.messages import (
    position_of,
    serialized_stamp,
    stamp_of,
    transforms,
    transforms_of,
)
from binopos_ros.cli.simulated_bag import START_NS
from docking import Dock
from verbs import binopos

pytestmark = pytest.mark.xdist_group('moving_robot')

PAIRS = 40
ODOMETRY = '/stereo/platform/odometry'
#: The simulated odometry's own, in radians.
KNOWN = ('platform.position_std:=0.002', 'platform.rotation_std:=0.0017453')


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A target at rest, seen from a robot that hovers a metre before it."""
    folder = tmp_path_factory.mktemp('hover') / 'bag'
    done = binopos(
        *('simulate', '-o', folder, '--preset', 'ports', '--still', '--motion', 'hover'),
        *('--pairs', PAIRS, '--seed', 3, '--distractors', 0),
    )
    assert done.returncode == 0, done.stderr
    return folder


def process(
    bag: Path, out: Path, *values: str, words: tuple[object, ...] = ()
) -> tuple[dict[int, dict[str, str]], str]:
    """The rows by stamp that `process` writes with parameters of the smoother, and its report."""
    out.mkdir(exist_ok=True)
    parameters = [word for value in values for word in ('-p', f'smoother:{value}')]
    done = binopos(
        *('process', bag, '-o', out / 'out.mcap', '--csv', out / 'out.csv', *words),
        *(['--ros-args', *parameters] if parameters else []),
    )
    assert done.returncode == 0, done.stderr
    with (out / 'out.csv').open(newline='') as stream:
        rows = {int(row['stamp'].replace('.', '')): row for row in csv.DictReader(stream)}
    return rows, done.stdout


def places(rows: dict[int, dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[axis] or 'nan') for axis in 'xyz'] for row in rows.values()])


def decoded(folder: Path, topic: str) -> list[Any]:
    """The messages of a topic in what `process` wrote."""
    with BagReader(folder / 'out.mcap') as reader:
        return [reader.decode(each) for each in reader.messages([f'/stereo/{topic}'])]


def words(folder: Path) -> list[str]:
    """What the target's health went through."""
    told = [each.message for each in decoded(folder, 'target/health')]
    return [word for word, before in zip(told, ['', *told], strict=False) if word != before]


def edited(bag: Path, folder: Path, topic: str, keep) -> Path:
    """The bag with those messages of a topic that `keep`, called with their stamps, is true of."""
    folder.mkdir()
    with BagReader(bag) as reader, BagWriter(folder / 'bag') as writer:
        for name, info in reader.topics.items():
            writer.add_topic(name, info.type, qos=tuple(info.qos))
        for record in reader.messages():
            if record.topic != topic or keep(serialized_stamp(record.data)):
                writer.write(record.topic, record.stamp_ns, record.data)
    (folder / 'bag' / 'binopos.yaml').write_text((bag / 'binopos.yaml').read_text())
    return folder / 'bag'


def test_transforms_and_odometry_give_the_same_poses_in_the_fixed_frame(bag, tmp_path):
    by_odometry, report = process(bag, tmp_path / 'odometry', *KNOWN)
    by_tf, _ = process(bag, tmp_path / 'tf', 'platform.source:=tf', *KNOWN)
    assert len(by_odometry) == PAIRS
    np.testing.assert_allclose(places(by_odometry), places(by_tf), atol=1e-6)
    assert 'frame of target/pose' in report
    with BagReader(tmp_path / 'tf' / 'out.mcap') as reader:
        poses = [
            reader.decode(each)
            for each in reader.messages(['/stereo/target/pose', '/stereo/target/odometry'])
        ]
        positions = [reader.decode(each) for each in reader.messages(['/stereo/target/position'])]
    assert {each.header.frame_id for each in poses} == {'odom'}
    assert {each.header.frame_id for each in positions} == {'left_camera_optical_frame'}
    # Against the truth: much nearer than the odometry is from sample to sample.
    with BagReader(bag) as reader:
        truth = {
            stamp_of(message): position_of(message)
            for message in map(reader.decode, reader.messages(['/stereo/truth/fixed_pose']))
        }
    late = list(by_odometry)[PAIRS // 2 :]
    assert words(tmp_path / 'tf') == ['starting', 'tracking']
    errors = places(by_odometry)[PAIRS // 2 :] - [truth[stamp] for stamp in late]
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.0015


def test_what_the_covariance_says_is_what_the_odometry_says_unless_it_is_given(bag, tmp_path):
    own, _ = process(bag, tmp_path / 'own')
    given, _ = process(bag, tmp_path / 'given', *KNOWN)
    first = next(iter(own))
    for axis in ('sx', 'sy', 'sz'):
        assert abs(float(own[first][axis]) / float(given[first][axis]) - 1) < 0.01


def test_without_a_fixed_frame_nothing_is_asked_of_the_robot(bag, tmp_path):
    rows, report = process(bag, tmp_path / 'rig', "fixed_frame:=''")
    raw = np.array([[float(row[f'raw_{axis}']) for axis in 'xyz'] for row in rows.values()])
    assert np.abs(places(rows) - raw).max() < 0.01
    assert 'frame of target/pose' not in report


def test_pairs_without_a_pose_of_the_robot_are_counted_and_nothing_else_is_lost(bag, tmp_path):
    gap = (START_NS + 300_000_000, START_NS + 950_000_000)
    cut = edited(bag, tmp_path / 'cut', ODOMETRY, lambda stamp: not gap[0] < stamp < gap[1])
    rows, report = process(cut, tmp_path / 'out')
    assert len(rows) == PAIRS
    without = [stamp for stamp, row in rows.items() if not row['x']]
    inside = [stamp for stamp in rows if gap[0] < stamp < gap[1]]
    assert without == inside
    assert 'dropped: smoother: the odometry has a gap of # s about the image' in report
    assert words(tmp_path / 'out') == ['starting', 'tracking', 'coasting', 'lost', 'tracking']
    lost = next(each for each in decoded(tmp_path / 'out', 'target/health') if each.level == 2)
    values = {each.key: each.value for each in lost.values}
    assert 'the odometry ends' in values['Reason']
    assert values['Frame'] == 'odom'
    end = edited(bag, tmp_path / 'end', ODOMETRY, lambda stamp: stamp < gap[1])
    rows, report = process(end, tmp_path / 'out2')
    assert [bool(row['x']) for row in rows.values()] == [
        stamp <= gap[1] - 10_000_000 for stamp in rows
    ]
    assert 'the odometry ends # s before the image' in report


def test_transforms_that_cannot_be_cost_only_themselves(bag, tmp_path):
    folder = tmp_path / 'bad'
    folder.mkdir()
    at = START_NS + 500_000_000
    same, nowhere = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    bad = transforms(
        at,
        ('odom', 'base_link', nowhere, (0.0, 0.0, 0.0, 3.0)),
        ('map', 'base_link', nowhere, same),
        ('base_link', 'odom', nowhere, same),
    )
    with BagReader(bag) as reader, BagWriter(folder / 'bag') as writer:
        for name, info in reader.topics.items():
            writer.add_topic(name, info.type, qos=tuple(info.qos))
        for record in reader.messages():
            writer.write(record.topic, record.stamp_ns, record.data)
            if record.topic == '/tf_static':
                writer.write('/tf', at, bad)
    (folder / 'bag' / 'binopos.yaml').write_text((bag / 'binopos.yaml').read_text())
    good, _ = process(bag, tmp_path / 'good', 'platform.source:=tf')
    rows, report = process(folder / 'bag', tmp_path / 'out', 'platform.source:=tf')
    assert rows == good
    for reason in ('quaternion of length #', 'has two parents', 'go in a circle'):
        assert reason in report


def test_a_docking_server_makes_of_the_pose_a_goal_before_the_target(bag, tmp_path):
    process(bag, tmp_path / 'out')
    page = Path(__file__).parents[2] / 'docs' / 'robot.md'
    (block,) = re.findall(r'```yaml\n(docking_server:.*?)```', page.read_text(), re.DOTALL)
    server = yaml.safe_load(block)['docking_server']['ros__parameters']
    dock = Dock(server['fixed_frame'], server['valve'])
    for message in decoded(tmp_path / 'out', 'target/pose_stamped'):
        turn = message.pose.orientation
        quaternion = (turn.x, turn.y, turn.z, turn.w)
        pose = message.header.frame_id, position_of(message), quaternion
        stamp = stamp_of(message) * 1e-9
        assert dock.refined(stamp + 1.1, stamp, *pose) is None
        goal, heading = dock.refined(stamp + 0.3, stamp, *pose)
    with BagReader(bag) as reader:
        truth = position_of(reader.decode(next(reader.messages(['/stereo/truth/fixed_pose']))))
    before = 0.6 * np.array([np.cos(0.5), np.sin(0.5)])
    np.testing.assert_allclose(goal[:2], truth[:2] - before, atol=0.003)
    assert abs(heading - 0.5) < 1e-9
    assert dock.lookups == []


@pytest.mark.parametrize(
    ('value', 'told'),
    [
        ('platform.source:=none', "set platform.source to 'tf' or 'odometry'"),
        ('platform.mounting:=[0.0, 0.0]', 'give seven'),
        ('platform.mounting:=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0]', 'quaternion of length 2'),
        ('platform.timeout:=-1.0', 'platform.timeout'),
    ],
)
def test_bad_parameters_end_in_one_line(bag, tmp_path, value, told):
    done = binopos(
        *('process', bag, '-o', tmp_path / 'out.mcap', '--ros-args', '-p', f'smoother:{value}')
    )
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert told in done.stderr


def test_a_bag_without_the_robot_s_motion_says_what_to_record(bag, tmp_path):
    none = edited(bag, tmp_path / 'none', ODOMETRY, lambda stamp: False)
    done = binopos('process', none, '-o', tmp_path / 'out.mcap')
    assert done.returncode == 2
    assert '/stereo/platform/odometry is missing or empty' in done.stderr


@pytest.mark.parametrize('source', ['odometry', 'tf'])
def test_calibrate_check_tells_whether_a_target_at_rest_stays_where_it_is(bag, source):
    value = f'smoother:platform.source:={source}'
    done = binopos('calibrate', 'check', bag, '--ros-args', '-p', value)
    assert done.returncode == 0, done.stderr
    assert 'mounting and odometry fit the calibration' in done.stdout
    # Given in the camera's axes instead of the robot's.
    mounting = 'smoother:platform.mounting:=[0.2, 0.06, -0.05, 0.0, 0.0, 0.0, 1.0]'
    done = binopos('calibrate', 'check', bag, '--ros-args', '-p', mounting)
    assert 'more than stated' in done.stdout


def live(
    bag: Path, folder: Path, *values: str, nodes: str = 'smoother'
) -> tuple[dict[int, np.ndarray], str]:
    """Poses of the live nodes by stamp, recorded while the bag is replayed; and the report."""
    recorder = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'record', '-o', str(folder)],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert 'recording to' in recorder.stderr.readline()
    words = [word for value in values for word in ('-p', f'{nodes}:{value}')]
    # Every pair, however slow the machine.
    done = binopos(
        *('replay', bag, '--rate', 0.5, '--wait-for-all-acked', 10000, '--ros-args'), *words
    )
    recorder.send_signal(2)
    _, errors = recorder.communicate(timeout=20)
    assert done.returncode == 0, done.stderr
    assert recorder.returncode == 0, errors
    with BagReader(folder) as reader:
        poses = map(reader.decode, reader.messages(['/stereo/target/pose']))
        found = {stamp_of(pose): position_of(pose) for pose in poses}
    return found, done.stdout


def agree(poses: dict[int, np.ndarray], rows: dict[int, dict[str, str]]) -> None:
    """The live nodes and `process` gave the same poses."""
    assert len(poses) == PAIRS, sorted(poses)
    for stamp, row in rows.items():
        np.testing.assert_allclose(poses[stamp], [float(row[axis]) for axis in 'xyz'], atol=1e-9)


@pytest.mark.live
def test_live_nodes_and_process_give_the_same_poses_by_odometry(bag, ros_domain, tmp_path):
    rows, _ = process(bag, tmp_path / 'offline')
    poses, report = live(bag, tmp_path / 'live')
    agree(poses, rows)
    assert 'frame of target/pose' in report
    # What was recorded holds the robot's motion, and is processed to the same again.
    again, _ = process(tmp_path / 'live', tmp_path / 'again')
    np.testing.assert_allclose(places(again), places(rows), atol=1e-9)
    with BagReader(tmp_path / 'live') as reader:
        counts = {topic: info.count for topic, info in reader.topics.items()}
        words = {
            reader.decode(each).message for each in reader.messages(['/stereo/target/health'])
        }
        plain = [reader.decode(each) for each in reader.messages(['/stereo/target/pose_stamped'])]
    assert counts[ODOMETRY] >= PAIRS
    assert {'starting', 'tracking'} <= words
    assert {each.header.frame_id for each in plain} == {'odom'}
    for each in plain:
        np.testing.assert_array_equal(position_of(each), poses[stamp_of(each)])


@pytest.mark.live
def test_live_nodes_and_process_give_the_same_poses_by_transforms(
    bag, ros_domain, tmp_path, tf_environment, monkeypatch
):
    for name, value in tf_environment.items():
        monkeypatch.setenv(name, value)
    values = ('platform.source:=tf', 'publish_tf:=true', 'child_frame:=valve')
    rows, _ = process(bag, tmp_path / 'offline', *values)
    poses, _ = live(bag, tmp_path / 'live', *values)
    agree(poses, rows)
    with BagReader(tmp_path / 'live') as reader:
        told = [
            transform
            for each in reader.messages(['/tf'])
            for transform in transforms_of(reader.decode(each))
        ]
        assert reader.topics['/tf_static'].count
    valve = {stamp: place for stamp, parent, child, place, _ in told if child == 'valve'}
    assert {parent for _, parent, child, _, _ in told if child == 'valve'} == {'odom'}
    assert valve.keys() == poses.keys()
    for stamp, place in valve.items():
        np.testing.assert_array_equal(place, poses[stamp])
    again, _ = process(tmp_path / 'live', tmp_path / 'again', *values)
    np.testing.assert_allclose(places(again), places(rows), atol=1e-9)


@pytest.mark.live
@pytest.mark.parametrize('value', ['platform.source:=tf', 'publish_tf:=true'])
def test_without_the_message_package_one_line_says_what_to_do(bag, ros_domain, value):
    if importlib.util.find_spec('tf2_msgs') is not None:
        pytest.skip('tf2_msgs is installed here')
    done = binopos('replay', bag, '--ros-args', '-p', f'smoother:{value}')
    assert done.returncode == 2
    (line,) = [each for each in done.stderr.splitlines() if 'tf2_msgs' in each and 'apt' in each]
    assert 'ros-jazzy-tf2-msgs' in line


@pytest.mark.live
def test_the_camera_node_offers_the_right_camera_s_frame_under_the_left_one_s(
    bag, ros_domain, tmp_path, tf_environment, monkeypatch
):
    for name, value in tf_environment.items():
        monkeypatch.setenv(name, value)
    recorder = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'record', '-o', str(tmp_path / 'frames')],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    # Without cameras: it waits for them to be plugged in, and knows their places already.
    values = {
        'publish_tf': 'true',
        'width': '1280',
        'height': '960',
        **{f'{side}.camera_info_url': str(bag / f'{side}.yaml') for side in ('left', 'right')},
    }
    words = [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]
    camera = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros.nodes', 'camera', '--ros-args', *words],
        stderr=subprocess.DEVNULL,
    )
    # What never comes is not waited for for ever.
    end = threading.Timer(120, recorder.kill)
    end.start()
    try:
        assert any('recording /tf_static' in line for line in recorder.stderr)
        from listening import await_received  # It needs ROS.

        await_received('/tf_static')
    finally:
        end.cancel()
        camera.send_signal(2)
        camera.wait(20)
        recorder.send_signal(2)
        recorder.communicate(timeout=20)
    with BagReader(tmp_path / 'frames') as reader:
        message, *again = map(reader.decode, reader.messages(['/tf_static']))
    # One that comes just as it is subscribed to may be delivered twice.
    assert all(each == message for each in again)
    with BagReader(bag) as reader:
        simulated = reader.decode(next(reader.messages(['/tf_static'])))
    ((_, parent, child, place, turn),) = transforms_of(message)
    (expected,) = [each for each in transforms_of(simulated) if each[2] == child]
    assert (parent, child) == ('left_camera_optical_frame', 'right_camera_optical_frame')
    np.testing.assert_allclose(place, expected[3], atol=1e-9)
    np.testing.assert_allclose(turn, expected[4], atol=1e-9)
