"""Domes from pictures to positions: rendered boards, what is found, and discs then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of
from binopos_ros.optics.covariance_file import read_covariance
from verbs import binopos_here

PORTS = ('left_port', 'right_port')
KNOWN = (
    *('--ports', '--shape', 'dome', '--radius', 0.05, '--thicknesses', 0.005),
    *('--indices', '1.0,1.49,1.333', '--prior', 'radius=0.05,0.0001'),
    *('--prior', 'target_index=1.335,0.0005'),
)
#: Quantiles of 99.9 % of chi^2 with 6 and 3 degrees of freedom.
CENTRES, POSITION = 22.46, 16.27


def centres(path: Path) -> np.ndarray:
    """Those of both domes in a parameter file, (6,) m."""
    parameters: dict[str, Any] = yaml.safe_load(path.read_text())['/**/triangulator']
    return np.ravel([parameters['ros__parameters'][port]['centre'] for port in PORTS])


def verb(*words: object) -> None:
    done = binopos_here(*words)
    assert done.returncode == 0, done.stderr


def test_rendered_boards_give_the_domes_and_discs_their_positions(tmp_path: Path) -> None:
    boards, discs, found = tmp_path / 'boards', tmp_path / 'discs', tmp_path / 'found'
    shown = ('--board', '9x6', '--square', 0.03, '--pairs', 8, '--rate', 2)
    verb('simulate', '-o', boards, '--preset', 'domes', '--seed', 1, *shown)
    verb(
        *('calibrate', 'interface', boards, '--square', 0.03, '--calibration', boards),
        *('-o', found, *KNOWN),
    )
    error = centres(found / 'interface.yaml') - centres(boards / 'binopos.yaml')
    across, along = error.reshape(2, 3)[:, :2], error.reshape(2, 3)[:, 2]
    assert np.linalg.norm(across, axis=1).max() < 0.3e-3
    assert np.abs(along).max() < 0.5e-3
    stated = read_covariance(found / 'covariance.yaml')
    own = stated.ordered([f'{port}.centre.{i}' for port in PORTS for i in range(3)])
    assert error @ np.linalg.solve(own, error) < CENTRES

    verb('simulate', '-o', discs, '--preset', 'domes', '--seed', 4, '--pairs', 5)
    out = tmp_path / 'out.mcap'
    layers = ('--calibration', found, '--config', found / 'interface.yaml')
    verb('process', discs, '-o', out, *layers)
    with BagReader(out) as reader:
        messages = [reader.decode(m) for m in reader.messages(['/stereo/target/position'])]
    with BagReader(discs) as reader:
        truth = [position_of(reader.decode(m)) for m in reader.messages(['/stereo/truth/pose'])]
    assert len(messages) == len(truth) == 5
    squares = []
    for message, true in zip(messages, truth, strict=True):
        miss = np.subtract(position_of(message), true)
        covariance = np.reshape(message.pose.covariance, (6, 6))[:3, :3]
        squares.append(miss @ np.linalg.solve(covariance, miss))
    # The domes' own error is the same in all of them, so they count as one.
    assert np.mean(squares) < POSITION
