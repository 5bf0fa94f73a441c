"""The report: one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from binopos_ros.calibration import pictures
from binopos_ros.calibration.adjust import Adjustment, View
from binopos_ros.calibration.files import write_text
from binopos_ros.calibration.interface import InterfaceCalibration
from binopos_ros.calibration.prediction import error_map
from binopos_ros.calibration.state import SIDES
from binopos_ros.calibration.stereo import StereoCalibration
from binopos_ros.calibration.summary import summarise_interface, summarise_stereo
from binopos_ros.calibration.verdicts import advice, tilt_angles, verdicts
from binopos_ros.calibration.views import CELLS, coverage

FEW_VIEWS = 12
EMPTY = 0.25  # of the cells
LITTLE_TILT = 30.0  # degrees
STYLE = (
    'body{font:15px/1.45 sans-serif;max-width:70em;margin:2em auto;padding:0 1em}'
    'img{max-width:100%}pre{background:#f4f4f4;padding:1em;overflow:auto}'
    'td,th{padding:.2em .8em .2em 0;text-align:left;vertical-align:top}'
    '.next{background:#e8f2ff;padding:1em;border-left:4px solid #2a6fc9}'
)


def stereo_report(folder: Path, calibration: StereoCalibration) -> Path:
    """Write stereo.html; its path."""
    fit, views = calibration.adjustment, calibration.views
    sections = [
        ('Summary', f'<pre>{html.escape(summarise_stereo(calibration))}</pre>'),
        *_picture_sections(fit, views, fit.covariance),
        ('Parameters', _table(_parameter_rows(fit.state.names, fit.covariance))),
    ]
    path = folder / 'stereo.html'
    write_text(path, _page('Stereo calibration', stereo_advice(calibration), sections))
    return path


def interface_report(folder: Path, calibration: InterfaceCalibration) -> Path:
    """Write interface.html; its path."""
    rows = [('parameter', 'value', 'standard deviation', 'verdict')]
    for verdict in verdicts(calibration):
        rows.append(
            (verdict.name, f'{verdict.value:.6g}', f'{verdict.deviation:.2g}', verdict.text)
        )
    sections = [
        ('Summary', f'<pre>{html.escape(summarise_interface(calibration))}</pre>'),
        ('Verdicts', _table(rows)),
    ]
    fit = calibration.adjustment
    if fit is not None:
        sections += _picture_sections(fit, calibration.views, calibration.covariance)
    path = folder / 'interface.html'
    write_text(path, _page('Interface calibration', advice(calibration), sections))
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
        ('Reprojection per view', _image(pictures.per_view(fit, views))),
        ('Coverage', _image(pictures.coverages(fit, views))),
    ]
    if len(whole) == len(views):
        sections += [
            ('Residual maps', _image(pictures.residual_maps(fit, views))),
            ('Epipolar error along the rays', _image(pictures.epipolar(fit, views))),
        ]
    errors = error_map(fit.state, covariance, views, fit.poses)
    note = f'<p>Median over what both cameras see: {1000 * errors.median:.2f} mm.</p>'
    sections.append(
        ('Predicted error over the working volume', note + _image(pictures.predicted(errors)))
    )
    return sections


def _parameter_rows(names: Sequence[str], covariance: np.ndarray) -> list[tuple[str, ...]]:
    deviations = np.sqrt(np.diag(covariance))
    rows: list[tuple[str, ...]] = [('parameter', 'standard deviation')]
    return rows + [(name, f'{value:.3g}') for name, value in zip(names, deviations, strict=True)]


def _table(rows: Iterable[Sequence[str]]) -> str:
    head, *body = rows
    lines = ['<table>', _row(head, 'th'), *(_row(row, 'td') for row in body), '</table>']
    return ''.join(lines)


def _row(cells: Sequence[str], tag: str) -> str:
    return '<tr>' + ''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells) + '</tr>'


def _image(png: bytes) -> str:
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def _page(title: str, next_thing: str, sections: Sequence[tuple[str, str]]) -> str:
    parts = [f'<h2>{heading}</h2>{body}' for heading, body in sections]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<style>{STYLE}</style><h1>{title}</h1>'
        f'<p class="next"><b>Next:</b> {html.escape(next_thing)}</p>{"".join(parts)}</html>\n'
    )
