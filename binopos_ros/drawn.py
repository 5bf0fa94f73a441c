"""Pictures of matplotlib as SVG whose colours are those of the page around them, light or dark.

matplotlib has no name for a colour that the reader chooses. So each is drawn in a value of its own
that nothing else has, and named in the SVG.
"""

from __future__ import annotations

import functools
import io
import re
from collections.abc import Callable
from typing import Any, ParamSpec

Of = ParamSpec('Of')

#: Colours to draw with: for words and lines, for grids, for curves, for bands to compare with.
INK, SOFT, LINE = '#010203', '#010204', '#010205'
CURVES = ('#010210', '#010211', '#010212', '#010213', '#010214', '#010215')
BAND = '#010220'
#: Of a legend; and the height of a line of words, inches.
COLUMNS, LINE_HEIGHT = 3, 0.21
_NAMES = {INK: 'ink', SOFT: 'soft', LINE: 'line', BAND: 'soft'}
_NAMES |= {value: f'c{number}' for number, value in enumerate(CURVES)}
_THEME = {
    'svg.fonttype': 'none',
    'font.size': 11.0,
    'text.color': INK,
    'axes.edgecolor': SOFT,
    'axes.labelcolor': INK,
    'axes.titlesize': 'medium',
    'axes.facecolor': 'none',
    'figure.facecolor': 'none',
    'savefig.facecolor': 'none',
    'grid.color': LINE,
    'xtick.color': SOFT,
    'xtick.labelcolor': INK,
    'ytick.color': SOFT,
    'ytick.labelcolor': INK,
    'legend.frameon': False,
}
#: What matplotlib numbers from one on in every picture; only the others are referred to.
_COUNTED = re.compile(r' id="[A-Za-z0-9.]+_\d+"')
_HEAD = re.compile(r'<svg [^>]*?viewBox="([^"]+)"[^>]*>')


def in_page_colours(draw: Callable[Of, Any]) -> Callable[Of, str]:
    """Make a function that draws a matplotlib figure give its SVG.

    Raises:
        ImportError: matplotlib is not installed.
    """

    @functools.wraps(draw)
    def drawn(*args: Of.args, **kwargs: Of.kwargs) -> str:
        from matplotlib import rc_context
        from matplotlib.rcsetup import cycler

        with rc_context({**_THEME, 'axes.prop_cycle': cycler(color=CURVES)}):
            stream = io.StringIO()
            draw(*args, **kwargs).savefig(stream, format='svg', metadata={'Date': None})
        return _themed(stream.getvalue())

    return drawn


def legend_above(figure: Any) -> None:
    """One legend of all that is named in a figure, above its axes, where it covers nothing.

    The figure has the layout 'constrained'.
    """
    named: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    rows = -(-len(named) // COLUMNS)
    if rows:
        figure.legend(named.values(), named.keys(), loc='upper center', ncols=COLUMNS)
        taken = (rows + 1) * LINE_HEIGHT / figure.get_figheight()
        figure.get_layout_engine().set(rect=(0, 0, 1, 1 - taken))


def _themed(svg: str) -> str:
    svg = svg[svg.index('<svg') :]
    svg = _HEAD.sub(r'<svg viewBox="\1">', svg, count=1)
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    for value, name in _NAMES.items():
        svg = svg.replace(value, f'var(--{name})')
    return _COUNTED.sub('', svg)
