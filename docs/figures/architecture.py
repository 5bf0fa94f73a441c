"""The rooms and what each imports, as a picture: `python docs/figures/architecture.py`.

Drawn from the imports as they are, not as they should be. A room stands above all that it imports;
an arrow that follows from others is left out.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test'))

from test_architecture import BELOW, OWN, module_of, room_of

PICTURE = Path(__file__).with_suffix('.svg')

WIDTH, HEIGHT = 118, 34
ACROSS, UP = 136, 84
MARGIN = 16
STYLE = 'font-family="sans-serif" font-size="14" text-anchor="middle"'


def imports() -> dict[str, set[str]]:
    """Which rooms each room imports, without what lies below them all."""
    found: dict[str, set[str]] = {}
    for one in OWN:
        own, other = room_of(module_of(one.file)), room_of(one.module)
        if not {own, other} & (BELOW | {'', '__main__'}):
            found.setdefault(own, set())
            found.setdefault(other, set())
            if own != other:
                found[own].add(other)
    return found


def reach(graph: Mapping[str, set[str]], room: str) -> set[str]:
    """All that a room imports, by way of others too."""
    return set().union(*({other} | reach(graph, other) for other in graph[room]))


def floor(graph: Mapping[str, set[str]], room: str) -> int:
    """How many rooms lie above one another below this one."""
    return max((1 + floor(graph, other) for other in graph[room]), default=0)


def drawn(graph: Mapping[str, set[str]]) -> str:
    """The picture as SVG."""
    floors: dict[int, list[str]] = {}
    for room in sorted(graph):
        floors.setdefault(floor(graph, room), []).append(room)
    widest, top = max(map(len, floors.values())), max(floors)
    size = (widest * ACROSS + 2 * MARGIN, top * UP + HEIGHT + 2 * MARGIN)
    at = {
        room: (
            MARGIN + (i + (widest - len(rooms)) / 2 + 0.5) * ACROSS,
            MARGIN + (top - level) * UP,
        )
        for level, rooms in floors.items()
        for i, room in enumerate(rooms)
    }
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}" {STYLE}>',
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7"'
        ' markerHeight="7" orient="auto"><path d="M0,0 8,4 0,8z" fill="#777"/></marker></defs>',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for room, others in sorted(graph.items()):
        for other in sorted(others):
            if any(other in reach(graph, between) for between in others):
                continue
            (x, y), (u, v) = at[room], at[other]
            lines.append(
                f'<line x1="{x:g}" y1="{y + HEIGHT:g}" x2="{u:g}" y2="{v:g}" stroke="#777"'
                ' marker-end="url(#head)"/>'
            )
    for room, (x, y) in sorted(at.items()):
        lines += [
            f'<rect x="{x - WIDTH / 2:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="5"'
            ' fill="#eaf1f8" stroke="#4a6f94"/>',
            f'<text x="{x:g}" y="{y + 22:g}">{room}</text>',
        ]
    return '\n'.join([*lines, '</svg>', ''])


if __name__ == '__main__':
    PICTURE.write_text(drawn(imports()), encoding='utf-8')
