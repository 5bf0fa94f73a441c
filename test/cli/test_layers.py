"""One rule for parameters: what `process` takes from files, from the bag and from the words."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from binopos_ros.bag import BagReader, BagWriter
from binopos_ros.optics import read_camera_info, write_camera_info
from verbs import Done, binopos, simulated

pytestmark = pytest.mark.xdist_group('layers')

PAIRS = 20
FRONT = '/auv7/front'


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated(tmp_path_factory.mktemp('layers') / 'bag', 'washbowl', PAIRS)


@pytest.fixture(scope='module')
def front(bag: Path) -> Path:
    """The same of a rig below /auv7/front, without a parameter file."""
    moved = bag.with_name('front')
    with BagReader(bag) as reader, BagWriter(moved) as writer:
        for topic, info in reader.topics.items():
            writer.add_topic(topic.replace('/stereo', FRONT), info.type)
        for record in reader.messages():
            writer.write(record.topic.replace('/stereo', FRONT), record.stamp_ns, record.data)
    return moved


@pytest.fixture
def process(tmp_path: Path):
    def run(bag: Path, *words: object) -> Done:
        return binopos('process', bag, '-o', tmp_path / 'out.mcap', *words)

    return run


def raw_error_mm(done: Done) -> float:
    assert done.returncode == 0, done.stderr
    found = re.search(r'error of target/position against truth, RMS +(\S+) mm', done.stdout)
    assert found, done.stdout
    return float(found[1])


def cases(project: Path) -> Path:
    folder = project.parent / 'shared' / 'cases'
    if not folder.is_dir():
        pytest.skip('the cases of other people are absent: ../shared/cases does not exist')
    return folder


def test_a_file_for_two_rigs_is_read_by_the_bags_namespace(process, front, project):
    done = process(front, '--config', cases(project) / 'two_rigs.yaml')
    assert raw_error_mm(done) < 1.0


def test_a_robots_shared_file_is_taken(process, bag, project):
    done = process(bag, '--config', cases(project) / 'robot_wide.yaml')
    assert raw_error_mm(done) < 1.0
    assert done.stderr == ''


def test_a_file_with_one_block_leaves_the_bags_interface(process, bag, tmp_path):
    config = tmp_path / 'one_block.yaml'
    config.write_text('/**/smoother: {ros__parameters: {max_jump: 0.5}}')
    done = process(bag, '--config', config, '--ros-args', '-p', 'smoother:max_gap:=1')
    assert raw_error_mm(done) < 1.0
    (line,) = (line for line in done.stdout.splitlines() if line.startswith('  parameters'))
    assert f'defaults, {bag}/binopos.yaml, {config}, -p smoother:max_gap:=1' in line


def test_a_single_files_parameters_lie_beside_it(process, bag, tmp_path):
    single = tmp_path / 'dive.mcap'
    single.write_bytes(next(bag.glob('*.mcap')).read_bytes())
    (tmp_path / 'dive.binopos.yaml').write_bytes((bag / 'binopos.yaml').read_bytes())
    assert raw_error_mm(process(single)) < 1.0


def test_whole_numbers_in_a_list_work(process, bag, tmp_path):
    config = tmp_path / 'whole.yaml'
    config.write_text('/**/triangulator: {ros__parameters: {interface.indices: [1, 1.333]}}')
    assert raw_error_mm(process(bag, '--config', config)) < 1.0


def test_a_misspelt_block_is_told_and_a_misspelt_word_refused(process, bag, tmp_path):
    config = tmp_path / 'rig.yaml'
    config.write_text('/**/smother: {ros__parameters: {max_jump: 0.5}}')
    done = process(bag, '--config', config)
    assert done.returncode == 0
    assert 'rig.yaml:1: /**/smother names no node of the suite' in done.stderr
    done = process(bag, '--ros-args', '-p', 'triangulater:method:=straight')
    assert done.returncode == 2
    assert "the suite has no node 'triangulater': did you mean 'triangulator'?" in done.stderr
    assert done.stderr.count('\n') == 1


def test_a_later_calibration_is_applied_to_a_recorded_bag(process, bag, tmp_path):
    """A baseline that is one per cent longer puts everything farther away."""
    for side in ('left', 'right'):
        (tmp_path / f'{side}.yaml').write_bytes((bag / f'{side}.yaml').read_bytes())
    assert raw_error_mm(process(bag, '--calibration', tmp_path)) < 1.0
    right = read_camera_info(tmp_path / 'right.yaml')
    p = list(right.p)
    p[3] *= 1.01
    write_camera_info(tmp_path / 'right.yaml', dataclasses.replace(right, p=tuple(p)))
    (tmp_path / 'out.mcap').unlink()
    done = process(bag, '--calibration', tmp_path)
    assert raw_error_mm(done) > 5.0
    assert f', --calibration {tmp_path}' in done.stdout


def test_the_dumped_parameters_of_a_node_can_be_used_again(process, bag, tmp_path):
    """`ros2 param dump` writes the full name, and empty lists for what is not set."""
    own = yaml.safe_load((bag / 'binopos.yaml').read_text())['/**/triangulator']
    values = own['ros__parameters'] | {'qos_overrides': {}, 'use_sim_time': False}
    values['interface']['thicknesses'] = []
    config = tmp_path / 'dump.yaml'
    config.write_text(yaml.safe_dump({'/stereo/triangulator': {'ros__parameters': values}}))
    assert raw_error_mm(process(bag, '--config', config)) < 1.0


def test_odometry_says_no_more_than_the_pose_and_bears_the_targets_name(bag, process, tmp_path):
    done = process(bag, '--ros-args', '-p', 'smoother:child_frame:=buoy')
    assert done.returncode == 0, done.stderr
    with BagReader(tmp_path / 'out.mcap') as reader:
        poses = list(map(reader.decode, reader.messages(['/stereo/target/pose'])))
        motions = list(map(reader.decode, reader.messages(['/stereo/target/odometry'])))
    assert len(poses) == len(motions) == PAIRS
    for pose, motion in zip(poses, motions, strict=True):
        assert motion.child_frame_id == 'buoy'
        assert motion.pose.covariance.tolist() == pose.pose.covariance.tolist()
        # Of the angles nothing is known, so none of their variances is small.
        for covariance in (motion.pose.covariance, motion.twist.covariance):
            assert np.diag(covariance.reshape(6, 6))[3:].min() > 3
