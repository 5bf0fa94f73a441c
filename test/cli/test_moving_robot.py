"""A rig that a robot carries, from images to the pose in the fixed frame."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from binopos_ros.bag import BagReader, BagWriter, messages
from binopos_ros.bag.definitions import jazzy
from binopos_ros.bag.messages import position_of, serialized_stamp, stamp_of, transforms
from binopos_ros.cli.simulated_bag import START_NS
from docking import Dock
from moving_robot import ODOMETRY, PAIRS, decoded, edited, places, process, rows_of, words
from verbs import binopos

pytestmark = pytest.mark.xdist_group('moving_robot')

#: The simulated odometry's own, in radians.
KNOWN = ('platform.position_std:=0.002', 'platform.rotation_std:=0.0017453')


@pytest.fixture(scope='module')
def by_known(
    hovering_bag: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[int, dict[str, str]], str]:
    """Rows and report with the odometry's deviations given, instead of its covariance."""
    return process(hovering_bag, tmp_path_factory.mktemp('known'), *KNOWN)


def test_transforms_and_odometry_give_the_same_poses_in_the_fixed_frame(
    hovering_bag, by_known, tmp_path
):
    by_odometry, report = by_known
    by_tf, _ = process(hovering_bag, tmp_path / 'tf', 'platform.source:=tf', *KNOWN)
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
    with BagReader(hovering_bag) as reader:
        truth = {
            stamp_of(message): position_of(message)
            for message in map(reader.decode, reader.messages(['/stereo/truth/fixed_pose']))
        }
    late = list(by_odometry)[PAIRS // 2 :]
    assert words(tmp_path / 'tf') == ['starting', 'tracking']
    errors = places(by_odometry)[PAIRS // 2 :] - [truth[stamp] for stamp in late]
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.0015


def test_what_the_covariance_says_is_what_the_odometry_says_unless_it_is_given(
    hovering_processed, by_known
):
    own, (given, _) = rows_of(hovering_processed), by_known
    first = next(iter(own))
    for axis in ('sx', 'sy', 'sz'):
        assert abs(float(own[first][axis]) / float(given[first][axis]) - 1) < 0.01


def test_without_a_fixed_frame_nothing_is_asked_of_the_robot(hovering_bag, tmp_path):
    rows, report = process(hovering_bag, tmp_path / 'rig', "fixed_frame:=''")
    raw = np.array([[float(row[f'raw_{axis}']) for axis in 'xyz'] for row in rows.values()])
    assert np.abs(places(rows) - raw).max() < 0.01
    assert 'frame of target/pose' not in report


def test_pairs_without_a_pose_of_the_robot_are_counted_and_nothing_else_is_lost(
    hovering_bag, tmp_path
):
    gap = (START_NS + 300_000_000, START_NS + 950_000_000)

    def outside(data: bytes) -> bytes | None:
        return None if gap[0] < serialized_stamp(data) < gap[1] else data

    def before(data: bytes) -> bytes | None:
        return data if serialized_stamp(data) < gap[1] else None

    cut = edited(hovering_bag, tmp_path / 'cut', ODOMETRY, outside)
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
    end = edited(hovering_bag, tmp_path / 'end', ODOMETRY, before)
    rows, report = process(end, tmp_path / 'out2')
    assert [bool(row['x']) for row in rows.values()] == [
        stamp <= gap[1] - 10_000_000 for stamp in rows
    ]
    assert 'the odometry ends # s before the image' in report


def test_transforms_that_cannot_be_cost_only_themselves(hovering_bag, tmp_path):
    folder = tmp_path / 'bad'
    folder.mkdir()
    at = START_NS + 500_000_000
    same, nowhere = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    bad = transforms(
        at,
        ('odom', 'base_link', nowhere, (0.0, 0.0, 0.0, 3.0)),
        ('map', 'base_link', nowhere, same),
        ('base_link', 'odom', nowhere, same),
        ('odom', '', nowhere, same),
        ('base_link', 'left_camera_optical_frame', nowhere, same),
    )
    with BagReader(hovering_bag) as reader:
        known = stamp_of(reader.decode(next(reader.messages([ODOMETRY]))))
    contradicting = transforms(known, ('odom', 'base_link', (9.0, 0.0, 0.0), same))
    with BagReader(hovering_bag) as reader, BagWriter(folder / 'bag') as writer:
        for name, info in reader.topics.items():
            writer.add_topic(name, info.type, qos=tuple(info.qos))
        for record in reader.messages():
            writer.write(record.topic, record.stamp_ns, record.data)
            if record.topic == '/tf_static':
                writer.write('/tf', at, bad)
                # Another than that one's own, which comes before it by its stamp.
                writer.write('/tf', known + 1, contradicting)
    (folder / 'bag' / 'binopos.yaml').write_text((hovering_bag / 'binopos.yaml').read_text())
    good, _ = process(hovering_bag, tmp_path / 'good', 'platform.source:=tf')
    rows, report = process(folder / 'bag', tmp_path / 'out', 'platform.source:=tf')
    assert rows == good
    for reason in (
        'quaternion of length #',
        'has two parents',
        'go in a circle',
        'names no frame',
        'is static and comes as a moving one too',
        'is told twice for one stamp, differently',
    ):
        assert reason in report


def test_a_jump_of_the_robot_costs_the_pairs_about_it(hovering_bag, hovering_processed, tmp_path):
    """As a loop closed in its map: from one sample to the next it is somewhere else."""
    jump = START_NS + 670_000_000

    def moved_on(data: bytes) -> bytes | Any:
        if serialized_stamp(data) < jump:
            return data
        message = jazzy().deserialize_cdr(data, messages.ODOMETRY)
        message.pose.pose.position.x += 3.0
        return message

    jumping = edited(hovering_bag, tmp_path / 'jumping', ODOMETRY, moved_on)
    rows, report = process(jumping, tmp_path / 'out')
    (lost,) = [stamp for stamp, row in rows.items() if not row['x']]
    assert abs(lost - jump) < 20_000_000
    assert 'smoother: the odometry jumps by # m in # s about the image' in report
    # What comes after is where the robot's own frame now says that it is.
    moved = places(rows)[-1] - places(rows_of(hovering_processed))[-1]
    np.testing.assert_allclose(moved, [3.0, 0, 0], atol=0.005)


def test_a_fixed_frame_that_does_not_exist_is_named_with_those_that_do(hovering_bag, tmp_path):
    values = 'platform.source:=tf', 'fixed_frame:=nowhere'
    rows, report = process(hovering_bag, tmp_path / 'out', *values)
    assert len(rows) == PAIRS
    assert not any(row['x'] for row in rows.values())
    (line,) = [each for each in report.splitlines() if 'dropped' in each]
    assert "no transform has the frame 'nowhere'; known: base_link" in line
    assert line.endswith(f' {PAIRS}')


def test_a_docking_server_makes_of_the_pose_a_goal_before_the_target(
    hovering_bag, hovering_processed
):
    page = Path(__file__).parents[2] / 'docs' / 'robot.md'
    (block,) = re.findall(r'```yaml\n(docking_server:.*?)```', page.read_text(), re.DOTALL)
    server = yaml.safe_load(block)['docking_server']['ros__parameters']
    dock = Dock(server['fixed_frame'], server['valve'])
    for message in decoded(hovering_processed, 'target/pose_stamped'):
        turn = message.pose.orientation
        quaternion = (turn.x, turn.y, turn.z, turn.w)
        pose = message.header.frame_id, position_of(message), quaternion
        stamp = stamp_of(message) * 1e-9
        assert dock.refined(stamp + 1.1, stamp, *pose) is None
        goal, heading = dock.refined(stamp + 0.3, stamp, *pose)
    with BagReader(hovering_bag) as reader:
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
def test_bad_parameters_end_in_one_line(hovering_bag, tmp_path, value, told):
    done = binopos(
        *(
            'process',
            hovering_bag,
            '-o',
            tmp_path / 'out.mcap',
            '--ros-args',
            '-p',
            f'smoother:{value}',
        )
    )
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert told in done.stderr


def test_a_bag_without_the_robot_s_motion_says_what_to_record(hovering_bag, tmp_path):
    none = edited(hovering_bag, tmp_path / 'none', ODOMETRY, lambda _: None)
    done = binopos('process', none, '-o', tmp_path / 'out.mcap')
    assert done.returncode == 2
    assert '/stereo/platform/odometry is missing or empty' in done.stderr


@pytest.mark.parametrize('source', ['odometry', 'tf'])
def test_calibrate_check_tells_whether_a_target_at_rest_stays_where_it_is(hovering_bag, source):
    value = f'smoother:platform.source:={source}'
    done = binopos('calibrate', 'check', hovering_bag, '--ros-args', '-p', value)
    assert done.returncode == 0, done.stderr
    assert 'mounting and odometry fit the calibration' in done.stdout
    # Given in the camera's axes instead of the robot's.
    mounting = 'smoother:platform.mounting:=[0.2, 0.06, -0.05, 0.0, 0.0, 0.0, 1.0]'
    done = binopos('calibrate', 'check', hovering_bag, '--ros-args', '-p', mounting)
    assert 'more than stated' in done.stdout
