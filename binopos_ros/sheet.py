"""Reports as one HTML file that needs nothing beside it: light and dark, on a phone, printed."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from typing import NamedTuple

from binopos_ros import __version__

#: The colours are those of the operator's page; --c0 and on are those of curves.
STYLE = """
:root{color-scheme:light dark;--ground:#fff;--sheet:#f1f3f6;--ink:#11161c;--soft:#47505b;
--line:#c5ccd4;--good:#0b6b2e;--note:#1d4f91;--warning:#8a4b00;--alarm:#b00020;
--c0:#1f4fbf;--c1:#b3261e;--c2:#1b6e2c;--c3:#7b3fa0;--c4:#8a4b00;--c5:#00707a}
@media(prefers-color-scheme:dark){:root{--ground:#0b0f14;--sheet:#161c24;--ink:#f2f5f8;
--soft:#b6c0cb;--line:#3a4450;--good:#58d68d;--note:#8ab8ff;--warning:#ffb454;--alarm:#ff8a80;
--c0:#8ab8ff;--c1:#ff8a80;--c2:#6fdc8c;--c3:#d3a4ff;--c4:#ffb454;--c5:#5fd9e3}}
body{background:var(--ground);color:var(--ink);font:16px/1.5 system-ui,sans-serif;max-width:70em;
margin:0 auto;padding:1em;overflow-wrap:anywhere}
h2{margin:1.6em 0 .4em}p{max-width:48em}a{color:var(--note)}
.scroll{overflow-x:auto}table{border-collapse:collapse}
th,td{text-align:left;padding:.2em 1.2em .2em 0;border-bottom:1px solid var(--line);
vertical-align:top;overflow-wrap:normal}
.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
.soft,footer{color:var(--soft)}footer{margin-top:2em;border-top:1px solid var(--line)}
.next{background:var(--sheet);padding:1em;border-left:.4em solid var(--note);max-width:none}
.drawing svg{display:block;width:100%;min-width:44em;max-width:64em;height:auto}
@media print{.scroll{overflow:visible}.drawing svg{min-width:0}}
"""
FIGURE = ' class="n"'


class Made(NamedTuple):
    """How a report was made."""

    command: str = ''
    inputs: Sequence[str] = ()  #: each with what tells it from another


def sheet(title: str, body: Iterable[str], made: Made, style: str = '') -> str:
    """A whole report.

    Args:
        title: in words.
        body: its parts, as HTML.
        made: told at its end, with the version and the time.
        style: what goes beyond `STYLE`.
    """
    words = html.escape(title)
    now = datetime.now(timezone.utc)
    inputs = ''.join(f'<li>{html.escape(each)}</li>' for each in made.inputs)
    command = f': <code>{html.escape(made.command)}</code>' if made.command else ''
    parts = [
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<title>{words}</title><style>{STYLE}{style}</style></head><body><main>',
        f'<h1>{words}</h1>',
        *body,
        '</main><footer><h2>How this was made</h2>',
        f'<p>binopos_ros {__version__}, {utc(now.timestamp())}{command}</p>',
        f'<ul>{inputs}</ul>' if inputs else '',
        '</footer></body></html>\n',
    ]
    return '\n'.join(parts)


def table(rows: Iterable[Sequence[object]], head: Sequence[str] = ()) -> str:
    """The HTML of a table, whose figures stand to the right; cells are told by `str`."""
    lines = []
    if head:
        lines.append(''.join(f'<th scope="col">{html.escape(cell)}</th>' for cell in head))
    for first, *rest in rows:
        cells = ''.join(
            f'<td{FIGURE if _is_figure(cell) else ""}>{html.escape(str(cell))}</td>'
            for cell in rest
        )
        lines.append(f'<th scope="row">{html.escape(str(first))}</th>{cells}')
    body = ''.join(f'<tr>{line}</tr>' for line in lines)
    return f'<div class="scroll" tabindex="0"><table>{body}</table></div>'


def drawing(svg: str, label: str) -> str:
    """A drawing that is moved aside on a phone, not made too small to read."""
    named = svg.replace('<svg ', f'<svg role="img" aria-label="{html.escape(label)}" ', 1)
    return f'<div class="scroll drawing" tabindex="0">{named}</div>'


def utc(seconds: float) -> str:
    """A time since the epoch (s) in words."""
    return datetime.fromtimestamp(seconds, timezone.utc).strftime('%Y-%m-%d %H:%M:%S UTC')


def _is_figure(cell: object) -> bool:
    return str(cell)[:1] in '-+0123456789' and str(cell) != ''
