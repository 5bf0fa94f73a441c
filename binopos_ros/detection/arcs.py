"""The arcs of a round outline that are seen, where something hides the rest of it.

What hides a target, cuts it off or merges with it leaves a patch that is no ellipse, but a part of
whose border lies on a circle. That circle is looked for among those through three points of the
border, half an outline apart or less.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .moments import Moments

Points = npt.NDArray[np.float64]

SECTORS = 36
BORDER_POINTS = 72
SPANS = (0.25, 0.4, 0.55)
"""Lengths of the arcs whose ends and middle are tried, as shares of the border."""

ROUGHNESS, UNEVENNESS = 0.5, 0.02
"""How far from the circle a point of it may lie: pixels, and a share of the radius."""

END = 4.0
"""px of the image by which the end of an arc is blurred and taken into by what hides the rest."""

COVERED = 0.55
"""Least share of the circle that the patch must cover."""

MOST_OUTSIDE = 0.4
"""Largest share of the patch that may lie outside of the circle."""


class Arcs(NamedTuple):
    """A circle, the share of it that is seen, and where that is clear of what hides the rest.

    u, v and radius are in pixels of the mask; sectors (36,) go by direction from the u axis
    towards the v axis.
    """

    u: float
    v: float
    radius: float
    share: float
    sectors: npt.NDArray[np.bool_]


def find_arcs(
    mask: npt.NDArray[np.uint8], factor: int, ellipse: Moments, open_sides: tuple[bool, ...]
) -> Arcs | None:
    """Find the circle that more of a patch's border lies on than on its ellipse.

    factor is the side of its pixels, px of the image; ellipse that of the mask's moments.
    open_sides tells of the mask's left, upper, right and lower side whether the image ends there:
    where it does the border is none of the target.
    """
    points = _border(mask, open_sides)
    if len(points) < 12:
        return None
    circles = _circles(points)
    if not len(circles):
        return None
    distances = (
        np.hypot(points[:, 0] - circles[:, :1], points[:, 1] - circles[:, 1:2]) - circles[:, 2:]
    )
    on = np.abs(distances) < ROUGHNESS + UNEVENNESS * circles[:, 2:]
    # Of equal support the smaller circle needs the larger part of its outline for it.
    best = int(np.argmax(on.sum(1) - 1e-3 * circles[:, 2]))
    chosen, circle = on[best], circles[best]
    for _ in range(3):
        if chosen.sum() < 8:
            return None
        circle = _fitted(points[chosen])
        rest = np.hypot(*(points - circle[:2]).T) - circle[2]
        chosen = np.abs(rest) < ROUGHNESS + UNEVENNESS * circle[2]
    u, v, radius = circle.tolist()
    if chosen.sum() <= _on_ellipse(points, ellipse) or not _is_within(mask, u, v, radius):
        return None
    angles = np.arctan2(points[chosen, 1] - v, points[chosen, 0] - u)
    hit = np.zeros(SECTORS, np.bool_)
    hit[(angles / (2 * math.pi) * SECTORS).astype(int) % SECTORS] = True
    # Sparse points leave gaps in an arc; what ends one is wider.
    closed = hit | (np.roll(hit, 1) & np.roll(hit, -1))
    clear = closed.copy()
    for turn in range(1, math.ceil(END / factor / radius * SECTORS / (2 * math.pi)) + 1):
        clear &= np.roll(closed, turn) & np.roll(closed, -turn)
    return Arcs(u, v, radius, float(closed.mean()), clear)


def _on_ellipse(points: Points, ellipse: Moments) -> int:
    """How many points of a border lie on the ellipse of those moments."""
    inverse = np.linalg.inv([[ellipse.uu, ellipse.uv], [ellipse.uv, ellipse.vv]]) / 4
    apart = points - (ellipse.u, ellipse.v)
    slope = apart @ inverse
    t = np.sqrt((slope * apart).sum(1))
    distances = (t - 1) * t / np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    # The border runs half a pixel within.
    radius = math.sqrt(2 * (ellipse.uu + ellipse.vv))
    return int((np.abs(distances + 0.5) < ROUGHNESS + UNEVENNESS * radius).sum())


def _border(mask: npt.NDArray[np.uint8], open_sides: tuple[bool, ...]) -> Points:
    """Points (N, 2) between the mask and what is not of it."""
    height, width = mask.shape
    padded = cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    outlines = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[-2]
    points = max(outlines, key=len)[:, 0].astype(float) - 1
    x, y = points.T
    left, top, right, bottom = open_sides
    ends = (
        (left & (x < 1))
        | (top & (y < 1))
        | (right & (x > width - 2))
        | (bottom & (y > height - 2))
    )
    points = points[~ends]
    return points[:: max(len(points) // BORDER_POINTS, 1)]


def _circles(points: Points) -> Points:
    """The circles (M, 3) through three points of a border, as centre and radius."""
    count = len(points)
    found = []
    for span in SPANS:
        step = max(round(span * count / 2), 1)
        a, b, c = points, np.roll(points, -step, 0), np.roll(points, -2 * step, 0)
        ab, ac = b - a, c - a
        twice = 2 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
        some = np.abs(twice) > 1
        ab, ac, twice = ab[some], ac[some], twice[some]
        lengths = (ab**2).sum(1), (ac**2).sum(1)
        x = (ac[:, 1] * lengths[0] - ab[:, 1] * lengths[1]) / twice
        y = (ab[:, 0] * lengths[1] - ac[:, 0] * lengths[0]) / twice
        found.append(np.column_stack([a[some, 0] + x, a[some, 1] + y, np.hypot(x, y)]))
    circles = np.concatenate(found)
    reach = np.ptp(points, axis=0).max()
    return circles[(circles[:, 2] < reach) & (circles[:, 2] > 2.5)]


def _fitted(points: Points) -> Points:
    """The circle nearest to points, by algebraic distance: centre and radius."""
    middle = points.mean(0)
    x, y = (points - middle).T
    design = np.column_stack([x, y, np.ones(len(x))])
    a, b, c = np.linalg.lstsq(design, x * x + y * y, rcond=None)[0]
    u, v = a / 2, b / 2
    return np.array([middle[0] + u, middle[1] + v, math.sqrt(max(c + u * u + v * v, 0.0))])


def _is_within(mask: npt.NDArray[np.uint8], u: float, v: float, radius: float) -> bool:
    height, width = mask.shape
    x, y = np.arange(width) - u, (np.arange(height) - v)[:, None]
    both = cv2.countNonZero(mask & (x * x + y * y < radius**2).view(np.uint8))
    area = math.pi * radius**2
    return both > COVERED * area and both > (1 - MOST_OUTSIDE) * cv2.countNonZero(mask)
