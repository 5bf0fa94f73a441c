"""The evaluation's pictures, in the form of the paper's Figures 13, 14, 16, 17, 19, 20 and 21."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.drawn import BAND, INK, in_page_colours, legend_above
from binopos_ros.evaluation.comparison import PAPER_FILTERS, error_ranges
from binopos_ros.evaluation.paper import PAPER_CALM, PAPER_INDICES, PAPER_SALT, PAPER_WAVES
from binopos_ros.evaluation.run import Results
from binopos_ros.evaluation.trials.protocols import CONTROLS

Array = NDArray[np.float64]
MILLI = 1e3
AXES = ('x', 'y', 'z')
COMPARED = ('none', 'kalman', 'cloud-kalman')


class Figure(NamedTuple):
    """A picture with a name, its title, and what the paper's shows."""

    name: str
    title: str
    paper: str
    svg: str


def figures(results: Results) -> list[Figure]:
    """All pictures of an evaluation.

    Raises:
        ImportError: matplotlib is not installed.
    """
    return [
        Figure(name, title, paper, _drawn(draw, results))
        for name, title, paper, draw in (
            ('figure_13', 'Errors at one place, calm water', 'errors within 4 mm', _figure_13),
            ('figure_14', 'Errors at all places, calm water', 'errors within 4 mm', _figure_14),
            ('figure_16', 'Errors in salt water', 'errors within 0.37 mm', _figure_16),
            ('figure_17', 'Mean refractive index', 'indices from 1.33 to 1.52', _figure_17),
            (
                'figure_19',
                'Errors under waves, one experiment',
                'within 3.3 mm unfiltered and Kalman, 2.5 mm cloud-Kalman',
                _figure_19,
            ),
            (
                'figure_20',
                'Error ranges under waves, all experiments',
                'Kalman 10.67 % below no filter, cloud-Kalman 23.34 % below Kalman',
                _figure_20,
            ),
            (
                'figure_21',
                "Error range by control parameter, the paper's variant",
                'smallest at a control parameter of 1',
                _figure_21,
            ),
            ('filters', 'RMS of all filters on unseen sequences', 'not in the paper', _filters),
        )
    ]


@in_page_colours
def _drawn(draw: Callable[[Any, Results], None], results: Results) -> Any:
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(9.0, 4.2), layout='constrained')
    draw(canvas, results)
    legend_above(canvas)
    return canvas


def _figure_13(canvas: Any, results: Results) -> None:
    errors = {'refracted rays': results.transforming['refractive'][0]}
    _three_axes(canvas, errors, 'pair (number)', PAPER_CALM)


def _figure_14(canvas: Any, results: Results) -> None:
    errors = {method: results.transforming[method][:, 0] for method in ('refractive', 'paper')}
    _three_axes(canvas, errors, 'experiment (number)', PAPER_CALM)


def _figure_16(canvas: Any, results: Results) -> None:
    _three_axes(canvas, results.salted.errors, 'experiment (number)', PAPER_SALT)


def _figure_17(canvas: Any, results: Results) -> None:
    salt = results.salted
    axes = canvas.subplots()
    number = np.arange(1, len(salt.truth) + 1)
    axes.fill_between(
        number,
        salt.estimate - 2 * salt.index_std,
        salt.estimate + 2 * salt.index_std,
        alpha=0.25,
        linewidth=0,
        label='two stated deviations',
    )
    axes.axhspan(*PAPER_INDICES, color=BAND, alpha=0.15, linewidth=0, label="the paper's indices")
    axes.plot(number, salt.estimate, label='estimated')
    axes.plot(number, salt.truth, '--', color=INK, label='true mean')
    axes.set(xlabel='experiment (number)', ylabel='refractive index (no unit)')
    axes.grid()


def _figure_19(canvas: Any, results: Results) -> None:
    # The experiment whose waves are the median ones.
    spread = error_ranges(results.fluctuating['none']).mean(axis=1)
    chosen = np.argsort(spread)[len(spread) // 2]
    errors = {PAPER_FILTERS[name]: results.fluctuating[name][chosen] for name in COMPARED}
    _three_axes(canvas, errors, 'pair (number)', PAPER_WAVES['cloud-kalman'], PAPER_WAVES['none'])


def _figure_20(canvas: Any, results: Results) -> None:
    ranges = {PAPER_FILTERS[name]: error_ranges(results.fluctuating[name]) for name in COMPARED}
    for axes, (label, values) in _each(canvas, ranges):
        axes.plot(np.arange(1, len(values) + 1), MILLI * values, label=label, linewidth=0.9)
        axes.set_yscale('log')
    for axes in canvas.axes:
        for half, style in ((PAPER_WAVES['none'], '--'), (PAPER_WAVES['cloud-kalman'], ':')):
            words = f"the paper's range, {2 * half:g} mm"
            axes.axhline(2 * half, color=BAND, linestyle=style, label=words)
        axes.set(xlabel='experiment (number)', ylabel='error range (mm)')


def _figure_21(canvas: Any, results: Results) -> None:
    axes = canvas.subplots()
    ranges = MILLI * np.ptp(results.controls, axis=2)
    for number, name in enumerate(AXES):
        axes.plot(CONTROLS, ranges[:, :, number].mean(axis=1), 'o-', label=name, markersize=3)
    axes.axvline(1.0, color=BAND, linestyle='--', label="the paper's smallest")
    axes.set(xlabel='control parameter (no unit)', ylabel='mean error range (mm)', yscale='log')
    axes.grid()


def _filters(canvas: Any, results: Results) -> None:
    axes = canvas.subplots()
    order = sorted(results.mixed, key=lambda name: float(results.mixed[name].rms.mean()))
    rows = np.arange(len(order))
    values = np.array([MILLI * results.mixed[name].rms for name in order])
    low, quarter, middle, three_quarters, high = np.percentile(values, (5, 25, 50, 75, 95), axis=1)
    axes.hlines(rows, low, high, color='C0', linewidth=1)
    axes.hlines(rows, quarter, three_quarters, color='C0', linewidth=6, alpha=0.5)
    axes.plot(middle, rows, '|', color=INK, markersize=9)
    axes.set_yticks(rows, order)
    axes.invert_yaxis()
    axes.set(xlabel='RMS error (mm): median, quartiles (bar), 5 and 95 % (line)', xscale='log')


def _three_axes(canvas: Any, errors: dict[str, Array], label: str, *bands: float) -> None:
    """Errors (N, 3) in m over their number, one picture per axis, with the paper's bands (mm)."""
    for axes, (name, values) in _each(canvas, errors):
        axes.plot(np.arange(1, len(values) + 1), MILLI * values, label=name, linewidth=0.9)
    for axes in canvas.axes:
        for half in bands:
            words = f"the paper's band, \u00b1{half:g} mm"
            axes.axhspan(-half, half, color=BAND, alpha=0.15, linewidth=0, label=words)
        axes.set(xlabel=label, ylabel='error (mm)')


def _each(canvas: Any, values: dict[str, Array]) -> Iterator[tuple[Any, tuple[str, Array]]]:
    """Every axis with every named (N, 3) array's column for it."""
    for number, axes in enumerate(canvas.subplots(1, 3)):
        axes.set_title(AXES[number])
        axes.grid()
        for name, array in values.items():
            yield axes, (name, array[:, number])
