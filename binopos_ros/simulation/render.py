"""Pictures of a scene: every pixel traced backwards from the camera to what it sees.

A pixel's value is the light gathered over its whole square. Inside the disc and away from it one
ray per pixel tells that; across the disc's edge the pixel is cut into 4 x 4 cells, and of each the
share that the disc covers is the area on one side of a straight line, exactly. So the disc's
picture is neither shifted nor grown by sampling.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.backdrop import Basin
from binopos_ros.simulation.medium import Boundary, Rays, dot, trace
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Image, Picture

Array = NDArray[np.float64]

#: Spacing of the rays that tell where the water's surface bends the view, px.
NODE_SPACING = 6
#: Cells along each side of a pixel on the disc's edge.
CELLS = 4
#: Rows that are traced at once, to keep the memory small.
BAND = 64


@dataclasses.dataclass(frozen=True)
class Box:
    """A rectangle of pixels: columns left .. right - 1, rows top .. bottom - 1."""

    left: int
    top: int
    right: int
    bottom: int

    def grown(self, margin: int, size: tuple[int, int]) -> Box:
        """The box with a margin, inside an image of size (width, height)."""
        return Box(
            max(self.left - margin, 0),
            max(self.top - margin, 0),
            min(self.right + margin, size[0]),
            min(self.bottom + margin, size[1]),
        )

    def within(self, outer: Box) -> tuple[slice, slice]:
        """Rows and columns of this box in an array that covers the outer one."""
        return (
            slice(self.top - outer.top, self.bottom - outer.top),
            slice(self.left - outer.left, self.right - outer.left),
        )

    @property
    def rows_and_columns(self) -> tuple[slice, slice]:
        """Rows and columns of this box in the whole image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.bottom - self.top, self.right - self.left

    def pixels(self) -> Array:
        """(N, 2) centres of the pixels, row by row."""
        v, u = np.mgrid[self.top : self.bottom, self.left : self.right]
        return np.column_stack([u.ravel(), v.ravel()]).astype(float)


class Renderer:
    """Pictures of one camera of a scene; safe to use from several threads.

    Args:
        scene: what to show.
        side: 0 for the left camera, 1 for the right one.
    """

    def __init__(self, scene: Scene, side: int) -> None:
        self.scene = scene
        self.view = scene.views[side]
        self.size = self.view.lens.size
        width, height = self.size
        self._frame = Box(0, 0, width, height)
        self._calm = np.empty((height, width, 3), np.float32)
        self._wet: _WetRegion | None = None
        self._draw_calm_background()
        self._blurred = scene.sensor.blurred(self._calm)
        self._level = scene.sensor.noise_level(self._blurred)
        box = self._wet.box if self._wet else self._frame
        self._nodes = _node_grid(box)
        self._node_directions = self.view.directions(self._nodes.reshape(-1, 2))
        self._node_boundaries = tuple(_single_precision(b) for b in self.view.boundaries)
        self._calm_nodes = None if self._wet else self._look_at_nodes(0.0)

    def picture(self, time: float, rng: np.random.Generator) -> Picture:
        """(H, W, 3) what the camera reads at a time (s): blue, green, red, noise included."""
        light = self.light(time)
        if light is self._blurred:
            level = self._level
        else:
            level = self.scene.sensor.noise_level(light)
        return self.scene.sensor.read_out(light, level, rng)

    def light(self, time: float) -> Image:
        """(H, W, 3) the noise-free grey levels at a time (s), not rounded."""
        sensor = self.scene.sensor
        if self._wet is None:
            nodes = self._calm_nodes
            assert nodes is not None
            box = self._box_of_disc(nodes, time)
            if box is None:
                return self._blurred
            # Blurred light reaches one radius out of the disc's box, and comes from one farther.
            outer = box.grown(sensor.blur_radius, self.size)
            source = outer.grown(sensor.blur_radius, self.size)
            patch = self._calm[source.rows_and_columns].copy()
            self._draw_disc(patch[box.within(source)], box, time)
            light = self._blurred.copy()
            light[outer.rows_and_columns] = sensor.blurred(patch)[outer.within(source)]
            return light
        nodes = self._look_at_nodes(time)
        light = self._calm.copy()
        self._wet.draw(light, nodes, self._nodes.shape[:2])
        box = self._box_of_disc(nodes, time)
        if box is not None:
            self._draw_disc(light[box.rows_and_columns], box, time)
        return sensor.blurred(light)

    def _look_at_nodes(self, time: float) -> Rays:
        return trace(self._node_boundaries, self.view.centre, self._node_directions, time)

    def _draw_calm_background(self) -> None:
        """Trace the whole background, and note where it is seen through waves."""
        scene, view = self.scene, self.view
        calm = tuple(dataclasses.replace(boundary, waves=None) for boundary in view.boundaries)
        still = dataclasses.replace(view, boundaries=calm)
        wet = None
        if scene.waves is not None and isinstance(scene.backdrop, Basin):
            wet = _WetRegion(scene.backdrop, self._frame)
        for top in range(0, self.size[1], BAND):
            band = Box(0, top, self.size[0], min(top + BAND, self.size[1]))
            pixels = band.pixels()
            rays = still.look(pixels, 0.0)
            colours = scene.backdrop.radiance(view.centre, still.directions(pixels), rays)
            self._calm[band.rows_and_columns] = scene.sensor.exposure * colours.reshape(
                *band.shape, 3
            )
            if wet:
                wet.note(band, rays)
        if wet and wet.finish(scene.sensor.exposure):
            self._wet = wet

    def _miss(self, rays: Rays, time: float) -> tuple[Array, Array]:
        """How rays pass the disc: -1 at its centre, 0 on its rim, 1 far away; and their way to it.

        With r from the centre and the disc's radius R it is (r^2 - R^2) / (r^2 + R^2), which stays
        smooth where a ray is parallel to the disc's plane. The way is in metres.
        """
        positions, normals = self.scene.path.poses(time)
        offset = rays.origins - positions[0]
        towards = dot(rays.directions, normals[0])
        valid = np.isfinite(towards) & (np.abs(towards) > 1e-9)
        steps = np.where(valid, -dot(offset, normals[0]) / np.where(valid, towards, 1), -1.0)
        hits = offset + steps[:, None] * np.where(valid[:, None], rays.directions, 0)
        squared = dot(hits, hits)
        rim = (self.scene.disc.diameter / 2) ** 2
        miss = np.where(steps > 0, (squared - rim) / (squared + rim), 1.0)
        return miss, np.maximum(steps, 0)

    def _box_of_disc(self, nodes: Rays, time: float) -> Box | None:
        """Box of pixels that the disc may touch; None where it is out of the picture."""
        miss = self._miss(nodes, time)[0].reshape(self._nodes.shape[:2])
        spread = np.maximum(np.abs(np.gradient(miss, axis=0)), np.abs(np.gradient(miss, axis=1)))
        rows, columns = np.nonzero(miss < 1.5 * spread + 1e-9)
        if rows.size == 0:
            return None
        first, last = (
            self._nodes[rows.min(), columns.min()],
            self._nodes[rows.max(), columns.max()],
        )
        box = Box(int(first[0]), int(first[1]), int(last[0]) + 1, int(last[1]) + 1)
        box = box.grown(NODE_SPACING, self.size)
        return box if min(box.shape) >= 2 else None

    def _draw_disc(self, light: Image, box: Box, time: float) -> None:
        """Lay the disc over the light of a box."""
        scene = self.scene
        pixels = box.pixels()
        rays = self.view.look(pixels, time)
        miss, steps = self._miss(rays, time)
        picture = miss.reshape(box.shape)
        reach = np.abs(np.gradient(picture, axis=0)) + np.abs(np.gradient(picture, axis=1))
        edge = (np.abs(picture) < reach).ravel()
        covered = (miss < 0).astype(float)
        covered[edge] = self._edge_coverage(pixels[edge], time)
        touched = covered > 0
        steps, rays_length = steps[touched], rays.lengths[touched]
        points = rays.origins[touched] + steps[:, None] * rays.directions[touched]
        lengths = rays_length + steps
        factor, veil = scene.water.transmission(
            lengths, scene.backdrop.light_lengths(points, lengths)
        )
        colour = scene.sensor.exposure * (255 * np.array(scene.disc.colour) * factor + veil)
        share = covered[touched, None]
        flat = light.reshape(-1, 3)
        flat[touched] = (1 - share) * flat[touched] + share * colour
        light[...] = flat.reshape(light.shape)

    def _edge_coverage(self, pixels: Array, time: float) -> Array:
        """(N,) share of each pixel that the disc covers."""
        ticks = (np.arange(CELLS) + 0.5) / CELLS - 0.5
        dv, du = np.meshgrid(ticks, ticks, indexing='ij')
        cells = pixels[:, None, None, :] + np.stack([du, dv], axis=-1)
        miss = self._miss(self.view.look(cells.reshape(-1, 2), time), time)[0].reshape(
            -1, CELLS, CELLS
        )
        # In units of one cell, whose square is then of side 1.
        slope_v, slope_u = np.gradient(miss, axis=(1, 2), edge_order=2)
        return half_plane_coverage(miss, slope_u, slope_v).mean(axis=(1, 2))


class _WetRegion:
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


def _single_precision(boundary: Boundary) -> Boundary:
    """The boundary with waves fast enough to redraw a background in every picture."""
    if boundary.waves is None:
        return boundary
    return dataclasses.replace(
        boundary, waves=dataclasses.replace(boundary.waves, precision=np.float32)
    )


def _node_grid(box: Box) -> Array:
    """(R, C, 2) pixels every NODE_SPACING px, with what `interpolate` needs around a box."""
    height, width = box.shape
    columns = np.arange(-2, -(-width // NODE_SPACING) + 4) * NODE_SPACING + box.left
    rows = np.arange(-2, -(-height // NODE_SPACING) + 4) * NODE_SPACING + box.top
    u, v = np.meshgrid(columns, rows)
    return np.stack([u, v], axis=-1).astype(float)


def interpolate(nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values on every pixel from values every NODE_SPACING px, by Lagrange's quintic.

    Args:
        nodes: (R, C), of which two rows and columns before the first pixel and three after the
            last one serve the polynomial alone.

    Returns:
        ((R - 5) NODE_SPACING, (C - 5) NODE_SPACING).
    """
    return _along_rows(np.ascontiguousarray(_along_rows(nodes.T).T))


def _along_rows(nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    intervals = nodes.shape[0] - 5
    values = np.zeros((intervals * NODE_SPACING, nodes.shape[1]), np.float32)
    for phase in range(NODE_SPACING):
        for tap, weight in enumerate(_lagrange_weights(phase / NODE_SPACING)):
            values[phase::NODE_SPACING] += np.float32(weight) * nodes[tap : tap + intervals]
    return values


def _lagrange_weights(place: float) -> Array:
    """Weights of the values at -2 .. 3 for the value at a place between 0 and 1."""
    ticks = np.arange(-2, 4)
    return np.array(
        [
            np.prod([(place - other) / (tick - other) for other in ticks if other != tick])
            for tick in ticks
        ]
    )


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
