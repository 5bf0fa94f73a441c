"""The part of a background that waves redraw in every picture."""

from __future__ import annotations

import dataclasses

import numpy as np

from binopos_ros.simulation.backdrop import Basin
from binopos_ros.simulation.medium import Boundary, Rays, Sphere
from binopos_ros.simulation.raster import Box, interpolate
from binopos_ros.simulation.sensor import Image


class WavyRegion:
    """The part of the background that is seen through waves: the inside of a basin's rim."""

    def __init__(self, basin: Basin, frame: Box) -> None:
        self.basin = basin
        self.box = frame
        self._entries = np.zeros((frame.bottom, frame.right, 2), np.float32)
        self._hits = np.zeros((frame.bottom, frame.right, 2), np.float32)
        self._inside = np.zeros((frame.bottom, frame.right), bool)

    def note(self, band: Box, rays: Rays) -> None:
        """Keep where a band's rays enter the water, and where they meet the floor's plane."""
        where = band.rows_and_columns
        entries = self.basin.plane_coordinates(rays.entries)
        self._entries[where] = entries.reshape(*band.shape, 2)
        self._hits[where] = self.basin.floor_hits(rays).reshape(*band.shape, 2)
        self._inside[where] = (np.hypot(*entries.T) < self.basin.radius).reshape(band.shape)

    def finish(self, exposure: float) -> bool:
        """Cut down to the box that holds water; False where none is in sight."""
        rows, columns = np.nonzero(self._inside)
        if rows.size == 0:
            return False
        self.box = Box(
            int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1
        )
        where = self.box.rows_and_columns
        self._entries = self._entries[where].reshape(-1, 2).copy()
        self._inside = self._inside[where].copy()
        hits = self._hits[where].reshape(-1, 2)
        # What the water does to colours changes little with the waves: it is kept as when calm.
        factor, veil = self.basin.transmission(self._entries, hits)
        self._factor = (exposure * factor).astype(np.float32).reshape(*self.box.shape, 3)
        self._veil = (exposure * veil).astype(np.float32).reshape(*self.box.shape, 3)
        del self._hits
        return True

    def draw(self, light: Image, nodes: Rays, grid: tuple[int, int]) -> None:
        """Redraw the water's inside as the rays of the nodes see it."""
        hits = self.basin.floor_hits(nodes).astype(np.float32).reshape(*grid, 2)
        height, width = self.box.shape
        dense = np.empty((height, width, 2), np.float32)
        for axis in range(2):
            dense[..., axis] = interpolate(hits[..., axis])[:height, :width]
        colours = self.basin.reflectance(self._entries, dense.reshape(-1, 2))
        colours = colours.reshape(height, width, 3)
        colours *= self._factor
        colours += self._veil
        np.copyto(light[self.box.rows_and_columns], colours, where=self._inside[..., None])


def single_precision(boundary: Boundary | Sphere) -> Boundary | Sphere:
    """The boundary with waves fast enough to redraw a background in every picture."""
    if isinstance(boundary, Sphere) or boundary.waves is None:
        return boundary
    return dataclasses.replace(
        boundary, waves=dataclasses.replace(boundary.waves, precision=np.float32)
    )
