"""How large a target looks where it is: whether what both cameras saw can be it.

Two patches of which one is no target meet somewhere too; there a target of known diameter would
look larger or smaller.
"""

from __future__ import annotations

from collections.abc import Sequence

from binopos_ros.sides import SIDES

MOST_OFF = 1.5
"""Largest factor between the two: blur, a hidden part and a diameter that is given in round
numbers make up less."""


def other_size(expected: Sequence[float], seen: Sequence[float], diameter: float) -> str:
    """Why what was seen is not a target of that size, or '' where it may be.

    Args:
        expected: how far across the target would look in each camera, px.
        seen: what was seen there, px; 0 where a detector tells none.
        diameter: of the target, m.
    """
    for side, would, across in zip(SIDES, expected, seen, strict=True):
        if across > 0 and not would / MOST_OFF <= across <= would * MOST_OFF:
            return (
                f'{side}: {across:.1f} px across, where a target of {diameter:g} m would look '
                f'{would:.1f} px'
            )
    return ''
