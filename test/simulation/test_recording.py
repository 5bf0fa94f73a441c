"""Bags that the simulator writes: read back, repeated byte by byte, held against the scene."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from binopos_ros.bag import BagError, BagReader, messages
from binopos_ros.calibration.views.board import Board
from binopos_ros.cli.simulated_bag import START_NS, record
from binopos_ros.optics import read_camera_info, stereo_from_camera_infos
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.optics.rig_files import camera_infos_from_stereo
from binopos_ros.platform.quaternions import quaternion_of
from binopos_ros.simulation import PRESETS, Choices, Renderer, SimulationError
from binopos_ros.simulation.parameters import parameter_file
from binopos_ros.simulation.presets import in_air, with_board
from binopos_ros.simulation.sensor import Sensor

PAIRS = 4


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'demo'
    record(PRESETS['demo'].make(Choices(seed=5)), path, PAIRS, seed=5, threads=1)
    return path


def contents(bag: Path) -> list[tuple[str, int, bytes]]:
    with BagReader(bag) as reader:
        return [(r.topic, r.stamp_ns, bytes(r.data)) for r in reader.messages()]


def test_the_same_seed_gives_the_same_bytes_whatever_the_threads(
    bag: Path, tmp_path: Path
) -> None:
    again = tmp_path / 'demo'
    record(PRESETS['demo'].make(Choices(seed=5)), again, PAIRS, seed=5, threads=3)
    for file in sorted(path.name for path in bag.iterdir()):
        assert (again / file).read_bytes() == (bag / file).read_bytes(), file


def test_another_seed_gives_other_pictures_but_the_same_truth(bag: Path, tmp_path: Path) -> None:
    other = tmp_path / 'demo'
    record(PRESETS['demo'].make(Choices(seed=6)), other, PAIRS, seed=6)
    for mine, theirs in zip(contents(bag), contents(other), strict=True):
        assert mine[:2] == theirs[:2]
        assert (mine[2] == theirs[2]) == ('image' not in mine[0])


def test_wavy_pictures_do_not_depend_on_the_threads(tmp_path: Path) -> None:
    choices = Choices(seed=1, waves=0.0005, encoding='bgr8')
    for threads in (1, 3):
        record(PRESETS['demo'].make(choices), tmp_path / str(threads), 2, threads=threads)
    assert contents(tmp_path / '1') == contents(tmp_path / '3')


def test_every_pair_has_pictures_calibration_and_truth_on_one_stamp(bag: Path) -> None:
    with BagReader(bag) as reader:
        assert {name: info.count for name, info in reader.topics.items()} == {
            '/stereo/left/image_raw/compressed': PAIRS,
            '/stereo/right/image_raw/compressed': PAIRS,
            '/stereo/left/camera_info': PAIRS,
            '/stereo/right/camera_info': PAIRS,
            '/stereo/truth/pose': PAIRS,
        }
        stamps: dict[int, int] = {}
        for item in reader.messages():
            stamp = messages.stamp_of(reader.decode(item))
            assert stamp == item.stamp_ns
            stamps[stamp] = stamps.get(stamp, 0) + 1
    assert stamps == {START_NS + round(n * 1e9 / 30): 5 for n in range(PAIRS)}


def test_the_truth_is_the_path(bag: Path) -> None:
    scene = PRESETS['demo'].make(Choices(seed=5))
    with BagReader(bag) as reader:
        poses = [reader.decode(item) for item in reader.messages(['/stereo/truth/pose'])]
    found = np.array([messages.position_of(pose) for pose in poses])
    np.testing.assert_array_equal(found, scene.path.poses(scene.times(PAIRS))[0])
    assert not np.any([messages.covariance_of(pose) for pose in poses])


def test_the_truth_is_oriented_as_the_target_is(tmp_path: Path) -> None:
    """Its z axis is the disc's normal, or goes into the board; by scipy's quaternions."""
    disc = PRESETS['ports'].make(Choices())
    board = with_board(in_air(disc, 0), Board('chessboard', 5, 4, 0.02), 3, 1)
    for scene in (disc, board):
        times = scene.times(3)
        rotations = scene.target_rotations(times)
        normals = scene.path.poses(times)[1]
        sign = 1 if scene is disc else -1
        np.testing.assert_allclose(sign * rotations[:, :, 2], normals, atol=1e-12)
    rng = np.random.default_rng(0)
    turns = Rotation.random(200, random_state=rng).as_matrix()
    half = Rotation.from_rotvec(np.pi * np.array([[1, 0, 0], [0, 0.6, 0.8]])).as_matrix()
    for turn in (*turns, *half, np.eye(3)):
        found = Rotation.from_quat(quaternion_of(turn)).as_matrix()
        np.testing.assert_allclose(found, turn, atol=1e-9)


def test_the_pictures_show_the_disc_where_the_truth_is_seen(bag: Path) -> None:
    """Down the whole way: decoded from the bag, segmented plainly, against the apparent truth."""
    scene = PRESETS['demo'].make(Choices(seed=5))
    apparent = scene.measurements(scene.times(PAIRS))
    for side, name in enumerate(('left', 'right')):
        with BagReader(bag) as reader:
            topic = f'/stereo/{name}/image_raw/compressed'
            pictures = [
                cv2.imdecode(np.asarray(reader.decode(item).data), cv2.IMREAD_COLOR)
                for item in reader.messages([topic])
            ]
        for picture, expected in zip(pictures, apparent[side], strict=True):
            assert picture.shape == (480, 640, 3)
            red = (picture[..., 2] > 168) & (picture[..., 1] < 50)
            v, u = np.nonzero(red)
            np.testing.assert_allclose([u.mean(), v.mean()], expected, atol=0.3)


def test_camera_info_gives_the_rig_back(bag: Path) -> None:
    rig = PRESETS['ports'].make(Choices()).rig
    left, right, rotation, translation = stereo_from_camera_infos(
        *camera_infos_from_stereo(rig.left, rig.right, rig.rotation, rig.translation)
    )
    np.testing.assert_allclose(rotation, rig.rotation, atol=1e-12)
    np.testing.assert_allclose(translation, rig.translation, atol=1e-12)
    np.testing.assert_array_equal(left.matrix, rig.left.matrix)
    np.testing.assert_array_equal(right.distortion[:4], rig.right.distortion[:4])
    # And so do the files beside the messages.
    infos = [read_camera_info(bag / f'{side}.yaml') for side in ('left', 'right')]
    with BagReader(bag) as reader:
        for side, info in zip(('left', 'right'), infos, strict=True):
            item = next(iter(reader.messages([f'/stereo/{side}/camera_info'])))
            assert read_camera_info_message(reader.decode(item), side) == info


def test_the_parameter_file_holds_the_interface(bag: Path) -> None:
    parameters = yaml.safe_load((bag / 'binopos.yaml').read_text())
    interface = PRESETS['demo'].make(Choices()).rig.interface
    block = parameters['/**/triangulator']['ros__parameters']['interface']
    assert block == {
        'normal': list(interface.normal),
        'distance': 0.8,
        'indices': [1.0, 1.333],
    }
    target = parameters['/**/triangulator']['ros__parameters']['target']
    assert target['diameter'] == 0.06
    np.testing.assert_allclose(target['normal'], -interface.normal, atol=1e-15)
    parameters = yaml.safe_load(parameter_file(PRESETS['ports'].make(Choices())))
    block = parameters['/**/triangulator']['ros__parameters']
    assert set(block) == {'left_port', 'right_port', 'target'}
    assert block['right_port']['thicknesses'] == [0.01]
    parameters = yaml.safe_load(parameter_file(PRESETS['domes'].make(Choices())))
    block = parameters['/**/triangulator']['ros__parameters']['left_port']
    assert block == {
        'shape': 'dome',
        'centre': [0.0012, -0.0008, 0.0031],
        'radius': 0.05,
        'thicknesses': [0.005],
        'indices': [1.0, 1.49, 1.335],
    }


def test_a_single_file_has_its_companions_beside_it(tmp_path: Path) -> None:
    record(PRESETS['demo'].make(Choices()), tmp_path / 'one.mcap', 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'one.binopos.yaml',
        'one.left.yaml',
        'one.mcap',
        'one.right.yaml',
    ]
    with (tmp_path / 'one.mcap').open('rb') as file:
        assert len(list(make_reader(file).iter_messages())) == 5


@pytest.mark.parametrize('encoding', ['bgr8', 'rgb8', 'yuv422_yuy2', 'bayer_rggb8'])
def test_raw_pictures_decode_to_the_same_scene(encoding: str, tmp_path: Path) -> None:
    scene = PRESETS['demo'].make(Choices(encoding=encoding))
    plain = Renderer(scene, 0).picture(0.0, np.random.Generator(np.random.SFC64([7, 0, 0])))
    record(scene, tmp_path / 'raw', 1, seed=7)
    with BagReader(tmp_path / 'raw') as reader:
        message = reader.decode(next(iter(reader.messages(['/stereo/left/image_raw']))))
    assert (message.width, message.height, message.encoding) == (640, 480, encoding)
    data = np.asarray(message.data).reshape(480, message.step)
    decoded = {
        'bgr8': lambda: data.reshape(480, 640, 3),
        'rgb8': lambda: data.reshape(480, 640, 3)[..., ::-1],
        'yuv422_yuy2': lambda: cv2.cvtColor(data.reshape(480, 640, 2), cv2.COLOR_YUV2BGR_YUY2),
        # OpenCV names a mosaic by its second row and column: RGGB is its BG.
        'bayer_rggb8': lambda: cv2.cvtColor(data, cv2.COLOR_BayerBG2BGR),
    }[encoding]()
    difference = np.abs(decoded.astype(int) - plain.astype(int))
    # Chroma is shared by two pixels, a mosaic keeps one colour of three.
    assert difference.mean() <= (0 if encoding in ('bgr8', 'rgb8') else 2)


def test_noise_has_the_stated_deviation() -> None:
    sensor = Sensor(noise=3.0)
    for grey in (128.0, 20.0):
        light = np.full((200, 200, 3), grey, np.float32)
        rng = np.random.default_rng(1)
        picture = sensor.read_out(light, sensor.noise_level(light), rng)
        # Half read-out, half shot noise; rounding adds 1/12.
        expected = np.sqrt(4.5 + 4.5 * grey / 128 + 1 / 12)
        assert picture.std() == pytest.approx(expected, rel=0.02)
        assert picture.mean() == pytest.approx(grey, abs=0.05)


def test_an_existing_bag_is_not_overwritten(bag: Path) -> None:
    before = (bag / 'demo_0.mcap').read_bytes()
    with pytest.raises(BagError, match='exist'):
        record(PRESETS['demo'].make(Choices()), bag, 1)
    assert (bag / 'demo_0.mcap').read_bytes() == before


def test_no_pairs_make_no_bag(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match='1 or more'):
        record(PRESETS['demo'].make(Choices()), tmp_path / 'none', 0)
    assert not (tmp_path / 'none').exists()


def test_the_bag_in_the_repository_is_the_preset_s(project: Path) -> None:
    """Pictures may differ in a byte with other versions of OpenCV; what they mean may not."""
    scene = PRESETS['demo'].make(Choices())
    kept = project / 'bags' / 'demo'
    assert (kept / 'binopos.yaml').read_text() == parameter_file(scene)
    with BagReader(kept) as reader:
        poses = [reader.decode(item) for item in reader.messages(['/stereo/truth/pose'])]
        assert reader.topics['/stereo/left/image_raw/compressed'].count == 150
        infos = [
            read_camera_info_message(
                reader.decode(next(iter(reader.messages([f'/stereo/{side}/camera_info'])))), side
            )
            for side in ('left', 'right')
        ]
    found = np.array([messages.position_of(pose) for pose in poses])
    np.testing.assert_allclose(found, scene.path.poses(scene.times(150))[0], atol=1e-12)
    # Not P itself: OpenCV's choice of the rectified focal length differs by version.
    for mine, theirs in zip(
        stereo_from_camera_infos(*infos)[2:],
        (scene.rig.rotation, scene.rig.translation),
        strict=True,
    ):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)
