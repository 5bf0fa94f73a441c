"""Drawings in SVG whose colours are those of the page around them, light or dark."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 720, 190
LEFT, RIGHT, TOP, BOTTOM = 64, 8, 8, 34
BAND_95 = 1.96
#: Points of a curve, more than a screen has.
MOST_POINTS = 1500
#: s; a line across a longer gap would show what nobody measured.
GAP = 1.0


def curve(
    name: str,
    unit: str,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    deviations: NDArray[np.float64],
) -> str:
    """Values (N,) over times (N,), s, with the band of 95 % about them.

    Returns:
        The drawing, with both axes and their units.
    """
    step = -(-len(times) // MOST_POINTS)
    times, values, deviations = times[::step], values[::step], deviations[::step] * BAND_95
    low, high = float(np.min(values - deviations)), float(np.max(values + deviations))
    middle, half = (low + high) / 2, max((high - low) / 2, 1e-4) * 1.05
    axis_x = _Axis(
        float(times[0]), max(float(times[-1]), float(times[0]) + 1e-3), LEFT, WIDTH - RIGHT
    )
    axis_y = _Axis(middle - half, middle + half, HEIGHT - BOTTOM, TOP)
    parts = [_grid(axis_x, axis_y, 'time (s)', f'{name} ({unit})')]
    breaks = np.flatnonzero(np.diff(times) > GAP * step) + 1
    for run in np.split(np.arange(len(times)), breaks):
        x, v, d = axis_x(times[run]), values[run], deviations[run]
        band = _points(np.r_[x, x[::-1]], np.r_[axis_y(v + d), axis_y(v - d)[::-1]])
        parts.append(f'<polygon class="band" points="{band}"/>')
        parts.append(f'<polyline class="line" points="{_points(x, axis_y(v))}"/>')
    return _drawing(f'{name} over time, with the band of 95 %', WIDTH, HEIGHT, parts)


def path(name: str, unit: str, axes: tuple[str, str], places: NDArray[np.float64]) -> str:
    """A path (N, 2) seen from one side, to scale, from its beginning (ring) to its end (disc)."""
    size = HEIGHT * 2
    step = -(-len(places) // MOST_POINTS)
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    half = max(float(np.max(np.ptp(places, axis=0))) / 2, 1e-3) * 1.1
    axis_x = _Axis(middle[0] - half, middle[0] + half, LEFT, LEFT + size)
    axis_y = _Axis(middle[1] - half, middle[1] + half, TOP + size, TOP)
    drawn = places[::step]
    x, y = axis_x(drawn[:, 0]), axis_y(drawn[:, 1])
    parts = [
        _grid(axis_x, axis_y, f'{axes[0]} ({unit})', f'{axes[1]} ({unit})'),
        f'<polyline class="line" points="{_points(x, y)}"/>',
        f'<circle class="begin" cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="6"/>',
        f'<circle class="end" cx="{x[-1]:.1f}" cy="{y[-1]:.1f}" r="4"/>',
    ]
    return _drawing(name, LEFT + size + RIGHT, TOP + size + BOTTOM, parts)


def words(spans: Sequence[tuple[float, float, str]], start: float, end: float) -> str:
    """Which word held when: spans (from, to, word), s."""
    axis = _Axis(start, max(end, start + 1e-3), LEFT, WIDTH - RIGHT)
    parts = []
    for begin, finish, word in spans:
        x, width = axis(begin), max(axis(finish) - axis(begin), 0.5)
        title = html.escape(f'{word}: {begin - start:.1f} to {finish - start:.1f} s')
        parts.append(
            f'<rect class="{html.escape(word)}" x="{x:.1f}" y="4" width="{width:.1f}" '
            f'height="22"><title>{title}</title></rect>'
        )
    return _drawing('Health of the target over time', WIDTH, 30, parts)


class _Axis:
    """Values between two ends, to places between two others."""

    def __init__(self, low: float, high: float, first: float, last: float) -> None:
        self.low, self.high, self.first, self.last = low, high, first, last

    def __call__(self, value):  # type: ignore[no-untyped-def]
        share = (value - self.low) / (self.high - self.low)
        return self.first + share * (self.last - self.first)

    def ticks(self) -> list[float]:
        """Some round values."""
        raw = (self.high - self.low) / 4
        unit = 10.0 ** np.floor(np.log10(raw))
        step = unit * min((f for f in (1, 2, 5, 10) if f * unit >= raw), default=10)
        first = np.ceil(self.low / step) * step
        # Not -0.
        return [round(x, 9) + 0.0 for x in np.arange(first, self.high + step / 1e6, step)]


def _grid(axis_x: _Axis, axis_y: _Axis, name_x: str, name_y: str) -> str:
    lines = []
    for value in axis_x.ticks():
        x = axis_x(value)
        lines.append(f'<path class="grid" d="M{x:.1f} {axis_y.first}V{axis_y.last}"/>')
        lines.append(f'<text x="{x:.1f}" y="{axis_y.first + 13}" class="x">{value:.6g}</text>')
    for value in axis_y.ticks():
        y = axis_y(value)
        lines.append(f'<path class="grid" d="M{axis_x.first} {y:.1f}H{axis_x.last}"/>')
        lines.append(f'<text x="{axis_x.first - 4}" y="{y + 4:.1f}" class="y">{value:.6g}</text>')
    x, y = (axis_x.first + axis_x.last) / 2, (axis_y.first + axis_y.last) / 2
    lines.append(f'<text x="{x}" y="{axis_y.first + 28}" class="x">{html.escape(name_x)}</text>')
    lines.append(
        f'<text transform="translate(12 {y}) rotate(-90)" class="x">{html.escape(name_y)}</text>'
    )
    return ''.join(lines)


def _points(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    return ' '.join(f'{a:.1f},{b:.1f}' for a, b in zip(x, y, strict=True))


def _drawing(title: str, width: float, height: float, parts: Sequence[str]) -> str:
    return (
        f'<svg role="img" viewBox="0 0 {width:g} {height:g}" aria-label="{html.escape(title)}">'
        f'{"".join(parts)}</svg>'
    )
