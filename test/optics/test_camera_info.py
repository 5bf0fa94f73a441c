"""Calibration files: real ones of real rigs, and what may be wrong with one."""

from __future__ import annotations

import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from binopos_ros.optics import (
    CameraInfo,
    CameraInfoWarning,
    OpticsError,
    Roi,
    read_camera_info,
    stereo_from_camera_infos,
    write_camera_info,
)

SOUND = [
    'ps4eye/left.yaml',
    'ps4eye/right.yaml',
    'side_x_side_stereo/left.yaml',
    'side_x_side_stereo/right.yaml',
    'image_common/test_calibration.yaml',
]
CONTRADICTORY = [
    'side_x_side_stereo/left_height120_commit418dd08.yaml',
    'side_x_side_stereo/right_height120_commit418dd08.yaml',
    'duke_robosub/DEV_000F315C1ED8_left.yaml',
    'duke_robosub/DEV_000F315C1ED5_right.yaml',
]
INFO = CameraInfo(
    name='left',
    width=640,
    height=480,
    distortion_model='plumb_bob',
    d=(-0.1, 0.01, 0.0, 0.0, 0.0),
    k=(500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0),
    p=(500.0, 0.0, 320.0, 0.0, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0),
)


@pytest.fixture
def folder(shared_data: Path) -> Path:
    return shared_data / 'ros-camera-info'


@pytest.mark.parametrize('name', SOUND)
def test_sound_files_read_without_a_warning(folder: Path, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        info = read_camera_info(folder / name)
    raw = yaml.safe_load((folder / name).read_text())
    assert (info.width, info.height) == (raw['image_width'], raw['image_height'])
    assert list(info.k) == raw['camera_matrix']['data']
    assert list(info.d) == raw['distortion_coefficients']['data']
    assert list(info.p) == raw['projection_matrix']['data']
    assert info.camera().size == (info.width, info.height)


@pytest.mark.parametrize('name', CONTRADICTORY)
def test_files_that_contradict_themselves_read_with_a_warning(folder: Path, name: str) -> None:
    with pytest.warns(CameraInfoWarning, match='principal point') as caught:
        info = read_camera_info(folder / name)
    assert info.camera().size == (info.width, info.height)
    assert all('\n' not in str(warning.message) for warning in caught)


def test_an_uncalibrated_file_is_refused(folder: Path) -> None:
    with pytest.raises(OpticsError, match=r'default\.yaml.*uncalibrated \(K is all zero\)'):
        read_camera_info(folder / 'ps4eye/default.yaml')


def test_no_file_of_the_folder_is_left_out(folder: Path) -> None:
    files = {str(path.relative_to(folder)) for path in folder.glob('*/*.yaml')}
    assert files == {*SOUND, *CONTRADICTORY, 'ps4eye/default.yaml'}


@pytest.mark.parametrize(
    ('left', 'right', 'baseline'),
    [
        ('ps4eye/left.yaml', 'ps4eye/right.yaml', 0.07857),
        ('side_x_side_stereo/left.yaml', 'side_x_side_stereo/right.yaml', 0.06083),
        (*CONTRADICTORY[2:], 0.05234),
    ],
)
@pytest.mark.filterwarnings('ignore::binopos_ros.optics.CameraInfoWarning')
def test_the_rig_out_of_r_and_p_rectifies_as_the_files_say(
    folder: Path, left: str, right: str, baseline: float
) -> None:
    """OpenCV's stereoRectify, given the recovered extrinsics, must come to the files' R."""
    infos = read_camera_info(folder / left), read_camera_info(folder / right)
    first, second, rotation, translation = stereo_from_camera_infos(*infos)
    assert np.linalg.norm(translation) == pytest.approx(baseline, abs=6e-6)
    r_left, r_right, _, _, *_ = cv2.stereoRectify(
        first.matrix,
        first.distortion,
        second.matrix,
        second.distortion,
        first.size,
        rotation,
        translation[:, None],
        flags=cv2.CALIB_ZERO_DISPARITY,
    )
    np.testing.assert_allclose(np.ravel(r_left), infos[0].r, atol=2e-4)
    np.testing.assert_allclose(np.ravel(r_right), infos[1].r, atol=2e-4)


def test_ost_text_reads_like_the_yaml_of_its_calibration(folder: Path) -> None:
    """The oST file holds the same numbers as two of the YAML files, and the true height."""
    for side in ('left', 'right'):
        old = read_camera_info(
            folder / 'side_x_side_stereo/ost.txt', camera=f'narrow_stereo/{side}'
        )
        with pytest.warns(CameraInfoWarning):
            new = read_camera_info(
                folder / f'side_x_side_stereo/{side}_height120_commit418dd08.yaml'
            )
        assert (old.k, old.d, old.r, old.p) == (new.k, new.d, new.r, new.p)
        assert (old.width, old.height) == (320, 240)


def test_an_ost_file_of_two_cameras_asks_which(folder: Path) -> None:
    with pytest.raises(OpticsError, match='narrow_stereo/left, narrow_stereo/right'):
        read_camera_info(folder / 'side_x_side_stereo/ost.txt')


@settings(deadline=None)
@given(
    numbers=st.lists(
        st.floats(allow_nan=False, allow_infinity=False, width=64), min_size=26, max_size=26
    ),
    name=st.text(st.characters(codec='utf-8', exclude_categories=('Cc', 'Cs')), max_size=20),
    roi=st.tuples(*[st.integers(0, 4000)] * 4, st.booleans()),
)
@example([1e22] * 26, '\u2028: #' * 30, (0, 0, 0, 0, False))
def test_what_is_written_reads_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], name: str, roi: tuple
) -> None:
    path = tmp_path_factory.mktemp('info') / 'camera.yaml'
    k = (500.0, *numbers[:8])
    d, p = tuple(numbers[8:13]), tuple(numbers[13:25])
    info = CameraInfo(name, 640, 480, 'plumb_bob', d, k, INFO.r, p, (2, 2), Roi(*roi))
    write_camera_info(path, info)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', CameraInfoWarning)
        assert read_camera_info(path) == info


def test_keys_stand_in_the_order_of_camera_calibration_parsers(tmp_path: Path) -> None:
    write_camera_info(tmp_path / 'left.yaml', INFO)
    assert list(yaml.safe_load((tmp_path / 'left.yaml').read_text())) == [
        'image_width',
        'image_height',
        'camera_name',
        'camera_matrix',
        'distortion_model',
        'distortion_coefficients',
        'rectification_matrix',
        'projection_matrix',
    ]


def test_region_of_interest_and_binning_move_the_principal_point() -> None:
    """A point's pixel in the cut and binned image is its full pixel, cut and binned."""
    small = CameraInfo(**{**vars(INFO), 'binning': (2, 4), 'roi': Roi(100, 40, 400, 480)}).camera()
    assert small.size == (240, 100)
    full = INFO.camera().project([0.05, -0.02, 1.0])
    np.testing.assert_allclose(
        small.project([0.05, -0.02, 1.0]),
        [(full[0] - 100 - 0.5) / 2, (full[1] - 40 - 1.5) / 4],
        atol=1e-10,
    )


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('', 'no camera_info file'),
        ('a: [1', 'line 1 is not valid YAML'),
        ('image_width: 640', 'image_height must be a whole number'),
        ('image_width: -1\nimage_height: 480', 'image_width must be a whole number'),
        (
            'image_width: 1\nimage_height: 1\ncamera_matrix: {data: [1, 2]}\n'
            'distortion_coefficients: {data: []}',
            'camera_matrix must hold 9 numbers, not 2',
        ),
        (
            'image_width: 1\nimage_height: 1\ndistortion_coefficients: {data: []}\n'
            'camera_matrix: {data: [x, 0, 0, 0, 1, 0, 0, 0, 1]}',
            'camera_matrix holds something that is not a finite number',
        ),
        (
            'image_width: 1\nimage_height: 1\ndistortion_coefficients: {data: []}',
            'camera_matrix is missing',
        ),
        ('image_width: 1\nimage_height: 1\nroi: 3', 'roi must be a block'),
        ('# oST version 5.0 parameters\n[image]\nwidth\n3', 'holds no camera'),
        ('[a]\ncamera matrix\n1 2 3', r'\[a\] needs 9 numbers under .camera matrix., not 3'),
    ],
)
def test_broken_files_are_named_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / 'broken.yaml'
    path.write_text(text)
    with pytest.raises(OpticsError, match=says) as caught:
        read_camera_info(path)
    assert 'broken.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_absent_and_binary_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(OpticsError, match='cannot read the calibration'):
        read_camera_info(tmp_path / 'absent.yaml')
    (tmp_path / 'image.yaml').write_bytes(b'\xff\xd8\xff\xe0')
    with pytest.raises(OpticsError, match='it is not text'):
        read_camera_info(tmp_path / 'image.yaml')
    with pytest.raises(OpticsError, match='cannot write'):
        write_camera_info(tmp_path / 'absent' / 'left.yaml', INFO)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'p': (0.0,) * 12}, 'P has no focal length'),
        ({}, 'have no baseline'),
        ({'r': (2.0, *INFO.r[1:]), 'p': (500, 0, 320, -50, *INFO.p[4:])}, 'not a rotation'),
        ({'k': (0.0,) * 9, 'p': (500, 0, 320, -50, *INFO.p[4:])}, 'uncalibrated'),
        (
            {'distortion_model': 'mercator', 'p': (500, 0, 320, -50, *INFO.p[4:])},
            'mercator.*not supported',
        ),
        (
            {'distortion_model': 'equidistant', 'p': (500, 0, 320, -50, *INFO.p[4:])},
            'equidistant lens has 4 terms.*not 5',
        ),
    ],
)
def test_pairs_that_make_no_rig_are_refused(change: dict, says: str) -> None:
    right = CameraInfo(**{**vars(INFO), 'name': 'right', **change})
    with pytest.raises(OpticsError, match=says) as caught:
        stereo_from_camera_infos(INFO, right)
    assert 'right' in str(caught.value)
