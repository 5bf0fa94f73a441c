"""A picture for people: what was found, how surely, and what was refused and why."""

from __future__ import annotations

import cv2
import numpy as np

from .images import Picture
from .target import Detection, Ellipse, Target

FOUND, REFUSED, DOUBT, PLATE = (80, 230, 80), (60, 170, 255), (255, 220, 60), (0, 0, 0)
SIGMAS = 3.0
SUBPIXEL_BITS = 4
MOST_LABELS = 12


def draw(image_bgr: Picture, detection: Detection, magnification: float = 50.0) -> Picture:
    """Draw a detection on a copy of its image, both (height, width, 3) uint8.

    The target is outlined in green with a cross at its centre; about it, in blue, lies the
    ellipse of three standard deviations of the centre, `magnification` times enlarged. Refused
    candidates are outlined in orange, each with its reason.
    """
    picture = np.ascontiguousarray(image_bgr).copy()
    size = max(picture.shape[1] / 1600, 0.35)
    for candidate in detection.candidates[:MOST_LABELS]:
        if candidate.reason:
            _ellipse(picture, candidate.outline, REFUSED)
            _label(picture, candidate.outline, candidate.reason, REFUSED, size)
    if detection.target is None:
        _write(picture, (6, int(36 * size) + 4), f'no target: {detection.reason}', REFUSED, size)
        return picture
    target = detection.target
    _ellipse(picture, target.outline, FOUND)
    cv2.drawMarker(
        picture, _nearest(target.centre), FOUND, cv2.MARKER_CROSS, max(9, int(20 * size)), 1
    )
    # An ellipse's moments are a quarter of its squared semi-axes.
    reach = (SIGMAS * magnification) ** 2 / 4
    _ellipse(picture, Ellipse(target.centre, target.covariance * reach), DOUBT)
    _write(picture, (6, int(36 * size) + 4), _caption(target, magnification), FOUND, size)
    return picture


def _caption(target: Target, magnification: float) -> str:
    sigma_u, sigma_v = np.sqrt(np.diag(target.covariance))
    u, v = target.centre
    return (
        f'({u:.3f}, {v:.3f}) px  sigma {sigma_u:.3f} {sigma_v:.3f} px '
        f'({SIGMAS:.0f} sigma drawn x{magnification:.0f})  diameter {target.diameter:.1f} px'
    )


def _ellipse(picture: Picture, ellipse: Ellipse, colour: tuple[int, int, int]) -> None:
    scale = 1 << SUBPIXEL_BITS
    limit = 4 * max(picture.shape)
    centre = _nearest(ellipse.centre * scale)
    axes = _nearest(np.minimum(ellipse.semi_axes, limit) * np.float64(scale))
    degrees = float(np.degrees(ellipse.angle))
    cv2.ellipse(
        picture, centre, axes, degrees, 0, 360, colour, 1, cv2.LINE_AA, shift=SUBPIXEL_BITS
    )


def _label(
    picture: Picture, outline: Ellipse, text: str, colour: tuple[int, int, int], size: float
) -> None:
    u, v = outline.centre
    down = 2 * np.sqrt(outline.moments[1, 1])
    _write(picture, _nearest(np.array([u, v + down + 26 * size])), text, colour, 0.7 * size)


def _write(
    picture: Picture, place: tuple[int, int], text: str, colour: tuple[int, int, int], size: float
) -> None:
    wide, high = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0]
    u = min(max(place[0], 2), max(picture.shape[1] - wide - 2, 2))
    v = min(max(place[1], high + 2), picture.shape[0] - 4)
    cv2.rectangle(picture, (u - 2, v - high - 3), (u + wide + 2, v + 4), PLATE, cv2.FILLED)
    cv2.putText(picture, text, (u, v), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _nearest(point: np.ndarray) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
