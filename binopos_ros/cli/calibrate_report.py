"""`binopos calibrate report`: how accurate a calibrated rig is, and what would make it better."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.report.accuracy import accuracy_map, working_range
from binopos_ros.calibration.report.accuracy_page import (
    accuracy_page,
    accuracy_text,
    baseline_rows,
)
from binopos_ros.calibration.report.files import INTERFACE_FILE, read_stereo
from binopos_ros.cli.config import parameters_of
from binopos_ros.cli.progress import working
from binopos_ros.cli.provenance import how_made
from binopos_ros.cli.terminal import fitted
from binopos_ros.optics.rig_state import LEFT_PORT, RIGHT_PORT, SHARED
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate report`."""
    parser.add_argument(
        'calibration',
        type=Path,
        metavar='CALIBRATION',
        help='folder that `calibrate stereo` or `calibrate interface` has written; its '
        'interface.yaml is taken unless --config gives another',
    )
    parser.add_argument(
        '--noise',
        type=float,
        default=0.1,
        metavar='PX',
        help='standard deviation of the target in a picture (default: 0.1 px)',
    )
    parser.add_argument('--near', type=float, metavar='M', help='nearest target (m)')
    parser.add_argument('--far', type=float, metavar='M', help='farthest target (m)')
    parser.add_argument(
        '--wanted',
        type=float,
        default=0.005,
        metavar='M',
        help='standard deviation of a position that is good enough (default: 0.005 m)',
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='folder of accuracy.html (default: CALIBRATION)',
    )


def report(arguments: argparse.Namespace) -> int:
    """Run it; the exit status."""
    for name in ('noise', 'wanted'):
        if not getattr(arguments, name) > 0.0:
            raise CalibrationError(f'--{name} {getattr(arguments, name):g}: give a value above 0')
    air, known = read_stereo(arguments.calibration)
    own = arguments.calibration / INTERFACE_FILE
    if arguments.config is None and own.is_file():
        arguments.config = own
    state = air
    if arguments.config is not None:
        options = build(TriangulatorOptions, parameters_of(arguments).of_node('triangulator'))
        places = zip((SHARED, LEFT_PORT, RIGHT_PORT), options.interfaces(), strict=True)
        state = replace(air, interfaces={place: one for place, one in places if one is not None})
    if known is None:
        print('no covariance.yaml lies beside the calibration: its own errors are not known')
        covariance = np.zeros((len(state.names),) * 2)
    else:
        covariance = known.ordered(state.names)
    reach = working_range(state, arguments.near, arguments.far)
    with working('mapping the working volume'):
        found = accuracy_map(state, covariance, arguments.noise, reach)
        baselines = baseline_rows(state, covariance, arguments.noise, reach, arguments.wanted)
    print(fitted(accuracy_text(found, baselines, arguments.wanted)))
    folder = arguments.output or arguments.calibration
    made = how_made(arguments, arguments.calibration, arguments.config)
    print(f'written: {accuracy_page(folder, found, baselines, arguments.wanted, made)}')
    return 0
