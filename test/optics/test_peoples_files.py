"""Calibration files as people have them: other programs' formats, other words, other habits."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.optics import (
    OpticsError,
    read_camera_info,
    stereo_from_camera_infos,
    write_camera_info,
)
from binopos_ros.optics.camera_info_files import read_pair
from binopos_ros.optics.camera_info_url import calibration_path

K = '[500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]'
FILE = f"""\
image_width: 640
image_height: 480
camera_name: left
camera_matrix: {{rows: 3, cols: 3, data: {K}}}
distortion_coefficients: {{rows: 1, cols: 5, data: [-0.1, 0.01, 0.001, -0.002, 0.003]}}
"""
RATIONAL = '[-0.1, 0.01, 0.001, -0.002, 0.003, 0.1, 0.2, 0.3]'


@pytest.fixture(scope='module')
def cases(project: Path) -> Path:
    folder = project.parent / 'shared' / 'cases'
    if not folder.is_dir():
        pytest.skip('../shared/cases is not there')
    return folder


def written(folder: Path, text: str, encoding: str = 'utf-8') -> Path:
    path = folder / 'camera.yaml'
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('image_width: 640', 'image_width: 640.0'),
        (f'data: {K}', 'data: [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]'),
        (f'{{rows: 3, cols: 3, data: {K}}}', '[[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]'),
        ('camera_name', 'distortion_model: radtan\ncamera_name'),
        ('camera_name', '# H\xf6he \xfcber Grund\ncamera_name'),
        ('image_width', '%YAML:1.0\n---\nimage_width'),
        ('{rows: 3, cols: 3', '!!opencv-matrix {rows: 3, cols: 3, dt: d'),
    ],
)
def test_what_people_write_means_the_same(tmp_path: Path, old: str, new: str) -> None:
    plain = read_camera_info(written(tmp_path, FILE))
    assert FILE.count(old) == 1
    assert read_camera_info(written(tmp_path, FILE.replace(old, new), 'latin-1')) == plain
    assert plain.distortion_model == 'plumb_bob'


def test_a_lens_without_a_name_is_not_taken_for_another(tmp_path: Path, cases: Path) -> None:
    rational = re.sub(r'data: \[-0.1.*\]', f'data: {RATIONAL}', FILE)
    assert read_camera_info(written(tmp_path, rational)).distortion_model == 'rational_polynomial'
    fisheye = read_camera_info(cases / 'fisheye_without_distortion_model.yaml')
    assert fisheye.distortion_model == 'equidistant'
    try:
        camera = fisheye.camera()
    except OpticsError as error:
        assert 'equidistant' in str(error)  # noqa: PT017
        return
    # Where the model is known, r = f (t + k1 t^3 + ...) of the angle t (Kannala and Brandt, 2006).
    angle = 0.6
    k1, k2, k3, k4 = fisheye.d
    turned = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
    seen = camera.project([np.sin(angle), 0.0, np.cos(angle)])
    np.testing.assert_allclose(seen, [fisheye.k[0] * turned + fisheye.k[2], fisheye.k[5]])


def test_a_printed_message_reads_like_the_file(tmp_path: Path) -> None:
    """As `ros2 topic echo` prints it, lists item by item, one message after the other."""

    def items(numbers: str) -> str:
        return ''.join(f'\n- {number}' for number in numbers.strip('[]').split(', '))

    message = f"""\
header:
  stamp:
    sec: 1
    nanosec: 2
  frame_id: left
height: 480
width: 640
distortion_model: plumb_bob
d:{items('[-0.1, 0.01, 0.001, -0.002, 0.003]')}
k:{items(K)}
r:{items('[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]')}
p:{items(str([0.0] * 12))}
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""
    plain = read_camera_info(written(tmp_path, FILE))
    assert read_camera_info(written(tmp_path, 2 * message)) == plain


def test_the_pair_of_a_kalibr_chain_is_that_of_its_transform(cases: Path) -> None:
    left, right, rotation, translation = stereo_from_camera_infos(
        *read_pair([cases / 'kalibr_camchain.yaml'])
    )
    np.testing.assert_allclose(translation, [-0.0601, 0.0002, 0.0004], atol=1e-12)
    np.testing.assert_allclose(rotation[0], [0.999982, 0.002114, 0.005603], atol=1e-6)
    assert left.matrix[0, 0] == 771.2
    np.testing.assert_allclose(right.distortion, [-0.268, 0.108, -0.0002, 0.0003, 0.0])
    assert read_camera_info(cases / 'kalibr_camchain.yaml', 'right').k[0] == 769.8


def test_the_sides_of_one_file_are_known_by_their_names(cases: Path) -> None:
    for side, focal in (('left', 702.3), ('right', 703.1)):
        info = read_camera_info(cases / 'stereo_ost.txt', side)
        assert (info.k[0], info.width, info.height) == (focal, 1280, 480)
    with pytest.raises(OpticsError, match='narrow_stereo/left, narrow_stereo/right; name one'):
        read_camera_info(cases / 'stereo_ost.txt')


def test_filestorage_of_one_camera_reads(cases: Path) -> None:
    info = read_camera_info(cases / 'opencv_filestorage.yml')
    assert (info.width, info.height, info.name) == (752, 480, 'right')
    assert info.k[0] == 719.87
    assert info.p[3] == -43.84


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('cam0: {camera_model: omni, intrinsics: [1]}', 'kalibr, model omni-None.*pinhole-radtan'),
        ('%YAML:1.0\n---\nM1: {data: [1]}\nD1: {data: [0]}', 'without the size of the pictures'),
        ('<html></html>', 'XML of <html>'),
        ('<!ENTITY a "b"><opencv_storage/>', 'defines entities'),
        (FILE.replace('640', '640.5'), 'image_width must be a whole number'),
    ],
)
def test_what_is_not_read_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(OpticsError, match=says) as caught:
        read_camera_info(written(tmp_path, text))
    assert '\n' not in str(caught.value)


def test_urls_mean_what_they_mean_to_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_HOME', '/home/me/ros')
    wanted = Path('/home/me/ros/camera_info/left.yaml')
    assert calibration_path('file://${ROS_HOME}/camera_info/${NAME}.yaml', 'left') == wanted
    assert calibration_path('file:/a/b.yaml') == Path('/a/b.yaml')
    assert calibration_path('file:///a/b%20c.yaml') == Path('/a/b c.yaml')
    with pytest.raises(OpticsError, match='only'):
        calibration_path('file://${HOME}/a.yaml')


@pytest.mark.parametrize('unit', [1.0, 1000.0])
def test_converted_there_and_back_a_rig_stays_itself(
    tmp_path: Path, cases: Path, unit: float
) -> None:
    """ROS to OpenCV (YAML and XML) and kalibr and back: rays and mutual pose to rounding."""
    from verbs import binopos_here

    def convert(*words: object) -> None:
        done = binopos_here('calibrate', 'convert', *words)
        assert done.returncode == 0, done.stderr

    chain = cases / 'kalibr_camchain.yaml'
    convert(chain, '-o', tmp_path / 'ros')
    steps = [tmp_path / 'ros']
    for name, to in (('a.yml', 'opencv'), ('b.xml', 'opencv'), ('c.yaml', 'kalibr')):
        convert(steps[-1], '-o', tmp_path / name, '--to', to)
        steps.append(tmp_path / name)
    convert(steps[-1], '-o', tmp_path / 'again')
    first = stereo_from_camera_infos(*read_pair([chain]))
    last = stereo_from_camera_infos(
        *read_pair([tmp_path / 'again' / f'{side}.yaml' for side in ('left', 'right')])
    )
    pixels = np.array([[10.0, 20.0], [700.0, 500.0]])
    for before, after in zip(first[:2], last[:2], strict=True):
        np.testing.assert_allclose(after.unproject(pixels), before.unproject(pixels), atol=1e-12)
    np.testing.assert_allclose(last[2], first[2], atol=1e-9)
    np.testing.assert_allclose(last[3], first[3], atol=1e-9)
    # A baseline in another unit is refused, and read where the unit is told.
    if unit != 1.0:
        scaled = (tmp_path / 'c.yaml').read_text().replace('-0.0601', '-60.1')
        (tmp_path / 'mm.yaml').write_text(scaled)
        done = binopos_here('calibrate', 'convert', tmp_path / 'mm.yaml', '-o', tmp_path / 'no')
        assert done.returncode == 2
        assert '60.1 m, which no rig has' in done.stderr
        convert(tmp_path / 'mm.yaml', '-o', tmp_path / 'mm', '--unit', 'mm')
        assert read_camera_info(tmp_path / 'mm' / 'right.yaml').p[3] < 0.0


def test_intrinsics_and_extrinsics_of_opencv_make_a_pair(tmp_path: Path) -> None:
    """As its sample writes them: two files, and no size."""
    matrix = f'!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {K}'
    lens = '!!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [0., 0., 0., 0., 0.]'
    intrinsics, extrinsics = tmp_path / 'intrinsics.yml', tmp_path / 'extrinsics.yml'
    intrinsics.write_text(f'%YAML:1.0\n---\nM1: {matrix}\nD1: {lens}\nM2: {matrix}\nD2: {lens}\n')
    extrinsics.write_text(
        '%YAML:1.0\n---\nR: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n'
        '   data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\n'
        'T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [-0.1, 0., 0.]\n'
    )
    left, right = read_pair([intrinsics, extrinsics], (640, 480))
    assert left.camera().size == (640, 480)
    np.testing.assert_allclose(right.p[3] / right.p[0], -0.1)
    with pytest.raises(OpticsError, match='--size'):
        read_pair([intrinsics, extrinsics])
    write_camera_info(tmp_path / 'left.yaml', left)
    with pytest.raises(OpticsError, match='hold 1 cameras'):
        read_pair([tmp_path / 'left.yaml'])
