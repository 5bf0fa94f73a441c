"""From the centre of a ball's outline to the image of the ball's centre.

A ball's outline is where lines of sight touch it. In the air they lie on a cone, whose image is an
ellipse; refraction bends both. Either way its centre lies farther out than the image of the ball's
centre: by 0.1 px at 40 px across and 20 degrees off the axis.
"""

from __future__ import annotations

import math

import numpy as np

from binopos_ros.optics.disc import RIM_POINTS, Array, Outline, Project, centroid, longest_diameter
from binopos_ros.optics.errors import OpticsError

TOUCHES = 4
"""Times that the touching points are put right; each gains the ratio of diameter to distance."""


def ball_outlines(project: Project, position: Array, diameter: float) -> list[Outline]:
    """Give, for each camera, the outline of a ball.

    position (3,) m is the ball's centre, diameter in m. Raises OpticsError where the ball is
    not seen whole.
    """
    position, radius = np.asarray(position, float), diameter / 2
    # Seven places about the ball, and about each of them six, for the lines of sight there.
    places = position + radius * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    step = 0.1 * radius
    nearby = places[:, None] + step * np.vstack([np.eye(3), -np.eye(3)])
    sights = []
    for image in project(nearby.reshape(-1, 3)):
        up, down = np.moveaxis(image.reshape(7, 2, 3, 2), 1, 0)
        # Along its line of sight a point keeps its image.
        slopes = (up - down) / (2 * step)
        along = np.cross(slopes[..., 0], slopes[..., 1])
        sights.append(along / np.linalg.norm(along, axis=1, keepdims=True))
    rims = [_touching(each, radius) for each in sights]
    points = np.concatenate([position[None], *(position + rim for rim in rims)])
    found = []
    for k, image in enumerate(project(points)):
        rim = image[1 + k * len(rims[k]) : 1 + (k + 1) * len(rims[k])]
        if not math.isfinite(rim.sum() + image[0].sum()):
            msg = f'the ball at {np.round(position, 3).tolist()} m is not seen whole'
            raise OpticsError(msg)
        offset = centroid(rim) - image[0]
        found.append(Outline(offset, longest_diameter(rim[:-1] - image[0])))
    return found


def _touching(sights: Array, radius: float) -> Array:
    """Where lines of sight touch a ball about the origin, a closed polygon (N + 1, 3).

    sights (7, 3) are their directions in the middle, and at +- radius along x, y and z. The
    polygon is enlarged to have the area of what touches.
    """
    if not np.isfinite(sights).all():
        return np.full((RIM_POINTS + 1, 3), np.nan)
    change = (sights[1:4] - sights[4:]) / 2
    across = np.linalg.svd(sights[:1])[2][1:]
    angle = 2 * math.pi / RIM_POINTS * np.arange(RIM_POINTS + 1)
    outwards = np.column_stack([np.cos(angle), np.sin(angle)]) @ across
    for _ in range(TOUCHES):
        along = sights[0] + outwards @ change
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        outwards -= (outwards * along).sum(1, keepdims=True) * along
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    step = 2 * math.pi / RIM_POINTS
    rim: Array = radius * math.sqrt(step / math.sin(step)) * outwards
    return rim
