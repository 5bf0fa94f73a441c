"""Pictures of a scene: every pixel traced backwards from the camera to what it sees.

The background is drawn once; in each picture only the box around the target is traced anew.
Under waves the inside of a basin is redrawn from rays every few pixels; the target is traced
exactly.
"""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.backdrop import Basin
from binopos_ros.simulation.board_painter import BoardPainter
from binopos_ros.simulation.boards import ShownBoard
from binopos_ros.simulation.disc_painter import DiscPainter
from binopos_ros.simulation.medium import Rays, trace
from binopos_ros.simulation.raster import NODE_SPACING, Box, node_grid
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Image, Picture
from binopos_ros.simulation.view import View
from binopos_ros.simulation.wavy import WavyRegion, single_precision

Array = NDArray[np.float64]

#: Rows that are traced at once, to keep the memory small.
BAND = 64


class Painter(Protocol):
    """Draws one kind of target."""

    def miss(self, rays: Rays, time: float) -> Array:
        """How rays pass the target: below 0 on it, rising smoothly to 1 far away."""
        ...

    def paint(self, light: Image, box: Box, time: float) -> None:
        """Lay the target over the light of a box."""
        ...


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
        self._wet: WavyRegion | None = None
        self._painter = _painter(scene, self.view)
        self._draw_calm_background()
        self._blurred = scene.sensor.blurred(self._calm)
        self._level = scene.sensor.noise_level(self._blurred)
        box = self._wet.box if self._wet else self._frame
        self._nodes = node_grid(box)
        self._node_directions = self.view.directions(self._nodes.reshape(-1, 2))
        self._node_boundaries = tuple(single_precision(b) for b in self.view.boundaries)
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
            box = self._box_of_target(nodes, time)
            if box is None:
                return self._blurred
            # Blurred light reaches one radius out of the target's box, and comes from one farther.
            outer = box.grown(sensor.blur_radius, self.size)
            source = outer.grown(sensor.blur_radius, self.size)
            patch = self._calm[source.rows_and_columns].copy()
            self._painter.paint(patch[box.within(source)], box, time)
            light = self._blurred.copy()
            light[outer.rows_and_columns] = sensor.blurred(patch)[outer.within(source)]
            return light
        nodes = self._look_at_nodes(time)
        light = self._calm.copy()
        self._wet.draw(light, nodes, self._nodes.shape[:2])
        box = self._box_of_target(nodes, time)
        if box is not None:
            self._painter.paint(light[box.rows_and_columns], box, time)
        return sensor.blurred(light)

    def _look_at_nodes(self, time: float) -> Rays:
        return trace(self._node_boundaries, self.view.centre, self._node_directions, time)

    def _draw_calm_background(self) -> None:
        """Trace the whole background, and note where it is seen through waves."""
        scene, view = self.scene, self.view
        calm = tuple(boundary.calm() for boundary in view.boundaries)
        still = dataclasses.replace(view, boundaries=calm)
        wet = None
        if scene.waves is not None and isinstance(scene.backdrop, Basin):
            wet = WavyRegion(scene.backdrop, self._frame)
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

    def _box_of_target(self, nodes: Rays, time: float) -> Box | None:
        """Box of pixels that the target may touch; None where it is out of the picture."""
        miss = self._painter.miss(nodes, time).reshape(self._nodes.shape[:2])
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


def _painter(scene: Scene, view: View) -> Painter:
    if isinstance(scene.target, ShownBoard):
        return BoardPainter(scene, view, scene.target)
    return DiscPainter(scene, view, scene.target)
