"""A rig that a robot carries, live: the nodes, their transforms, what is recorded of them."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of, stamp_of, transforms_of
from moving_robot import ODOMETRY, PAIRS, places, process, rows_of
from verbs import binopos

pytestmark = pytest.mark.live


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


def test_live_nodes_and_process_give_the_same_poses_by_odometry(
    hovering_bag, hovering_processed, ros_domain, tmp_path
):
    rows = rows_of(hovering_processed)
    poses, report = live(hovering_bag, tmp_path / 'live')
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


def test_live_nodes_and_process_give_the_same_poses_by_transforms(
    hovering_bag, ros_domain, tmp_path, tf_environment, monkeypatch
):
    for name, value in tf_environment.items():
        monkeypatch.setenv(name, value)
    values = ('platform.source:=tf', 'publish_tf:=true', 'child_frame:=valve')
    rows, _ = process(hovering_bag, tmp_path / 'offline', *values)
    poses, _ = live(hovering_bag, tmp_path / 'live', *values)
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


@pytest.mark.parametrize('value', ['platform.source:=tf', 'publish_tf:=true'])
def test_without_the_message_package_one_line_says_what_to_do(hovering_bag, ros_domain, value):
    if importlib.util.find_spec('tf2_msgs') is not None:
        pytest.skip('tf2_msgs is installed here')
    done = binopos('replay', hovering_bag, '--ros-args', '-p', f'smoother:{value}')
    assert done.returncode == 2
    (line,) = [each for each in done.stderr.splitlines() if 'tf2_msgs' in each and 'apt' in each]
    assert 'ros-jazzy-tf2-msgs' in line


def test_the_camera_node_offers_the_right_camera_s_frame_under_the_left_one_s(
    hovering_bag, ros_domain, tmp_path, tf_environment, monkeypatch
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
        **{
            f'{side}.camera_info_url': str(hovering_bag / f'{side}.yaml')
            for side in ('left', 'right')
        },
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
    with BagReader(hovering_bag) as reader:
        simulated = reader.decode(next(reader.messages(['/tf_static'])))
    ((_, parent, child, place, turn),) = transforms_of(message)
    (expected,) = [each for each in transforms_of(simulated) if each[2] == child]
    assert (parent, child) == ('left_camera_optical_frame', 'right_camera_optical_frame')
    np.testing.assert_allclose(place, expected[3], atol=1e-9)
    np.testing.assert_allclose(turn, expected[4], atol=1e-9)
