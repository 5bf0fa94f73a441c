"""How a calibration board gets into a picture: its print, gathered over each pixel's square."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.boards import ShownBoard
from binopos_ros.simulation.medium import Rays, dot, meet_plane
from binopos_ros.simulation.raster import Box
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Image
from binopos_ros.simulation.view import View

Array = NDArray[np.float64]

#: Samples of the print along each side of a pixel.
SAMPLES = 4


class BoardPainter:
    """Draws a scene's board as one of its cameras sees it."""

    def __init__(self, scene: Scene, view: View, board: ShownBoard) -> None:
        self.scene = scene
        self.view = view
        self.board = board
        height, width = board.print.shape
        self._half = 0.5 * board.texel * np.array([width, height])

    def miss(self, rays: Rays, time: float) -> Array:
        """How rays pass the sheet: -1 in its middle, 0 on its edges, 1 far away."""
        places, steps = self._meet(rays, time)
        off = np.abs((places - self.board.corner) / self._half - 1).max(axis=1)
        return np.where(steps > 0, (off - 1) / (off + 1), 1.0)

    def paint(self, light: Image, box: Box, time: float) -> None:
        """Lay the board over the light of a box."""
        grown = Box(box.left - 1, box.top - 1, box.right + 1, box.bottom + 1)
        rays = self.view.look(grown.pixels(), time)
        places, steps = self._meet(rays, time)
        # Far off the sheet the numbers grow beyond what an image coordinate can be.
        texels = np.clip((places - self.board.corner) / self.board.texel - 0.5, -3e4, 3e4)
        texels = texels.reshape(*grown.shape, 2)
        shine, share = self._gather(texels, (steps > 0).reshape(grown.shape)[1:-1, 1:-1])
        inner = np.zeros(grown.shape, bool)
        inner[1:-1, 1:-1] = share > 0
        factor, veil = self.scene.through_water(rays, steps, inner.ravel())
        touched = share > 0
        exposure = self.scene.sensor.exposure
        colour = exposure * (255 * shine[touched, None] * factor + share[touched, None] * veil)
        light[touched] = (1 - share[touched, None]) * light[touched] + colour

    def _meet(self, rays: Rays, time: float) -> tuple[Array, Array]:
        """Where rays meet the board's plane: (N, 2) in its own coordinates; the way there."""
        number = self.board.number(time)
        rotation = self.board.rotations[number]
        hits, steps = meet_plane(rays, self.board.positions[number], rotation[:, 2])
        places = np.stack([dot(hits, rotation[:, 0]), dot(hits, rotation[:, 1])], axis=1)
        return places, steps

    def _gather(self, texels: Array, ahead: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Mean reflectance and share covered of pixels, each (H, W).

        Args:
            texels: (H + 2, W + 2, 2) columns and rows of the print at the pixels' centres.
            ahead: (H, W) whether the board is before the camera there.
        """
        here = texels[1:-1, 1:-1]
        # Within a pixel the board's coordinates follow their second-order expansion, whose
        # remainder is some 1e-6 px.
        across = (texels[1:-1, 2:] - texels[1:-1, :-2]) / 2
        down = (texels[2:, 1:-1] - texels[:-2, 1:-1]) / 2
        bend_across = texels[1:-1, 2:] - 2 * here + texels[1:-1, :-2]
        bend_down = texels[2:, 1:-1] - 2 * here + texels[:-2, 1:-1]
        twist = (texels[2:, 2:] - texels[2:, :-2] - texels[:-2, 2:] + texels[:-2, :-2]) / 4
        height, width = self.board.print.shape
        shine, share = np.zeros(ahead.shape), np.zeros(ahead.shape)
        ticks = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        for v in ticks:
            for u in ticks:
                place = (
                    here
                    + u * across
                    + v * down
                    + 0.5 * u * u * bend_across
                    + 0.5 * v * v * bend_down
                    + u * v * twist
                )
                column, row = (place[..., axis].astype(np.float32) for axis in range(2))
                inside = ahead & (column > -0.5) & (column < width - 0.5)
                inside &= (row > -0.5) & (row < height - 0.5)
                value = cv2.remap(
                    self.board.print, column, row, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
                )
                shine += np.where(inside, value, 0)
                share += inside
        return shine / SAMPLES**2, share / SAMPLES**2
