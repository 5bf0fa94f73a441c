"""How the disc gets into a picture: the light of each pixel it touches, by exact areas.

Inside the disc and away from it one ray per pixel tells whether it is seen; across its edge the
pixel is cut into 4 x 4 cells, and of each the share that the disc covers is the area on one side
of a straight line, exactly. So the disc's picture is neither shifted nor grown by sampling.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.medium import Rays, meet_plane
from binopos_ros.simulation.raster import Box
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Image
from binopos_ros.simulation.target import Disc
from binopos_ros.simulation.view import View

Array = NDArray[np.float64]

#: Cells along each side of a pixel on the disc's edge.
CELLS = 4


class DiscPainter:
    """Draws a scene's disc as one of its cameras sees it."""

    def __init__(self, scene: Scene, view: View, disc: Disc) -> None:
        self.scene = scene
        self.view = view
        self.disc = disc

    def miss(self, rays: Rays, time: float) -> Array:
        """How rays pass the disc: -1 at its centre, 0 on its rim, 1 far away.

        With r from the centre and the disc's radius R it is (r^2 - R^2) / (r^2 + R^2), which stays
        smooth where a ray is parallel to the disc's plane.
        """
        return self._meet(rays, time)[0]

    def paint(self, light: Image, box: Box, time: float) -> None:
        """Lay the disc over the light of a box."""
        pixels = box.pixels()
        rays = self.view.look(pixels, time)
        miss, steps = self._meet(rays, time)
        picture = miss.reshape(box.shape)
        reach = np.abs(np.gradient(picture, axis=0)) + np.abs(np.gradient(picture, axis=1))
        edge = (np.abs(picture) < reach).ravel()
        covered = (miss < 0).astype(float)
        covered[edge] = self._edge_coverage(pixels[edge], time)
        touched = covered > 0
        factor, veil = self.scene.through_water(rays, steps, touched)
        colour = self.scene.sensor.exposure * (255 * np.array(self.disc.colour) * factor + veil)
        share = covered[touched, None]
        flat = light.reshape(-1, 3)
        flat[touched] = (1 - share) * flat[touched] + share * colour
        light[...] = flat.reshape(light.shape)

    def _meet(self, rays: Rays, time: float) -> tuple[Array, Array]:
        positions, normals = self.scene.path.poses(time)
        hits, steps = meet_plane(rays, positions[0], normals[0])
        squared = hits[:, 0] ** 2 + hits[:, 1] ** 2 + hits[:, 2] ** 2
        rim = (self.disc.diameter / 2) ** 2
        return np.where(steps > 0, (squared - rim) / (squared + rim), 1.0), steps

    def _edge_coverage(self, pixels: Array, time: float) -> Array:
        """(N,) share of each pixel that the disc covers."""
        ticks = (np.arange(CELLS) + 0.5) / CELLS - 0.5
        dv, du = np.meshgrid(ticks, ticks, indexing='ij')
        cells = pixels[:, None, None, :] + np.stack([du, dv], axis=-1)
        miss = self.miss(self.view.look(cells.reshape(-1, 2), time), time)
        miss = miss.reshape(-1, CELLS, CELLS)
        # In units of one cell, whose square is then of side 1.
        slope_v, slope_u = np.gradient(miss, axis=(1, 2), edge_order=2)
        return half_plane_coverage(miss, slope_u, slope_v).mean(axis=(1, 2))


def half_plane_coverage(value: Array, slope_x: Array, slope_y: Array) -> Array:
    """Share of a unit square about the origin where value + slope_x x + slope_y y < 0, exact."""
    larger = np.maximum(np.abs(slope_x), np.abs(slope_y))
    smaller = np.minimum(np.abs(slope_x), np.abs(slope_y))
    safe = np.maximum(larger, 1e-30)
    # Scaled so that the line moves by one along the steeper axis for a change of one.
    level = -value / safe
    skew = smaller / safe
    flat, corner = (1 - skew) / 2, (1 + skew) / 2
    missing = np.clip(corner - np.abs(level), 0, None) ** 2 / np.maximum(2 * skew, 1e-300)
    share = np.where(np.abs(level) <= flat, 0.5 + level, np.where(level > 0, 1 - missing, missing))
    return np.clip(share, 0, 1)
