"""The report's pictures, as SVG. matplotlib is optional: without it there are none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment
from binopos_ros.calibration.check.epipolar import epipolar_residuals
from binopos_ros.calibration.report.accuracy import AccuracyMap
from binopos_ros.calibration.report.prediction import ErrorMap
from binopos_ros.calibration.views.pairs import CELLS, coverage
from binopos_ros.calibration.views.view import View
from binopos_ros.drawn import INK, in_page_colours, legend_above
from binopos_ros.sides import SIDES

CELLS_OF_RESIDUALS = (16, 12)
MOST_NAMES = 25
#: More are drawn as one image: each would be an element of the page.
MOST_DOTS = 3000


def available() -> bool:
    """Whether pictures can be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        return False
    return True


@in_page_colours
def residual_maps(fit: Adjustment, views: Sequence[View]) -> Any:
    """Mean residual vectors over each camera's picture: arrows in order are a lens misfit."""
    figure, axes = _figure(len(fit.state.cameras), 5.6, 4.4)
    # An arrow of a mean of the points' noise, as it is where nothing is amiss, is short but seen.
    key = float(min((0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0), key=lambda k: abs(k - fit.sigma)))
    for side, axis in enumerate(axes):
        width, height = fit.state.cameras[side].size
        pixels = np.concatenate([view.pixels[side] for view in views])
        residuals = np.concatenate([one[side] for one in fit.residuals])
        good = np.concatenate([one[side] for one in fit.inliers])
        good &= np.isfinite(pixels).all(axis=1)
        columns, rows = CELLS_OF_RESIDUALS
        cell = np.clip(
            (pixels[good, 1] * rows / height).astype(int), 0, rows - 1
        ) * columns + np.clip((pixels[good, 0] * columns / width).astype(int), 0, columns - 1)
        count = np.bincount(cell, minlength=rows * columns)
        mean = (
            np.stack(
                [np.bincount(cell, residuals[good, i], rows * columns) for i in (0, 1)], axis=1
            )
            / np.maximum(count, 1)[:, None]
        )
        filled = count > 2
        u = (np.arange(columns * rows) % columns + 0.5) * width / columns
        v = (np.arange(columns * rows) // columns + 0.5) * height / rows
        arrows = axis.quiver(
            u[filled],
            v[filled],
            mean[filled, 0],
            mean[filled, 1],
            angles='xy',
            scale_units='xy',
            scale=2.0 * key * columns / width,
            color='C1',
            width=0.004,
        )
        axis.quiverkey(arrows, 0.86, 1.03, key, f'{key:g} px', labelpos='E')
        _as_picture(axis, width, height, f'{SIDES[side]}: mean residuals')
    return figure


@in_page_colours
def per_view(fit: Adjustment, views: Sequence[View]) -> Any:
    """Reprojection RMS of each view, camera by camera."""
    figure, (axis,) = _figure(1, 10.0, 3.4)
    places = np.arange(len(views))
    sides = len(fit.state.cameras)
    for side in range(sides):
        values = [fit.rms(view=i, side=side) for i in range(len(views))]
        axis.bar(places + 0.4 * (side - 0.5 * (sides - 1)), values, 0.4, label=SIDES[side])
    axis.axhline(fit.rms(), color=INK, linewidth=0.8, linestyle='--', label='all')
    axis.set(xlabel='view', ylabel='RMS (px)')
    if len(views) <= MOST_NAMES:
        axis.set_xticks(places, _short_names(views), rotation=60)
    axis.set_xlim(-0.6, len(views) - 0.4)
    legend_above(figure)
    return figure


@in_page_colours
def coverages(fit: Adjustment, views: Sequence[View]) -> Any:
    """How many points fell where: empty cells were never visited."""
    figure, axes = _figure(len(fit.state.cameras), 5.6, 4.4)
    for side, axis in enumerate(axes):
        width, height = fit.state.cameras[side].size
        counts = coverage(np.concatenate([view.pixels[side] for view in views]), (width, height))
        shown = np.where(counts > 0, counts, np.nan)
        image = axis.imshow(shown, extent=(0, width, height, 0), cmap='viridis', vmin=0)
        figure.colorbar(image, ax=axis, shrink=0.7, label='points (number)')
        empty = int(np.sum(counts == 0))
        title = f'{SIDES[side]}: {empty} of {CELLS[0] * CELLS[1]} cells empty'
        _as_picture(axis, width, height, title)
    return figure


@in_page_colours
def epipolar(fit: Adjustment, views: Sequence[View]) -> Any:
    """How far the two rays of each point miss each other, over the left picture."""
    figure, axes = _figure(2, 5.6, 4.4)
    pixels, values = [], []
    for view, pose, residuals in zip(views, fit.poses, fit.residuals, strict=True):
        four = np.concatenate(residuals, axis=1)
        both = np.isfinite(four).all(axis=1) & np.isfinite(view.pixels[0]).all(axis=1)
        if both.any():
            points = pose.apply(view.points[both])
            values.append(epipolar_residuals(fit.state, points, four[both])[0])
            pixels.append(view.pixels[0][both])
    value, place = np.concatenate(values), np.concatenate(pixels)
    reach = max(3.0 * float(np.std(value)), 1e-6)
    dots = axes[0].scatter(
        *place.T,
        c=value,
        s=8,
        cmap='coolwarm',
        vmin=-reach,
        vmax=reach,
        rasterized=len(place) > MOST_DOTS,
    )
    figure.colorbar(dots, ax=axes[0], shrink=0.7, label='residual (px)')
    _as_picture(axes[0], *fit.state.cameras[0].size, 'epipolar residual along the rays')
    axes[1].hist(np.clip(value, -reach, reach), bins=41)
    axes[1].set_title(f'mean {value.mean():+.3f} px, scatter {value.std():.3f} px')
    axes[1].set(xlabel='residual (px)', ylabel='points (number)')
    return figure


@in_page_colours
def predicted(errors: ErrorMap) -> Any:
    """Predicted standard deviation of a position over the working volume."""
    figure, axes = _figure(2, 5.6, 4.4)
    extent = (*1000 * errors.x[[0, -1]], *1000 * errors.z[[0, -1]])
    titles = ('a target seen to 0.1 px', 'from the calibration alone')
    for axis, values, title in zip(axes, (errors.total, errors.calibration), titles, strict=True):
        image = axis.imshow(
            1000 * values, extent=extent, origin='lower', aspect='auto', cmap='viridis', vmin=0
        )
        figure.colorbar(image, ax=axis, label='standard deviation (mm)')
        axis.set(
            xlabel='x, to the right (mm)', ylabel='z, away from the cameras (mm)', title=title
        )
    return figure


@in_page_colours
def accuracy(found: AccuracyMap) -> Any:
    """Deviations of a position, along and across, with the calibration's errors and without."""
    figure, axes = _figure(2, 5.6, 8.0, rows=2)
    extent = (*found.x[[0, -1]], *found.z[[0, -1]])
    whole, exact = found.whole, found.exact
    maps = (whole.along, whole.across, exact.along, exact.across)
    titles = (
        'along the line of sight',
        'across',
        'along, of a rig known exactly',
        'across, of a rig known exactly',
    )
    for i, (axis, values, title) in enumerate(zip(axes, maps, titles, strict=True)):
        # The two of a column share their colours, so that they compare at a glance.
        top = 1000 * float(np.nanmax(maps[i % 2]))
        image = axis.imshow(
            1000 * values, extent=extent, origin='lower', aspect='auto', vmin=0, vmax=top
        )
        figure.colorbar(image, ax=axis, label='standard deviation (mm)')
        axis.set(xlabel='x, to the right (m)', ylabel='z, away from the cameras (m)', title=title)
    return figure


def _short_names(views: Sequence[View]) -> list[str]:
    """The left picture's name; of a bag, whose views bear stamps, the seconds since the first."""
    names = [view.name.split('|')[0] for view in views]
    try:
        stamps = [float(name) for name in names]
    except ValueError:
        return names
    return [f'{stamp - stamps[0]:.1f} s' for stamp in stamps]


def _figure(columns: int, width: float, height: float, rows: int = 1) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * width, height), layout='constrained')
    return figure, list(np.ravel(figure.subplots(rows, columns)))


def _as_picture(axis: Any, width: int, height: int, title: str) -> None:
    axis.set(
        xlim=(0, width),
        ylim=(height, 0),
        aspect='equal',
        title=title,
        xlabel='u (px)',
        ylabel='v (px)',
    )
