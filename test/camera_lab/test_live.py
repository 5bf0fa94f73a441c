"""The whole suite on kernel drivers: live, and through every fault that a camera can have.

One run of the virtual machine serves all tests; its times are those of an emulated machine. Where
the lab cannot be set up, the tests skip and say why.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagReader, BagWriter
from binopos_ros.bag.messages import position_of, stamp_of
from binopos_ros.cli import main as binopos

HERE = Path(__file__).resolve().parent
LIMIT = 600
RECOVERY = 2.0
"""Seconds from when the kernel shows a camera again until its images are there."""
LONGER_TIMEOUT = 1.5
"""By so much the lab's slow cameras need a longer `frame_timeout` than by default; a camera that
was opened while it could not send is given that long."""

pytestmark = [pytest.mark.live, pytest.mark.xdist_group('camera lab')]


@pytest.fixture(scope='module')
def lab(tmp_path_factory, project):
    """The folder with what one run in the lab has left: scene/, results.json, vivid.json, ..."""
    if os.environ.get('BINOPOS_CAMERA_LAB') == 'off':
        pytest.skip('camera lab: switched off by BINOPOS_CAMERA_LAB=off')
    if shutil.which('bash') is None:
        pytest.skip('camera lab: bash is needed')
    pytest.importorskip('rclpy', reason='camera lab: rclpy is not installed')
    ready = subprocess.run([HERE / 'setup'], capture_output=True, text=True, check=False)
    if ready.returncode:
        pytest.skip((ready.stderr.strip() or 'camera lab: the set-up failed').splitlines()[-1])
    folder = tmp_path_factory.mktemp('camera_lab')
    python = sys.executable
    run = f'{python} -m binopos_ros run --single-process --config {folder}/scene/rig.yaml'
    scene = folder / 'scene'
    scene.mkdir()
    environment = {**os.environ, 'PYTHONPATH': str(project)}
    subprocess.run([sys.executable, HERE / 'scene.py', scene], env=environment, check=True)
    script = folder / 'script'
    script.write_text(
        'export ROS_DOMAIN_ID=7 ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_HOME=/tmp/ros\n'
        f'export PYTHONPATH={project}:{HERE} PYTHONDONTWRITEBYTECODE=1\n'
        'load_vivid\n'
        f'{python} {HERE}/vivid_faults.py /mnt/out\n'
        'load -r vivid; load_uvc; start_udev\n'
        # Detecting holds up whatever shares its process; and two processes start sooner than four.
        f'{run} --nodes camera >/mnt/out/camera.log 2>&1 & camera=$!\n'
        f'{run} --nodes detector triangulator smoother >/mnt/out/stages.log 2>&1 & stages=$!\n'
        f'{python} {HERE}/live_suite.py {scene} /mnt/out $camera $stages || exit\n'
        'kill $camera $stages; wait $camera; echo $? >/mnt/out/statuses\n'
        'wait $stages; echo $? >>/mnt/out/statuses\n'
    )
    out = folder / 'out'
    run = subprocess.run(
        [HERE / 'run_guest', '-t', str(LIMIT), script],
        env={**os.environ, 'BINOPOS_CAMERA_LAB_OUT': str(out)},
        capture_output=True,
        text=True,
        check=False,
    )
    (out / 'console.log').write_text(run.stdout + run.stderr)
    assert run.returncode == 0, (run.stdout + run.stderr)[-4000:]
    return folder


@pytest.fixture(scope='module')
def results(lab):
    return json.loads((lab / 'out/results.json').read_text())


@pytest.fixture(scope='module')
def recorded(lab):
    """A bag of what the suite sent in the undisturbed stretch, and what `process` makes of it."""
    kept = pickle.loads((lab / 'out/messages.pickle').read_bytes())
    bag, processed = lab / 'live_bag', lab / 'processed.mcap'
    with BagWriter(bag) as writer:
        for topic, kind in {(topic, kind) for topic, kind, _, _ in kept}:
            writer.add_topic(f'/stereo/{topic}', kind)
        for topic, _, stamp, data in kept:
            writer.write(f'/stereo/{topic}', stamp, data)
    words = ['process', str(bag), '-o', str(processed), '--config', str(lab / 'scene/rig.yaml')]
    assert binopos(words) == 0
    return bag, processed


def positions(bag, topic):
    """Positions (m) by stamp (ns)."""
    with BagReader(bag) as reader:
        return {
            stamp_of(message): np.asarray(position_of(message))
            for record in reader.messages([topic])
            for message in [reader.decode(record)]
        }


def truth(lab, bag):
    """The true position by stamp: a frame is known by its bytes, which nothing has touched."""
    known = json.loads((lab / 'scene/truth.json').read_text())
    frames = {path.read_bytes(): int(path.stem) for path in (lab / 'scene/left').glob('*.jpg')}
    with BagReader(bag) as reader:
        return {
            stamp_of(message): np.asarray(known[frames[bytes(message.data)]])
            for record in reader.messages(['/stereo/left/image_raw/compressed'])
            for message in [reader.decode(record)]
        }


def rms(errors):
    return math.sqrt(np.mean(np.sum(np.square(errors), axis=1)))


def test_the_suite_runs_live_and_measures_its_pairs(results):
    undisturbed = results['undisturbed']
    assert undisturbed['suite_alive']
    status = undisturbed['status']
    assert status['left: state'] == status['right: state'] == 'streaming'
    assert int(status['Pairs']) > 10
    assert float(status['Pair skew, median (ms)']) < 50.0


def test_live_positions_are_those_of_process_on_the_same_frames(recorded):
    bag, processed = recorded
    live = positions(bag, '/stereo/target/position')
    offline = positions(processed, '/stereo/target/position')
    common = live.keys() & offline.keys()
    assert len(common) >= 10
    difference = [live[stamp] - offline[stamp] for stamp in common]
    assert np.abs(difference).max() < 1e-6


def test_live_positions_follow_the_truth_as_those_of_process_do(lab, recorded):
    bag, processed = recorded
    true = truth(lab, bag)
    for topic in ('/stereo/target/position', '/stereo/target/pose'):
        live, offline = positions(bag, topic), positions(processed, topic)
        common = live.keys() & offline.keys() & true.keys()
        assert len(common) >= 10
        live_error = rms([live[stamp] - true[stamp] for stamp in common])
        offline_error = rms([offline[stamp] - true[stamp] for stamp in common])
        assert live_error < 1.5 * offline_error + 0.5e-3
    raw = positions(bag, '/stereo/target/position')
    assert rms([raw[stamp] - true[stamp] for stamp in raw.keys() & true.keys()]) < 3e-3


@pytest.mark.parametrize(
    ('fault', 'words'),
    [
        ('missing at start', "right: camera 'LAB-RIGHT' is not plugged in"),
        ('unplug', 'is unplugged; plug it in again'),
        ('other port', 'is unplugged; plug it in again'),
        ('exchanged ports', 'is unplugged; plug it in again'),
        ('freeze', 'no frame for'),
        ('stall', 'no frame for'),
        ('busy', 'another program uses it'),
    ],
)
def test_a_fault_is_told_and_mended(results, fault, words):
    result = results[fault]
    assert result['suite_alive']
    assert result['told'], result
    assert words in result['said']
    assert result['seconds_to_image'] is not None
    assert result['seconds_to_image'] < RECOVERY + (LONGER_TIMEOUT if fault == 'stall' else 0.0)
    assert result['seconds_to_pose'] is not None


def test_left_stays_left_when_the_plugs_are_exchanged(results):
    assert results['exchanged ports']['sides_kept']


@pytest.mark.parametrize(
    ('kind', 'reasons'),
    [
        # Damage inside a JPEG bears no mark: the decoder may find it, or make a picture of it.
        ('corrupt', None),
        ('short', {'stereo/camera right: JPEG cut short'}),
        # The kernel's driver keeps what the device flags as damaged to itself.
        ('error', {'stereo/camera right: lost by the driver'}),
        ('drop', None),
    ],
)
def test_damaged_frames_stop_nothing_and_are_counted(results, kind, reasons):
    result = results[kind]
    assert result['suite_alive']
    assert result['seconds_to_pose'] is not None
    if reasons:
        counted = {reason: count for reason, count in result['dropped'].items() if count}
        assert reasons <= counted.keys(), counted
        assert sum(counted[reason] for reason in reasons) == 2


def test_cameras_are_found_by_udevs_links(results):
    links = results['undisturbed']['links']
    assert any('LAB-LEFT' in link for link in links)
    assert any('LAB-RIGHT' in link for link in links)


def test_the_suite_ends_well_after_all_that(results, lab):
    assert results['end']['suite_alive']
    assert (lab / 'out/statuses').read_text().split() == ['0', '0']
    for name in ('camera.log', 'stages.log'):
        log = (lab / 'out' / name).read_text()
        assert 'died' not in log
        assert 'Traceback' not in log


@pytest.mark.parametrize(
    'name',
    [
        'inject_fatal_streaming_error',
        'inject_vidioc_qbuf_error',
        'inject_v4l2_buf_flag_error',
        'inject_vidioc_reqbufs_error',
        'inject_vidioc_streamon_error',
    ],
)
def test_an_error_that_vivid_injects_is_noticed_and_mended(lab, name):
    result = json.loads((lab / 'out/vivid.json').read_text())[name]
    assert result['noticed']
    assert result['recovered']
    assert result['seconds'] < RECOVERY
    assert result['descriptors_left'] == 0


def test_a_device_that_vivid_disconnects_is_told_gone(lab):
    result = json.loads((lab / 'out/vivid.json').read_text())['disconnect']
    assert result['noticed']
    assert 'not plugged in' in result['trouble']
    assert result['descriptors_left'] == 0
