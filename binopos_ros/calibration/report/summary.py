"""Calibrations as a person reads them in a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment
from binopos_ros.calibration.cameras.alone import CameraCalibration
from binopos_ros.calibration.cameras.stereo import StereoCalibration, seen_by_both
from binopos_ros.calibration.interface.calibrate import InterfaceCalibration
from binopos_ros.calibration.report.quality import concerns
from binopos_ros.calibration.report.verdicts import advice, verdicts
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.optics.rig_state import LEFT, RIGHT, TARGET_INDEX, logarithm
from binopos_ros.sides import SIDES

Rows = list[tuple[str, str]]
#: What of an interface stands in the summary; the target's index is a row of its own.
SHOWN = ('normal', 'distance', 'centre', 'radius', 'thicknesses')


def summarise_stereo(calibration: StereoCalibration) -> str:
    """The outcome of `calibrate stereo`, for the terminal."""
    table = _table(stereo_rows(calibration)) + _dropped(calibration.dropped)
    return '\n'.join([table, *(f'WARNING: {one}' for one in concerns(calibration))])


def summarise_camera(calibration: CameraCalibration, side: str) -> str:
    """The outcome of `calibrate camera`, for the terminal."""
    fit, camera = calibration.adjustment, calibration.camera
    focal = fit.deviation('left.fx')
    centre = max(fit.deviation('left.cx'), fit.deviation('left.cy'))
    rows = [
        ('views used', str(len(calibration.views))),
        (f'{side} lens', calibration.lens.text),
        ('focal length', f'{camera.focal[0]:.2f}, {camera.focal[1]:.2f} px (+- {focal:.2f})'),
        (
            'principal point',
            f'{camera.centre[0]:.2f}, {camera.centre[1]:.2f} px (+- {centre:.2f})',
        ),
        ('reprojection RMS', f'{fit.rms():.3f} px'),
        ('corner noise', _noise(fit)),
        ('held-out RMS', f'{calibration.held_out.rms:.3f} px'),
    ]
    return _table(rows) + _dropped(calibration.dropped)


def summarise_interface(calibration: InterfaceCalibration) -> str:
    """The outcome of `calibrate interface`, for the terminal."""
    # One sentence may be about several parameters, as a dome's centre is three.
    words = list(dict.fromkeys(f'  {verdict.text}' for verdict in verdicts(calibration)))
    table = _table(interface_rows(calibration)) + _dropped(calibration.dropped)
    return '\n'.join([table, *words, f'To improve: {advice(calibration)}'])


def stereo_rows(calibration: StereoCalibration) -> Rows:
    """What `calibrate stereo` found, by name."""
    fit = calibration.adjustment
    rows = [
        ('views used', _views_in_words(calibration)),
        ('board', calibration.shape.in_words),
        *(
            (f'{name} lens', lens.text)
            for name, lens in zip(SIDES, calibration.lenses, strict=True)
        ),
    ]
    for side in (LEFT, RIGHT):
        camera, name = fit.state.cameras[side], SIDES[side]
        focal = fit.deviation(f'{name}.fx')
        centre = max(fit.deviation(f'{name}.cx'), fit.deviation(f'{name}.cy'))
        rows += [
            (
                f'{name} focal length',
                f'{camera.focal[0]:.2f}, {camera.focal[1]:.2f} px (+- {focal:.2f})',
            ),
            (
                f'{name} principal point',
                f'{camera.centre[0]:.2f}, {camera.centre[1]:.2f} px (+- {centre:.2f})',
            ),
        ]
    baseline = 1000 * float(np.linalg.norm(fit.state.translation))
    spread = 1000 * max(fit.deviation(f'translation.{axis}') for axis in 'xyz')
    held_out = calibration.held_out
    rows += [
        ('baseline', f'{baseline:.2f} mm (+- {spread:.2f})'),
        ('reprojection RMS', f'{fit.rms():.3f} px'),
        ('corner noise', _noise(fit)),
        ('held-out RMS, board posed by both', f'{held_out.rms:.3f} px'),
        ('held-out RMS, posed by the left alone', f'{held_out.transfer:.3f} px'),
    ]
    return rows


def _views_in_words(calibration: StereoCalibration) -> str:
    both = seen_by_both(calibration.views)
    alone = len(calibration.views) - both
    more = f', and {alone} that one camera alone sees' if alone else ''
    return f'{both} of the {calibration.board}{more}'


def interface_rows(calibration: InterfaceCalibration) -> Rows:
    """What `calibrate interface` found, by name."""
    rows: Rows = []
    if calibration.adjustment is not None:
        rows += [
            ('views used', str(len(calibration.views))),
            *([('board', calibration.shape.in_words)] if calibration.views[0].turns else []),
            ('reprojection RMS', f'{calibration.adjustment.rms():.3f} px'),
            ('corner noise', _noise(calibration.adjustment)),
        ]
    rows += [(TARGET_INDEX, f'{calibration.state.target_index:.5f}')]
    for place, interface in calibration.state.interfaces.items():
        for kind, value in interface.written.items():
            numbers = [f'{number:.5f}' for number in np.ravel(value)] if kind in SHOWN else []
            if kind == 'thicknesses':
                rows += [(f'{place}.{kind}.{i}', f'{t} m') for i, t in enumerate(numbers)]
            elif len(numbers) == 1:
                rows.append((f'{place}.{kind}', f'{numbers[0]} m'))
            elif numbers:
                unit = '' if kind == 'normal' else ' m'
                rows.append((f'{place}.{kind}', f'[{", ".join(numbers)}]{unit}'))
    return rows


def camera_rows(fit: Adjustment) -> list[tuple[str, str, str, str]]:
    """Name, value, standard deviation and unit of the cameras' parameters."""
    state = fit.state
    values: dict[str, float] = {}
    for side, camera in zip(SIDES, state.cameras, strict=True):
        numbers = (*camera.focal, *camera.centre, *camera.lens)
        own = [name for name in state.names if name.startswith(f'{side}.')]
        values |= dict(zip(own, numbers, strict=True))
    turn = np.degrees(logarithm(state.rotation))
    values |= {f'rotation.{axis}': value for axis, value in zip('xyz', turn, strict=True)}
    shift = 1000.0 * state.translation
    values |= {f'translation.{axis}': value for axis, value in zip('xyz', shift, strict=True)}
    rows = []
    for name, value in values.items():
        unit, scale = '', 1.0
        if name.startswith('rotation'):
            unit, scale = 'degrees', float(np.degrees(1.0))
        elif name.startswith('translation'):
            unit, scale = 'mm', 1000.0
        elif name.split('.')[1] in ('fx', 'fy', 'cx', 'cy'):
            unit = 'px'
        rows.append((name, f'{value:.6g}', f'{scale * fit.deviation(name):.2g}', unit))
    return rows


def _noise(fit: Adjustment) -> str:
    """The points' noise, and whether the points of a view err alike."""
    words = f'{fit.sigma:.3f} px in a coordinate'
    if fit.variance_factor > 1.0:
        times = fit.effective_sigma / fit.sigma
        return f'{words}, alike within a view: deviations widened {times:.1f} times'
    return f'{words}, independent from point to point'


def _table(rows: Sequence[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in rows)
    return '\n'.join(f'  {name:<{width}}  {value}' for name, value in rows)


def _dropped(dropped: Sequence[Dropped]) -> str:
    if not dropped:
        return ''
    return '\nleft out:\n' + '\n'.join(f'  {one}' for one in dropped)
