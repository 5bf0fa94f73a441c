"""Measure: the centre of the best patch's outline, and how surely it is known.

The outline by moments is good to a tenth of a pixel; the fit of its edge makes hundredths of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .describe import Description, covered
from .edge import EdgeFit, Measured
from .errors import DetectionError
from .images import Frame
from .judge import Judged
from .target import Candidate, Detection, Ellipse, Target

MOMENTS_ERROR, MOMENTS_SHARE = 0.15, 0.01
"""Standard deviation of the outline by moments, rounded: px, and as a share of the semi-axis."""

ARCS_SHARE = 0.05
"""The same share where a circle was found by arcs of it."""

DIAGONAL = np.diag_indices(2)

SIGMAS = 3.0
"""How far the fit may end from the outline by moments, in standard deviations of both."""


def measure(frame: Frame, judged: Sequence[Judged], threshold: float) -> Detection:
    """Measure the first of the judged patches that can be.

    threshold is the contrast that is told where there is none.
    """
    passed_over: list[Candidate] = []
    for k, each in enumerate(judged):
        candidate = each.candidate()
        if not each.reason:
            try:
                seed = covered(each.description)
                found = _measured(frame, seed, each.description)
            except DetectionError as error:
                candidate = replace(candidate, reason=str(error))
            else:
                rest = (_outranked(other.candidate()) for other in judged[k + 1 :])
                chosen = replace(candidate, outline=seed)
                major = found.outline.semi_axes[0]
                target = Target(found.outline.centre, found.covariance, 2 * major, found.outline)
                asked = each.description.sighting.threshold
                return Detection(target, '', (*passed_over, chosen, *rest), asked)
        passed_over.append(candidate)
    if not passed_over:
        reason = f'no red patch of contrast {threshold:.2f} or more'
    else:
        reason = f'no patch is a target; the best: {passed_over[0].reason}'
    return Detection(None, reason, tuple(passed_over), threshold)


def _outranked(candidate: Candidate) -> Candidate:
    return candidate if candidate.reason else replace(candidate, reason='another ranks higher')


def _measured(frame: Frame, seed: Ellipse, seen: Description) -> Measured:
    # Whatever differs in the last digits where a target is followed is rounded away, so the fit
    # starts from one and the same outline however the target was found.
    start = _rounded(seed)
    arcs = seen.arcs
    fitted = EdgeFit(frame, start, None if arcs is None else arcs.sectors).measured()
    # Of an outline that is none of an ellipse a part may be hidden, and the centre off by as much.
    fitted.covariance[DIAGONAL] += (seen.misfit * 2 * start.semi_axes[0]) ** 2
    (u, v), (start_u, start_v) = fitted.outline.centre.tolist(), start.centre.tolist()
    shift = (u - start_u) ** 2 + (v - start_v) ** 2
    share = MOMENTS_SHARE if arcs is None else ARCS_SHARE
    spread = (MOMENTS_ERROR + share * start.semi_axes[0]) ** 2
    (a, _), (_, d) = fitted.covariance.tolist()
    if shift <= SIGMAS**2 * ((a + d) / 2 + spread):
        return fitted
    # One of the two is wrong, by no more than they differ; of a fit gone astray nothing holds.
    return Measured(seed, np.eye(2) * (shift / 2 + spread))


def _rounded(ellipse: Ellipse) -> Ellipse:
    (a, b), (_, d) = ellipse.moments.tolist()
    wide, high = (max(round(math.sqrt(each) * 8), 4) / 8 for each in (a, d))
    tilt = min(max(round(b / math.sqrt(a * d) * 32) / 32, -0.97), 0.97)
    cross = tilt * wide * high
    moments = np.array([[wide**2, cross], [cross, high**2]])
    # Never in the middle of a pixel, where the outline's distance has no direction.
    centre = np.array([math.floor(each * 4) / 4 + 0.125 for each in ellipse.centre.tolist()])
    return Ellipse(centre, moments)
