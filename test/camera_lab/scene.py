"""The scene that the virtual cameras show: rendered by the suite, with its truth, as files.

    python scene.py FOLDER

leaves in the folder `left/000.jpg` ... and `right/000.jpg` ..., `truth.json` with the target's
position (m) in each pair, and `rig.yaml`, the parameters of the whole suite.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import yaml

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of
from binopos_ros.cli import main as binopos

RATE = 2
"""Pairs per second: what the detector keeps up with in an emulated machine."""

PAIRS = 40
SIZE = (640, 480)
SERIALS = {'left': 'LAB-LEFT', 'right': 'LAB-RIGHT'}


def make(folder: Path) -> None:
    """Render the scene; the target's path closes upon itself, so that it can go round."""
    bag = folder / 'bag'
    words = (
        f'simulate -o {bag} --preset demo --pairs {PAIRS} --rate {RATE} --period {PAIRS / RATE}'
    )
    if binopos(words.split()) != 0:
        raise RuntimeError('the scene could not be rendered')
    counts = dict.fromkeys(SERIALS, 0)
    truth = []
    with BagReader(bag) as reader:
        for record in reader.messages():
            message = reader.decode(record)
            if record.topic.endswith('/truth/pose'):
                truth.append([float(value) for value in position_of(message)])
            elif record.topic.endswith('/image_raw/compressed'):
                side = record.topic.split('/')[2]
                path = folder / side / f'{counts[side]:03d}.jpg'
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(bytes(message.data))
                counts[side] += 1
    (folder / 'truth.json').write_text(json.dumps(truth))
    parameters = yaml.safe_load((bag / 'binopos.yaml').read_text())
    parameters['/**/camera'] = {'ros__parameters': camera_parameters(bag)}
    # Both cameras show the frame of one number, whenever it arrives: their stamps only jitter.
    parameters['/**/triangulator']['ros__parameters']['triggered'] = True
    # Where the emulated machine is held up, the newest pair counts, not the backlog.
    newest = {
        f'/stereo/{side}/image_raw/compressed': {'subscription': {'depth': 1}} for side in SERIALS
    }
    parameters['/**/detector'] = {'ros__parameters': {'qos_overrides': newest}}
    (folder / 'rig.yaml').write_text(yaml.safe_dump(parameters))


def camera_parameters(bag: Path) -> dict[str, object]:
    """The camera node's parameters for the two virtual cameras."""
    parameters: dict[str, object] = {
        'width': SIZE[0],
        'height': SIZE[1],
        'frame_rate': float(RATE),
        'frame_timeout': 2.5,
    }
    for side, serial in SERIALS.items():
        parameters[f'{side}.device'] = serial
        parameters[f'{side}.camera_info_url'] = str(bag / f'{side}.yaml')
    return parameters


if __name__ == '__main__':
    make(Path(sys.argv[1]))
