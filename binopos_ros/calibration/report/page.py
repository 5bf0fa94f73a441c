"""The report: one HTML file that needs nothing beside it."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment
from binopos_ros.calibration.cameras.stereo import StereoCalibration
from binopos_ros.calibration.interface.calibrate import InterfaceCalibration
from binopos_ros.calibration.report import pictures
from binopos_ros.calibration.report.files import write_text
from binopos_ros.calibration.report.prediction import error_map
from binopos_ros.calibration.report.summary import camera_rows, interface_rows, stereo_rows
from binopos_ros.calibration.report.verdicts import advice, tilt_angles, verdicts
from binopos_ros.calibration.views.pairs import CELLS, Dropped, coverage
from binopos_ros.calibration.views.view import View
from binopos_ros.sheet import Made, drawing, sheet, table
from binopos_ros.sides import SIDES

FEW_VIEWS = 12
EMPTY = 0.25  # of the cells
LITTLE_TILT = 30.0  # degrees
CAPTIONS = {
    'Reprojection per view': 'How far the points of each view lie from where the calibration '
    'computes them. Bars of one height are good; one that stands out is a view with blur or a '
    'board that moved.',
    'Coverage': 'Points in each part of the pictures; empty parts have seen none. Every part that '
    'the target will visit should hold some.',
    'Residual maps': 'Mean of what is left over, part by part. Arrows without order are noise; '
    'neighbours that agree, above all towards the edges, are a lens or a board that the model '
    'misses.',
    'Epipolar error along the rays': 'How far the two rays of each point miss each other. It '
    'should scatter about zero everywhere; `binopos calibrate check` watches it in operation.',
    'Predicted error over the working volume': 'Standard deviation of one position, in a level '
    'slice through the middle of where the boards were: left of a target seen to 0.1 px with this '
    'calibration, right the part that better calibration pictures would remove.',
}


def stereo_report(folder: Path, calibration: StereoCalibration, made: Made) -> Path:
    """Write stereo.html; its path."""
    fit, views = calibration.adjustment, calibration.views
    head = ('parameter', 'value', 'standard deviation', 'unit')
    sections = [
        ('Summary', table(stereo_rows(calibration))),
        *_left_out(calibration.dropped),
        *_picture_sections(fit, views, fit.covariance),
        ('Parameters', table(camera_rows(fit), head)),
    ]
    path = folder / 'stereo.html'
    write_text(path, page('Stereo calibration', stereo_advice(calibration), sections, made))
    return path


def interface_report(
    folder: Path, calibration: InterfaceCalibration, made: Made, name: str = 'interface.html'
) -> Path:
    """Write the page; its path."""
    rows = [
        (verdict.name, verdict.value_in_words, verdict.spread_in_words, verdict.text)
        for verdict in verdicts(calibration)
    ]
    sections = [
        ('Summary', table(interface_rows(calibration))),
        ('Verdicts', table(rows, ('parameter', 'value', 'standard deviation', 'verdict'))),
        *_left_out(calibration.dropped),
    ]
    fit = calibration.adjustment
    if fit is not None:
        sections += _picture_sections(fit, calibration.views, calibration.covariance)
    path = folder / name
    write_text(path, page('Interface calibration', advice(calibration), sections, made))
    return path


def stereo_advice(calibration: StereoCalibration) -> str:
    """The next thing to do, or that nothing needs doing."""
    views = calibration.views
    if len(views) < FEW_VIEWS:
        return f'{len(views)} views are few: take 15 to 30.'
    tilts = tilt_angles(calibration.adjustment.poses, np.array([0.0, 0.0, 1.0]))
    if tilts.max() < LITTLE_TILT:
        return f'Tilt the board more: at most {tilts.max():.0f} degrees so far, 30-45 are good.'
    for side, camera in enumerate(calibration.state.cameras):
        counts = coverage(np.concatenate([view.pixels[side] for view in views]), camera.size)
        if np.mean(counts == 0) > EMPTY:
            return (
                f'Show the board in the empty parts of the {SIDES[side]} picture, near the edges '
                f'above all: {np.sum(counts == 0)} of {CELLS[0] * CELLS[1]} cells hold no point.'
            )
    return 'Nothing: the views cover both pictures, with tilts. Calibrate the interface.'


def _picture_sections(
    fit: Adjustment, views: Sequence[View], covariance: np.ndarray
) -> list[tuple[str, str]]:
    if not pictures.available():
        words = 'Install matplotlib (the extra <code>reports</code>) and calibrate again.'
        return [('Pictures', f'<p>{words}</p>')]
    whole = [view for view in views if view.turns]
    sections = [
        _picture('Reprojection per view', pictures.per_view(fit, views)),
        _picture('Coverage', pictures.coverages(fit, views)),
    ]
    if len(whole) == len(views):
        sections += [_picture('Residual maps', pictures.residual_maps(fit, views))]
    if len(fit.state.cameras) < 2:
        return sections
    if len(whole) == len(views):
        sections += [_picture('Epipolar error along the rays', pictures.epipolar(fit, views))]
    errors = error_map(fit.state, covariance, views, fit.poses)
    median = f' Median over what both cameras see: {1000 * errors.median:.2f} mm.'
    volume = 'Predicted error over the working volume'
    return [*sections, _picture(volume, pictures.predicted(errors), median)]


def _left_out(dropped: Sequence[Dropped]) -> list[tuple[str, str]]:
    if not dropped:
        return []
    return [('Left out', table([(one.name, one.reason) for one in dropped], ('view', 'reason')))]


def _picture(heading: str, svg: str, more: str = '') -> tuple[str, str]:
    return picture(heading, CAPTIONS[heading] + more, svg)


def picture(heading: str, caption: str, svg: str) -> tuple[str, str]:
    """A section with a picture under its caption: heading and HTML."""
    return heading, f'<p>{html.escape(caption)}</p>{drawing(svg, heading)}'


def page(title: str, next_thing: str, sections: Sequence[tuple[str, str]], made: Made) -> str:
    """The HTML of a whole page: what to do next, then sections of heading and HTML."""
    body = [
        f'<p class="next"><b>Next:</b> {html.escape(next_thing)}</p>',
        *(f'<h2>{heading}</h2>{part}' for heading, part in sections),
    ]
    return sheet(title, body, made)
