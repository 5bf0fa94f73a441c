"""Judge: which of the red patches may be the target, which is it, and why not the others."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from .describe import Description
from .options import DetectorOptions
from .target import Candidate


class Judged(NamedTuple):
    """A patch, and why it is refused; the reason is empty where it may be the target."""

    description: Description
    reason: str

    def candidate(self) -> Candidate:
        """The patch as others are told of it."""
        _, outline, fit, redness, contrast, _ = self.description
        score = self.description.score
        return Candidate(outline, contrast, redness, fit, score, self.reason)


def judge(
    descriptions: Iterable[Description], threshold: float, options: DetectorOptions
) -> list[Judged]:
    """Judge patches: the best first, and those refused at the end.

    threshold is the contrast asked of a target. Of patches that are the same one the first counts.
    """
    judged: list[Judged] = []
    for each in descriptions:
        if not any(is_same(each, other.description) for other in judged):
            judged.append(Judged(each, _refusal(each, threshold, options)))
    if options.mirror_above:
        judged = _without_mirror_images(judged)
    return sorted(judged, key=lambda each: (bool(each.reason), -each.description.score))


def is_same(one: Description, other: Description) -> bool:
    """Whether two descriptions are of the same patch."""
    distance = math.dist(one.outline.centre.tolist(), other.outline.centre.tolist())
    return distance < 0.5 * min(one.outline.semi_axes[0], other.outline.semi_axes[0]) + 1


def _refusal(seen: Description, threshold: float, options: DetectorOptions) -> str:
    major, minor = seen.outline.semi_axes
    if seen.contrast < threshold:
        return f'contrast {seen.contrast:.2f} is below {threshold:.2f}'
    if seen.redness < options.min_redness:
        return f'redness {seen.redness:.2f} is below {options.min_redness:.2f}'
    if seen.cut:
        return 'cut by the edge of the image'
    if 2 * major < options.min_diameter:
        return f'diameter {2 * major:.1f} px is below {options.min_diameter:.1f} px'
    if 2 * major > options.max_diameter:
        return f'diameter {2 * major:.1f} px is above {options.max_diameter:.1f} px'
    if minor < options.min_axis_ratio * major:
        return f'axis ratio {minor / major:.2f} is below {options.min_axis_ratio:.2f}'
    if seen.fit < options.min_fit:
        return f'shape agrees with an ellipse by {seen.fit:.2f}, less than {options.min_fit:.2f}'
    return ''


def _without_mirror_images(judged: list[Judged]) -> list[Judged]:
    """Refuse whatever has a like patch below it: its own mirror image lies above a target."""
    good = [each.description for each in judged if not each.reason]
    if len(good) < 2:
        return judged
    return [
        each if each.reason else Judged(each.description, _mirrors(each.description, good))
        for each in judged
    ]


def _mirrors(upper: Description, good: list[Description]) -> str:
    below = [each for each in good if _is_mirror_image(upper, each)]
    if not below:
        return ''
    u, v = max(below, key=lambda each: each.score).outline.centre
    return f'mirror image of the patch at ({u:.0f}, {v:.0f}) below'


def _is_mirror_image(upper: Description, lower: Description) -> bool:
    du, dv = lower.outline.centre - upper.outline.centre
    size = lower.outline.semi_axes[0] * 2
    like = 0.5 < upper.outline.semi_axes[0] * 2 / size < 2
    return bool(
        like
        and dv > size
        and abs(du) < max(0.2 * dv, size)
        and lower.contrast > 0.6 * upper.contrast
    )
