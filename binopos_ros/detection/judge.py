"""Judge: which of the red patches may be the target, which is it, and why not the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

from .colour import fullest
from .describe import Description
from .options import DetectorOptions
from .target import Candidate

WHITE = 0.15
"""Least saturation, 1 - least channel / largest, of what is not white: a glint or a lamp."""

FLAT_SHARE, ROUGHNESS = 0.15, 0.3
"""A flat outline must be an ellipse more surely than a round one: it may disagree by so much of
its axis ratio, and by so many pixels along its minor axis that raggedness takes."""

LEAST_OF_CUT = 0.65
"""Least share of an outline to be seen where the image cuts it: beyond may be anything."""

ROUND = 0.7
"""Smallest axis ratio of a ball's outline."""


class Judged(NamedTuple):
    """A patch, what it is ranked by, and why it is refused.

    The reason is empty where it may be the target.
    """

    description: Description
    score: float
    reason: str

    def candidate(self) -> Candidate:
        """The patch as others are told of it."""
        seen = self.description
        return Candidate(
            seen.outline, seen.contrast, seen.redness, seen.fit, self.score, self.reason
        )


def judge(descriptions: Iterable[Description], options: DetectorOptions) -> list[Judged]:
    """Judge patches: the best first, and those refused at the end.

    Of patches that are the same one the first counts.
    """
    judged: list[Judged] = []
    for each in descriptions:
        if not any(is_same(each, other.description) for other in judged):
            reason = _refusal(each, options)
            judged.append(Judged(each, _score(each, options), reason))
    if options.mirror_above:
        judged = _without_mirror_images(judged)
    return _ranked(judged)


def refused(judged: Iterable[Judged], why: Callable[[Description], str]) -> list[Judged]:
    """Refuse, of patches that may be the target, those that there is a reason against."""
    return _ranked(
        each if each.reason else each._replace(reason=why(each.description)) for each in judged
    )


def _ranked(judged: Iterable[Judged]) -> list[Judged]:
    return sorted(judged, key=lambda each: (bool(each.reason), -each.score))


def is_same(one: Description, other: Description) -> bool:
    """Whether two descriptions are of the same patch."""
    distance = math.dist(one.outline.centre.tolist(), other.outline.centre.tolist())
    return distance < 0.5 * min(one.outline.semi_axes[0], other.outline.semi_axes[0]) + 1


def _score(seen: Description, options: DetectorOptions) -> float:
    """What a patch is ranked by: how much it stands out, and how like a red target it is."""
    major, minor = seen.outline.semi_axes
    score = (
        seen.contrast * seen.fit**4 * math.sqrt(major * minor) * (1 - min(abs(seen.hue.tint), 1))
    )
    return score if options.target.shape == 'disc' else score * minor / major


def _refusal(seen: Description, options: DetectorOptions) -> str:
    major, minor = seen.outline.semi_axes
    threshold = seen.sighting.threshold
    if seen.contrast < threshold:
        return f'contrast {seen.contrast:.2f} is below {threshold:.2f}'
    if reason := _off_red(seen, options):
        return reason
    if seen.redness < options.min_redness:
        return f'redness {seen.redness:.2f} is below {options.min_redness:.2f}'
    if seen.cut and (seen.arcs is None or seen.arcs.share < LEAST_OF_CUT):
        return 'cut by the edge of the image'
    if seen.arcs is not None and seen.arcs.share < options.min_seen:
        return (
            f'only {seen.arcs.share:.2f} of its outline is seen, less than {options.min_seen:.2f}'
        )
    if 2 * major < options.min_diameter:
        return f'diameter {2 * major:.1f} px is below {options.min_diameter:.1f} px'
    if 2 * major > options.max_diameter:
        return f'diameter {2 * major:.1f} px is above {options.max_diameter:.1f} px'
    ratio = minor / major
    least_ratio = max(options.min_axis_ratio, ROUND if options.target.shape == 'ball' else 0.0)
    if ratio < least_ratio:
        return f'axis ratio {ratio:.2f} is below {least_ratio:.2f}'
    if seen.arcs is not None:
        return ''
    least_fit = max(options.min_fit, 1 - FLAT_SHARE * ratio - ROUGHNESS / seen.width)
    if seen.fit < least_fit:
        return f'shape agrees with an ellipse by {seen.fit:.2f}, less than {least_fit:.2f}'
    return ''


def _off_red(seen: Description, options: DetectorOptions) -> str:
    """Why a patch that is redder than its surroundings is of another colour all the same."""
    purity, tint = seen.hue
    # The less of a colour is left, the more of what is seen is the water's and the camera's; of
    # one that is nearly all red nothing else is.
    most = max(options.max_yellow - purity, options.max_blue)
    if tint > most:
        return f'yellow or orange: tint {tint:.2f} is above {most:.2f}'
    if tint < -options.max_blue:
        return f'pink or violet: tint {tint:.2f} is below {-options.max_blue:.2f}'
    blue, green, red = fullest(seen.cutout.inside, seen.cutout.around)
    saturation = 1 - min(blue, green, red) / max(blue, green, red, 1.0)
    if saturation < WHITE or red < max(blue, green):
        return 'white or of another colour where it is brightest: a glint, or overexposed'
    return ''


def _without_mirror_images(judged: list[Judged]) -> list[Judged]:
    """Refuse whatever has a like patch below it: its own mirror image lies above a target."""
    good = [each.description for each in judged if not each.reason]
    if len(good) < 2:
        return judged
    return [
        each if each.reason else each._replace(reason=_mirrors(each.description, good))
        for each in judged
    ]


def _mirrors(upper: Description, good: list[Description]) -> str:
    below = next((each for each in good if _is_mirror_image(upper, each)), None)
    if below is None:
        return ''
    u, v = below.outline.centre
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
