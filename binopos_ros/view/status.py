"""What there is to see in one line of text, for a terminal or a log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from binopos_ros.view.screen import STALE

#: Two blanks: a terminal of 80 columns is to hold all figures.
GAP = '  '
MILLI = 1e3


def status_text(numbers: Mapping[str, Any]) -> str:
    """The figures out of `Screen.numbers` as one line, the health first; what is old is left out.

    Positions (x, y, z) are in m, their deviations in mm.
    """
    health, pose, age = numbers['health'], numbers['pose'], numbers['age']
    told = health['word'] or ('health unknown' if pose else 'nothing heard of the nodes yet')
    if health['reason']:
        told = f'{told}: {health["reason"]}'
    parts = [told]
    if pose is not None:
        rate = numbers['rate']
        parts += [f'{rate:.{0 if rate >= 10 else 1}f}/s', f'{age:.1f} s old']
        if age < STALE:
            place = ' '.join(f'{each:.4f}' for each in pose['position'])
            parts.append(f'{place} m {_deviations(pose["deviation"])}')
    lost = numbers['lost']
    if lost:
        # The most frequent is the first.
        count, most = sum(each['count'] for each in lost), lost[0]['reason']
        parts.append(f'{count} dropped{", most" if len(lost) > 1 else ""}: {most}')
    return GAP.join(parts)


def _deviations(metres: list[float]) -> str:
    shown = (f'{each:.2f}' if each < 1 else f'{each:.1f}' for each in np.array(metres) * MILLI)
    return f'\u00b1{" ".join(shown)} mm'
