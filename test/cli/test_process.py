"""`binopos process` on the paper's washbowl, against the simulator's truth."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of, stamp_of
from binopos_ros.optics import FlatInterface, StereoRig, stereo_from_camera_infos
from binopos_ros.optics.camera_info_message import read_camera_info_message
from verbs import binopos, simulated

pytestmark = pytest.mark.xdist_group('washbowl')

PAIRS = 300


def process(bag: Path, folder: Path, *words: object) -> Path:
    """The table that `process` writes for a bag."""
    folder.mkdir(exist_ok=True)
    table = folder / 'out.csv'
    done = binopos('process', bag, '-o', folder / 'out.mcap', '--csv', table, *words)
    assert done.returncode == 0, done.stderr
    return table


def rows_of(table: Path) -> list[dict[str, str]]:
    with table.open(newline='') as stream:
        return list(csv.DictReader(stream))


def columns(table: Path, *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in rows_of(table)])


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


@pytest.fixture(scope='module')
def washbowl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated(tmp_path_factory.mktemp('washbowl') / 'bag', 'washbowl', PAIRS)


@pytest.fixture(scope='module')
def truth(washbowl: Path) -> np.ndarray:
    with BagReader(washbowl) as reader:
        messages = map(reader.decode, reader.messages(['/stereo/truth/pose']))
        return np.array([position_of(message) for message in messages])


@pytest.fixture(scope='module')
def table(washbowl: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return process(washbowl, tmp_path_factory.mktemp('refractive'))


def cramer_rao_rms(bag: Path, truth: np.ndarray, sigma: float) -> float:
    """RMS that no unbiased method can beat, for centroids of that standard deviation (px)."""
    infos = {}
    with BagReader(bag) as reader:
        for side in ('left', 'right'):
            record = next(iter(reader.messages([f'/stereo/{side}/camera_info'])))
            infos[side] = read_camera_info_message(reader.decode(record), side)
    normal = np.array([0.03, 0.06, 1.0])
    rig = StereoRig(
        *stereo_from_camera_infos(infos['left'], infos['right']),
        FlatInterface(normal, 0.8, (1.0, 1.333)),
    )
    # By finite differences of the projection, which the covariance of `triangulate` does not use.
    step = 1e-6
    columns = []
    for axis in np.eye(3) * step:
        ahead, behind = (np.hstack(rig.project(truth + sign * axis)) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    jacobian = np.stack(columns, axis=-1)
    information = np.swapaxes(jacobian, 1, 2) @ jacobian / sigma**2
    return float(np.sqrt(np.trace(np.linalg.inv(information), axis1=1, axis2=2).mean()))


def test_every_pair_is_located_within_one_and_a_half_times_the_cramer_rao_bound(
    washbowl, truth, table
):
    found = columns(table, 'raw_x', 'raw_y', 'raw_z')
    assert len(found) == len(truth) == PAIRS
    bound = cramer_rao_rms(washbowl, truth, 0.05)
    print(f'RMS {1e3 * rms(found - truth):.3f} mm, bound at 0.05 px {1e3 * bound:.3f} mm')
    assert rms(found - truth) <= 1.5 * bound


def test_straight_rays_are_at_least_twenty_times_worse(washbowl, truth, table, tmp_path):
    straight = process(
        washbowl, tmp_path / 'straight', '--ros-args', '-p', 'triangulator:method:=straight'
    )
    found = columns(straight, 'raw_x', 'raw_y', 'raw_z')
    refracted = columns(table, 'raw_x', 'raw_y', 'raw_z')
    assert rms(found - truth) >= 20 * rms(refracted - truth)


def test_the_discs_diameter_makes_it_better(washbowl, truth, table, tmp_path):
    """The outline's centre is not the image of the disc's centre; the bag names the diameter."""
    without = process(
        washbowl, tmp_path / 'outline', '--ros-args', '-p', 'triangulator:target.diameter:=0.0'
    )
    outlines = columns(without, 'raw_x', 'raw_y', 'raw_z')
    centres = columns(table, 'raw_x', 'raw_y', 'raw_z')
    assert rms(centres - truth) < 0.8 * rms(outlines - truth)


def test_the_filtered_position_is_no_worse_than_the_raw_one(truth, table):
    raw = columns(table, 'raw_x', 'raw_y', 'raw_z')
    filtered = columns(table, 'x', 'y', 'z')
    assert rms(filtered - truth) <= rms(raw - truth)


def test_processing_twice_gives_the_same_bytes(washbowl, table, tmp_path):
    again = process(washbowl, tmp_path / 'again')
    assert again.read_bytes() == table.read_bytes()
    first, second = (each.with_name('out.mcap').read_bytes() for each in (table, again))
    assert first == second


def test_the_table_has_the_columns_of_the_contract_and_numbers_only(table):
    rows = rows_of(table)
    contract = 'stamp,x,y,z,sx,sy,sz,raw_x,raw_y,raw_z,index,index_std'
    assert ','.join(rows[0]) == f'{contract},vx,vy,vz,cxy,cxz,cyz'
    assert all(np.isfinite([float(value) for value in row.values()]).all() for row in rows)


def test_the_output_bag_holds_the_topics_of_the_live_nodes(table):
    with BagReader(table.with_name('out.mcap')) as reader:
        counts = {topic: info.count for topic, info in reader.topics.items()}
        stamps = [stamp_of(reader.decode(r)) for r in reader.messages(['/stereo/target/pose'])]
    # What is thought of the target is told on change and twice per second.
    assert counts.pop('/stereo/target/health') >= 2
    names = (
        *('position', 'systematic', 'medium', 'refractive_index'),
        *('pose', 'odometry', 'pose_stamped'),
    )
    expected = {f'/stereo/target/{name}': PAIRS for name in names}
    expected |= {f'/stereo/{side}/centroid': PAIRS for side in ('left', 'right')}
    assert counts == expected
    assert stamps == sorted(set(stamps))
