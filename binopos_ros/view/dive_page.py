"""A dive's report: one HTML file that needs nothing beside it, to hand to a client."""

from __future__ import annotations

import base64
import html

import numpy as np

from binopos_ros.sheet import Made, sheet, table, utc
from binopos_ros.view.drawing import curve, path, words
from binopos_ros.view.story import Story

AXES = ('x', 'y', 'z')
STYLE = """
svg{display:block;width:100%;height:auto}svg text{fill:var(--soft);font:11px system-ui,sans-serif}
.x{text-anchor:middle}.y{text-anchor:end}.grid{stroke:var(--line);fill:none}
.line{fill:none;stroke:var(--c0);stroke-width:1.6}.band{fill:var(--c0);opacity:.25}
.begin{fill:none;stroke:var(--ink);stroke-width:2}.end{fill:var(--alarm)}
rect.tracking{fill:var(--good)}rect.coasting,rect.starting{fill:var(--note)}
rect.degraded{fill:var(--warning)}rect.lost{fill:var(--alarm)}
.paths{display:grid;grid-template-columns:repeat(auto-fit,minmax(16em,1fr));gap:1em}
.event{display:flex;flex-wrap:wrap;gap:1em;padding:.6em 0;border-top:1px solid var(--line)}
.event img{width:160px;height:auto}.event div{flex:1 1 16em}
.good{color:var(--good)}.note{color:var(--note)}.warning{color:var(--warning)}.alarm{color:var(--alarm)}
"""


def dive_page(story: Story, made: Made) -> str:
    """The page about a dive, and how it was made."""
    body = [
        _summary(story),
        *(_curves(story) if len(story.stamps) else ['<p>No pose in these bags.</p>']),
        _health(story),
        _events(story),
        _drops(story),
    ]
    return sheet(f'Dive of {utc(story.start)}', body, made, STYLE)


def _summary(story: Story) -> str:
    rows = [
        ('duration', f'{story.end - story.start:.1f} s'),
        ('poses', f'{len(story.stamps)}'),
        ('dropped', f'{sum(count for *_, count in story.drops)}'),
    ]
    if len(story.stamps):
        worst = np.median(story.deviations.max(axis=1)), story.deviations.max()
        rows += [
            ('frame', story.frame or 'the rig'),
            ('length of the path', f'{story.length:.3f} m'),
            (
                'deviation along the worst axis, median and largest',
                f'{worst[0] * 1000:.2f} mm, {worst[1] * 1000:.2f} mm',
            ),
        ]
    held = _held(story)
    rows += [(f'time {word}', f'{seconds:.1f} s') for word, seconds in held.items()]
    return f'<h2>In short</h2>{table(rows)}'


def _curves(story: Story) -> list[str]:
    times = story.stamps - story.stamps[0]
    is_rig = 'optical' in story.frame or not story.frame
    # In the rig's frame z is ahead and y down; in a fixed one z is up.
    plan, side = ((0, 2, 1), (2, 1, -1)) if is_rig else ((0, 1, 1), (0, 2, 1))
    views = []
    for title, (right, up, sign) in (('From above', plan), ('From the side', side)):
        places = story.positions[:, [right, up]] * (1, sign)
        name_up = AXES[up] if sign > 0 else f'-{AXES[up]}'
        drawn = path(f'{title}, to scale', 'm', (AXES[right], name_up), places)
        views.append(f'<figure><figcaption>{title}, to scale</figcaption>{drawn}</figure>')
    curves = [
        curve(name, 'm', times, story.positions[:, n], story.deviations[:, n])
        for n, name in enumerate(AXES)
    ]
    return [
        '<h2>Path</h2><p>Ring: the beginning. Disc: the end.</p>',
        f'<div class="paths">{"".join(views)}</div>',
        '<h2>Position</h2><p>With the band in which it lies by 95 %, by its own deviations.</p>',
        *curves,
    ]


def _health(story: Story) -> str:
    if not story.health:
        return ''
    drawn = words(_spans(story), story.start, story.end)
    named = ', '.join(f'{word} {seconds:.1f} s' for word, seconds in _held(story).items())
    return f'<h2>Health of the target</h2>{drawn}<p>{html.escape(named)}</p>'


def _spans(story: Story) -> list[tuple[float, float, str]]:
    ends = [*(begin for begin, _ in story.health[1:]), story.end]
    return [(begin, end, word) for (begin, word), end in zip(story.health, ends, strict=True)]


def _held(story: Story) -> dict[str, float]:
    held: dict[str, float] = {}
    for begin, end, word in _spans(story):
        held[word] = held.get(word, 0.0) + end - begin
    return held


def _events(story: Story) -> str:
    if not story.events:
        return '<h2>What happened</h2><p>Nothing.</p>'
    told = []
    for event, jpeg in story.events:
        picture = ''
        if jpeg:
            data = base64.b64encode(jpeg).decode('ascii')
            picture = f'<img alt="left picture then" src="data:image/jpeg;base64,{data}">'
        remedy = f'<br>→ {html.escape(event.remedy)}' if event.remedy else ''
        told.append(
            f'<div class="event">{picture}<div><b class="{event.grade}">{html.escape(event.about)}'
            f'</b> after {event.wall - story.start:.1f} s: {html.escape(event.text)}{remedy}'
            '</div></div>'
        )
    return f'<h2>What happened</h2>{"".join(told)}'


def _drops(story: Story) -> str:
    rows = [(f'{node}: {reason}', f'{count}') for node, reason, count in story.drops]
    return f'<h2>What gave no result</h2>{table(rows)}' if rows else ''
