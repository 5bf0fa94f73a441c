"""Pictures from folders, lists and bags; the calibration's files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.bag import BagWriter, messages
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.report.files import camera_infos, read_stereo, write_stereo
from binopos_ros.cli.calibration_bags import open_pictures
from binopos_ros.optics import OpticsError, read_camera_info, stereo_from_camera_infos
from binopos_ros.optics.covariance_file import read_covariance
from binopos_ros.optics.rig_state import Camera, RigState, exponential

SECOND = 10**9


def picture(value: int) -> np.ndarray:
    return np.full((24, 32), value, np.uint8)


def save(path: Path, value: int) -> None:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), picture(value))


def values(source: Path) -> list[tuple[int, int]]:
    return [(int(p.left()[0, 0]), int(p.right()[0, 0])) for p in open_pictures(source).pairs]


def test_folder_of_named_files(tmp_path: Path) -> None:
    for i in (1, 2, 10):
        save(tmp_path / f'left{i}.png', i)
        save(tmp_path / f'right{i}.png', 100 + i)
    save(tmp_path / 'left3.png', 3)
    assert values(tmp_path) == [(1, 101), (2, 102), (10, 110)]
    (left_over,) = open_pictures(tmp_path).unmatched
    assert 'left3.png' in str(left_over)
    assert 'no right partner' in str(left_over)


def test_sub_folders(tmp_path: Path) -> None:
    for i in range(3):
        save(tmp_path / 'left' / f'{i:03d}.png', i)
        save(tmp_path / 'right' / f'{i:03d}.png', 100 + i)
    assert values(tmp_path) == [(0, 100), (1, 101), (2, 102)]


def test_sub_folders_with_foreign_names_pair_in_order(tmp_path: Path) -> None:
    for i in range(3):
        save(tmp_path / 'left' / f'a{i}.png', i)
        save(tmp_path / 'right' / f'b{i}.png', 100 + i)
    assert values(tmp_path) == [(0, 100), (1, 101), (2, 102)]


def test_list_of_pairs(tmp_path: Path) -> None:
    save(tmp_path / 'x.png', 1)
    save(tmp_path / 'y.png', 2)
    (tmp_path / 'list.txt').write_text('# pairs\nx.png y.png\n\ny.png, x.png\n')
    assert values(tmp_path / 'list.txt') == [(1, 2), (2, 1)]


def test_list_of_opencv(samples: Path) -> None:
    pairs = open_pictures(samples / 'stereo_calib.xml').pairs
    assert len(pairs) == 13
    assert pairs[0].name == 'left01.jpg|right01.jpg'
    assert pairs[0].left().shape == (480, 640)


def write_bag(path: Path, stamps: list[tuple[int, int]], raw: bool = False) -> None:
    topic = 'image_raw' if raw else 'image_raw/compressed'
    with BagWriter(path) as writer:
        kind = messages.IMAGE if raw else messages.COMPRESSED_IMAGE
        for side in ('left', 'right'):
            writer.add_topic(f'/stereo/{side}/{topic}', kind)
        for i, pair in enumerate(stamps):
            for side, stamp in zip(('left', 'right'), pair, strict=True):
                image = picture(10 * i + 40)
                if raw:
                    message: Any = messages.image(
                        stamp, side, image.ravel(), (32, 24), 'mono8', 32
                    )
                else:
                    jpeg = cv2.imencode('.png', image)[1].tobytes()
                    message = messages.compressed_image(stamp, side, jpeg, 'png')
                writer.write(f'/stereo/{side}/{topic}', stamp, message)


@pytest.mark.parametrize('raw', [False, True])
def test_bag(tmp_path: Path, raw: bool) -> None:
    write_bag(tmp_path / 'bag', [(i * SECOND, i * SECOND + 1000) for i in range(1, 6)], raw)
    assert values(tmp_path / 'bag') == [(v, v) for v in (40, 50, 60, 70, 80)]
    assert len(open_pictures(tmp_path / 'bag', interval=1.9).pairs) == 3


def test_unsynchronised_bag_is_refused(tmp_path: Path) -> None:
    stamps = [(i * SECOND, i * SECOND + 10 * SECOND) for i in range(1, 8)]
    write_bag(tmp_path / 'bag', stamps)
    with pytest.raises(CalibrationError, match='synchronise the cameras'):
        open_pictures(tmp_path / 'bag')


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('one.png\n', 'line 1: write the left and the right'),
        ('a b\nc\n', 'line 2'),
        ('', 'lists 0 pictures'),
        ('<imagelist> "a" "b" "c"', 'lists 3 pictures'),
    ],
)
def test_unreadable_lists_are_refused(tmp_path: Path, text: str, line: str) -> None:
    path = tmp_path / 'list.txt'
    path.write_text(text)
    with pytest.raises(CalibrationError, match=line):
        open_pictures(path)


def test_missing_pictures_are_named(tmp_path: Path) -> None:
    (tmp_path / 'list.txt').write_text('gone1.png gone2.png\n')
    with pytest.raises(CalibrationError, match=r'gone1\.png is missing'):
        open_pictures(tmp_path / 'list.txt').pairs[0].left()
    save(tmp_path / 'left1.png', 1)
    with pytest.raises(CalibrationError, match='no right pictures'):
        open_pictures(tmp_path)


def rig(turn: np.ndarray, shift: np.ndarray, lens: np.ndarray) -> RigState:
    cameras = tuple(
        Camera(np.array([f, f + 1.5]), np.array([630.2, 481.7]), lens, (1280, 960))
        for f in (900.0, 905.0)
    )
    return RigState(cameras, exponential(turn), np.array([-0.2, 0.0, 0.0]) + shift)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), terms=st.sampled_from([5, 8]))
def test_a_written_rig_reads_back(
    tmp_path_factory: pytest.TempPathFactory, seed: int, terms: int
) -> None:
    rng = np.random.default_rng(seed)
    state = rig(0.1 * rng.normal(size=3), 0.02 * rng.normal(size=3), 0.1 * rng.normal(size=terms))
    folder = tmp_path_factory.mktemp('cal')
    write_stereo(folder, state, np.eye(len(state.names)))
    found, covariance = read_stereo(folder)
    np.testing.assert_allclose(found.minus(state), 0.0, atol=1e-9)
    assert covariance is not None
    assert covariance.names == state.names


def test_a_lens_that_folds_in_the_picture_is_rectified_as_well(tmp_path: Path) -> None:
    """cv2.stereoRectify finds a negative focal length for it when it looks for a full picture."""
    lens = np.array([-0.06, 0.02, -0.19, -0.19, -0.12, 0.13, 0.01, -0.06])
    state = rig(np.array([0.1, -0.05, 0.1]), np.zeros(3), lens)
    write_stereo(tmp_path, state, np.eye(len(state.names)))
    np.testing.assert_allclose(read_stereo(tmp_path)[0].minus(state), 0.0, atol=1e-9)


def test_files_are_those_of_ros(tmp_path: Path) -> None:
    state = rig(np.array([0.01, -0.02, 0.03]), np.zeros(3), np.full(5, 0.01))
    left, right, covariance = write_stereo(tmp_path, state, np.eye(len(state.names)))
    data = yaml.safe_load(left.read_text())
    assert list(data) == [
        'image_width',
        'image_height',
        'camera_name',
        'camera_matrix',
        'distortion_model',
        'distortion_coefficients',
        'rectification_matrix',
        'projection_matrix',
    ]
    assert data['distortion_model'] == 'plumb_bob'
    assert read_camera_info(right).p[3] < 0
    assert read_covariance(covariance).names == state.names


def test_rectified_rows_are_epipolar_lines() -> None:
    state = rig(np.array([0.01, -0.12, 0.03]), np.array([0.0, 0.01, 0.02]), np.zeros(5))
    infos = camera_infos(state)
    points = np.random.default_rng(1).uniform([-0.3, -0.3, 0.8], [0.3, 0.3, 1.5], (20, 3))
    rows = []
    for info, local in zip(
        infos, (points, points @ state.rotation.T + state.translation), strict=True
    ):
        turned = local @ np.reshape(info.r, (3, 3)).T
        seen = np.reshape(info.p, (3, 4)) @ np.vstack(
            [(points @ np.reshape(infos[0].r, (3, 3)).T).T, np.ones(20)]
        )
        rows.append(seen[1] / seen[2])
        direct = turned[:, 1] / turned[:, 2] * info.p[5] + info.p[6]
        np.testing.assert_allclose(direct, seen[1] / seen[2], atol=1e-9)
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-9)
    _, _, rotation, translation = stereo_from_camera_infos(*infos)
    np.testing.assert_allclose(rotation, state.rotation, atol=1e-12)
    np.testing.assert_allclose(translation, state.translation, atol=1e-12)


def test_pictures_of_two_sizes_make_no_rig() -> None:
    state = rig(np.zeros(3), np.zeros(3), np.zeros(5))
    left, right = state.cameras
    small = Camera(right.focal, right.centre, right.lens, (640, 480))
    with pytest.raises(OpticsError, match='one resolution'):
        camera_infos(RigState((left, small), state.rotation, state.translation))
