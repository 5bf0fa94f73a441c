"""`binopos calibrate` as typed: from rendered pictures to positions, and what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from binopos_ros.bag import BagReader, BagWriter, messages
from binopos_ros.cli import main
from binopos_ros.optics import read_camera_info, stereo_from_camera_infos

pytestmark = pytest.mark.xdist_group('calibration world')


def words(text: str, **paths: object) -> list[str]:
    return text.format(**paths).split()


@pytest.fixture(scope='module')
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bags of boards in air and in water, and of the washbowl, all of the same rig."""
    folder = tmp_path_factory.mktemp('world')
    for line in (
        'simulate -o {at}/dry --preset demo --board 9x6 --square 0.025 --air --pairs 14 --rate 2',
        'simulate -o {at}/wet --preset demo --board 9x6 --square 0.025 --pairs 9 --rate 2',
        'simulate -o {at}/bowl --preset demo --pairs 30 --seed 5',
    ):
        assert main(words(line, at=folder)) == 0
    return folder


@pytest.fixture(scope='module')
def calibrated(world: Path) -> Path:
    """The folder of `calibrate interface` after `calibrate stereo`."""
    line = 'calibrate stereo {at}/dry --square 0.025 -o {at}/cal'
    assert main(words(line, at=world)) == 0
    line = 'calibrate interface {at}/wet --square 0.025 --calibration {at}/cal'
    assert main(words(line, at=world)) == 0
    return world / 'cal' / 'interface'


def replace_camera_info(source: Path, folder: Path, target: Path) -> None:
    """Copy a bag with the calibration of a folder in place of its own."""
    infos = {side: read_camera_info(folder / f'{side}.yaml') for side in ('left', 'right')}
    with BagReader(source) as reader, BagWriter(target) as writer:
        for topic, info in reader.topics.items():
            writer.add_topic(topic, info.type)
        for record in reader.messages():
            data: object = record.data
            if record.topic.endswith('camera_info'):
                old = reader.decode(record)
                side = record.topic.split('/')[-2]
                stamp = messages.stamp_of(old)
                data = messages.camera_info(stamp, old.header.frame_id, infos[side])
            writer.write(record.topic, record.stamp_ns, data)


def position_rms(text: str) -> float:
    found = re.search(r'target/position against truth, RMS +([\d.]+) mm', text)
    assert found is not None
    return float(found[1])


def stated_rms(positions: Path) -> float:
    """What a bag's positions say of their own errors (mm)."""
    with BagReader(positions) as reader:
        found = [
            messages.covariance_of(reader.decode(record))[:3, :3]
            for record in reader.messages(topics=['/stereo/target/position'])
        ]
    return 1000.0 * float(np.sqrt(np.mean([np.trace(one) for one in found])))


def test_from_pictures_to_positions(
    world: Path, calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wrong by what the true calibration gives and by what the own one says of itself."""
    replace_camera_info(world / 'bowl', calibrated, world / 'bowl2')
    assert main(words('process {at}/bowl -o {at}/true.mcap', at=world)) == 0
    with_truth = position_rms(capsys.readouterr().out)
    line = (
        'process {at}/bowl2 -o {at}/own.mcap --config {at}/bowl/binopos.yaml --ros-args '
        '--params-file {cal}/interface.yaml '
        '-p triangulator:calibration_covariance:={cal}/covariance.yaml'
    )
    assert main(words(line, at=world, cal=calibrated)) == 0
    error = position_rms(capsys.readouterr().out)
    stated, exact = stated_rms(world / 'own.mcap'), stated_rms(world / 'true.mcap')
    assert stated > exact
    assert error < 1.5 * np.hypot(with_truth, stated)
    assert error < 3.0


def test_rendered_rig_is_recovered(world: Path, calibrated: Path) -> None:
    found, truth = (
        stereo_from_camera_infos(
            *(read_camera_info(folder / f'{side}.yaml') for side in ('left', 'right'))
        )
        for folder in (calibrated, world / 'dry')
    )
    assert found[0].matrix[0, 0] == pytest.approx(truth[0].matrix[0, 0], rel=2e-3)
    np.testing.assert_allclose(found[3], truth[3], atol=5e-4)


def test_the_calibration_holds_in_operation(
    world: Path, calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = 'calibrate check {at}/bowl --calibration {cal} --config {cal}/interface.yaml'
    assert main(words(line, at=world, cal=calibrated)) == 0
    assert 'the calibration holds' in capsys.readouterr().out


def test_cameras_calibrated_in_the_water_are_found_out(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The boards in the water taken for boards in air, and the bag's own surface on top."""
    line = 'simulate -o {at}/round --preset demo --pairs 40 --rate 3.7 --seed 5'
    assert main(words(line, at=world)) == 0
    assert main(words('calibrate stereo {at}/wet --square 0.025 -o {at}/wetcal', at=world)) == 0
    capsys.readouterr()
    assert main(words('calibrate check {at}/round --calibration {at}/wetcal', at=world)) == 1
    assert 'counted twice' in capsys.readouterr().out
    assert main(words('calibrate check {at}/round', at=world)) == 0
    assert 'twice' not in capsys.readouterr().out


def test_the_rig_tells_how_accurate_it_is(
    world: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stated deviations of the bowl's own positions lie within those of its volume."""
    line = 'calibrate report {cal} -o {out} --near 0.85 --far 1.3 --noise 0.1 --wanted {wanted}'
    assert main(words(line, cal=calibrated, out=tmp_path, wanted=1)) == 0
    text = capsys.readouterr().out
    rows = [line.split() for line in text.splitlines() if re.match(r' +[01]\.\d\d ', line)]
    along, across, exact_along, exact_across = np.array(rows, float)[:, 1:].T
    assert (along > across).all()
    assert (along >= exact_along).all()
    assert (across >= exact_across).all()
    assert (np.diff(exact_along) > 0).all()
    assert 'the rig is good enough' in text
    assert '(this rig)' in text
    assert (tmp_path / 'accuracy.html').read_text(encoding='utf-8').count('<svg') == 1
    assert main(words(line, cal=calibrated, out=tmp_path, wanted=1e-6)) == 0
    assert 'a wider baseline' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('more', 'line'),
    [
        ('--near 2 --far 1', 'the nearer one first'),
        ('--noise 0', 'above 0'),
        ('--near 0.1 --far 0.2', 'see nothing together'),
    ],
)
def test_impossible_reports_are_one_line(
    calibrated: Path, more: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert line in line_of(words(f'calibrate report {{cal}} {more}', cal=calibrated), capsys)


def test_each_camera_alone_then_both_together(
    samples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From seven real pairs: the published focal length and baseline."""
    for side in ('left', 'right'):
        (tmp_path / side).mkdir()
        for path in sorted(samples.glob(f'{side}0[1-7].jpg')):
            (tmp_path / side / path.name).write_bytes(path.read_bytes())
        line = 'calibrate camera {at}/{side} --square 0.025 --side {side} -o {at}/own'
        assert main(words(line, at=tmp_path, side=side)) == 0
    assert 'right lens' in capsys.readouterr().out
    left = read_camera_info(tmp_path / 'own' / 'left.yaml')
    assert left.k[0] == pytest.approx(532.83, rel=1e-2)
    line = 'calibrate stereo {at} --square 0.025 --intrinsics {at}/own -o {at}/both'
    assert main(words(line, at=tmp_path)) == 0
    infos = [read_camera_info(tmp_path / 'both' / f'{side}.yaml') for side in ('left', 'right')]
    translation = stereo_from_camera_infos(*infos)[3]
    assert np.linalg.norm(translation) == pytest.approx(3.3273 * 0.025, rel=0.01)


def test_one_camera_finds_what_it_looks_through(
    world: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagReader(world / 'wet') as reader:
        for i, record in enumerate(reader.messages(topics=['/stereo/left/image_raw/compressed'])):
            data = bytes(reader.decode(record).data)
            (tmp_path / f'{i:02}.jpg').write_bytes(data)
    line = 'calibrate interface {at} --side left --square 0.025 --calibration {cal} -o {at}/own'
    assert main(words(line, at=tmp_path, cal=world / 'cal')) == 0
    assert 'interface.distance' in capsys.readouterr().out
    written = yaml.safe_load((tmp_path / 'own' / 'left_interface.yaml').read_text())
    own = written['/**/triangulator']['ros__parameters']['interface']
    truth = [0.03, 0.06, 1.0] / np.linalg.norm([0.03, 0.06, 1.0])
    assert abs(own['distance'] - 0.8) < 4.0 * own['distance_std']
    assert np.linalg.norm(np.array(own['normal']) - truth) < 6.0 * own['normal_std']
    assert (tmp_path / 'own' / 'left_interface.html').exists()
    # The other camera's frame is not the rig's.
    assert main(words(f'{line} --side right', at=tmp_path, cal=world / 'cal')) == 2
    assert 'give --ports' in capsys.readouterr().err


def test_intrinsics_first_then_only_the_pose(
    world: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for side in ('left', 'right'):
        (tmp_path / f'{side}.yaml').write_bytes((world / 'dry' / f'{side}.yaml').read_bytes())
    line = 'calibrate stereo {at}/dry --square 0.025 --intrinsics {given} -o {given}/out'
    assert main(words(line, at=world, given=tmp_path)) == 0
    assert 'left lens' in capsys.readouterr().out
    kept, given = (read_camera_info(at / 'left.yaml') for at in (tmp_path / 'out', tmp_path))
    np.testing.assert_allclose(kept.k, given.k, rtol=1e-12)
    infos = [read_camera_info(tmp_path / 'out' / f'{side}.yaml') for side in ('left', 'right')]
    translation = stereo_from_camera_infos(*infos)[3]
    np.testing.assert_allclose(translation, [-0.23, 0.0, 0.0], atol=2e-4)


def test_reports_hold_their_pictures(world: Path, calibrated: Path) -> None:
    pytest.importorskip('matplotlib')
    for path, pictures in ((world / 'cal' / 'stereo.html', 5), (calibrated / 'interface.html', 5)):
        text = path.read_text(encoding='utf-8')
        assert text.count('<svg') == pictures
        assert 'Next:' in text
        assert 'http' not in text


def test_a_second_run_keeps_the_air_calibration(
    world: Path, calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = 'calibrate interface {at}/wet --square 0.025 --calibration {at}/cal -o {at}/cal'
    assert main(words(line, at=world)) == 2
    assert 'would overwrite the calibration in air' in capsys.readouterr().err


def test_a_ruler_is_enough(
    world: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = 'calibrate interface --calibration {at}/cal -o {out} --prior distance=0.8,0.004'
    assert main(words(line, at=world, out=tmp_path)) == 0
    assert 'determined by what you measured to 4 mm' in capsys.readouterr().out
    assert 'distance: 0.8' in (tmp_path / 'interface.yaml').read_text()


def test_a_ruler_is_enough_for_ports_and_the_wall_behind_them(
    world: Path, calibrated: Path, tmp_path: Path
) -> None:
    line = (
        'calibrate interface --calibration {at}/cal -o {out} --ports --indices 1,1.5,1 '
        '--thicknesses 0.01 --surface-indices 1,1.49,1.333 --surface-thicknesses 0.012 '
        '--prior interface.distance=0.8,0.004 --prior left_port.distance=0.04,0.001'
    )
    assert main(words(line, at=world, out=tmp_path)) == 0
    parameters = yaml.safe_load((tmp_path / 'interface.yaml').read_text())
    blocks = parameters['/**/triangulator']['ros__parameters']
    assert blocks['interface']['indices'] == [1.0, 1.49, 1.333]
    assert blocks['left_port']['distance'] == 0.04
    assert blocks['right_port']['indices'] == [1.0, 1.5, 1.0]


def test_a_target_of_known_size_is_enough(
    world: Path, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = (
        'calibrate interface {at}/bowl --calibration {at}/cal -o {out} --target-diameter 0.06 '
        '--prior target_index=1.333,0.001'
    )
    assert main(words(line, at=world, out=tmp_path)) == 0
    assert 'The distance of the surface' in capsys.readouterr().out


def line_of(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(arguments) == 2
    # A search that lasts shows how far it is.
    error = [
        line
        for line in capsys.readouterr().err.splitlines()
        if not line.startswith('searching for the board')
    ]
    assert len(error) == 1
    assert error[0].startswith('binopos calibrate: ')
    return error[0]


@pytest.mark.parametrize(
    ('arguments', 'line'),
    [
        ('calibrate stereo {data}', '--square is missing'),
        ('calibrate stereo {data} --square 25', 'millimetres were given'),
        ('calibrate stereo {data} --square 0.025 --board 9', 'as 9x6'),
        ('calibrate stereo --square 0.025', 'give SOURCE'),
        ('calibrate stereo {tmp}/none --square 0.025', 'does not exist'),
        ('calibrate stereo {tmp} --square 0.025', 'no left pictures'),
        ('calibrate interface --calibration {tmp}', 'holds no left.yaml'),
        ('calibrate check {tmp}/none', 'none'),
        ('calibrate camera {tmp}/none --square 0.025', 'is no folder of pictures'),
        ('calibrate camera {tmp} --square 0.025', 'no picture of'),
    ],
)
def test_bad_input_is_one_line(
    arguments: str,
    line: str,
    shared_data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    data = shared_data / 'opencv-stereo-samples'
    assert line in line_of(words(arguments, data=data, tmp=tmp_path), capsys)


@pytest.mark.parametrize('board', ['9x7', '8x6'])
def test_another_board_is_named(
    board: str, samples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in sorted(samples.glob('*0[12].jpg')):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    line = f'calibrate stereo {{at}} --square 0.025 --board {board}'
    line = line_of(words(line, at=tmp_path), capsys)
    assert f'no {board} chessboard' in line
    assert 'one of 9x6 is there' in line


def test_a_picture_of_another_size_costs_its_pair_and_is_named(
    samples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in sorted(samples.glob('*0[1-5].jpg')):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    small = cv2.resize(cv2.imread(str(samples / 'left03.jpg')), (320, 240))
    cv2.imwrite(str(tmp_path / 'left03.jpg'), small)
    out = words('-o {out}', out=tmp_path / 'calibration')
    assert main(words('calibrate stereo {at} --square 0.025', at=tmp_path) + out) == 0
    (line,) = [each for each in capsys.readouterr().out.splitlines() if 'left03.jpg' in each]
    assert '320x240' in line
    assert 'use one resolution' in line


@pytest.mark.parametrize(
    ('words_', 'line'),
    [
        ('--prior distance', 'NAME=VALUE,SD'),
        ('--prior distance=0.8', 'NAME=VALUE,SD'),
        ('--prior distance=0.8,x', 'numbers with commas'),
        ('--prior distance=0.8,0', 'above 0'),
        ('--prior depth=0.8,0.1', "no 'depth'"),
        ('--prior thicknesses.0=0.006,0.001', 'there is no thicknesses.0'),
        ('--prior left_port.distance=0.1,0.01', 'add --ports'),
        ('--indices 1.0,1.5,1.33', 'one index per medium'),
        ('--surface-indices 1.0,1.333', 'add --ports'),
        (
            '--ports --indices 1,1.5,1 --thicknesses 0.01 --surface-indices 1,1.333 '
            '--prior distance=0.8,0.1',
            'say which: interface.distance or left_port.distance',
        ),
        (
            '--ports --indices 1,1.5,1 --thicknesses 0.01 --surface-indices 1,1.5,1.333',
            'one index per medium',
        ),
        ('--indices 1.0,9.0 --prior distance=0.8,0.1', 'no refractive index'),
        ('--target-diameter 60', 'needs a bag'),
        ('', 'measured by hand'),
    ],
)
def test_bad_priors_are_one_line(
    world: Path, calibrated: Path, words_: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = words('calibrate interface --calibration {at}/cal', at=world) + words_.split()
    capsys.readouterr()
    assert line in line_of(arguments, capsys)
