"""Frames: pictures that give blue-green-red pixels of a window, whatever they hold themselves.

Reduced pixels are means over blocks that lie on a grid fixed to the picture's upper-left corner,
and a window's pixels do not depend on where the window ends. What the detector computes from a
frame is therefore the same whether it looked at all of it or at a part.
"""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from .jpeg import Rounding

Picture = npt.NDArray[np.uint8]

NOT_ROUNDED = Rounding()
SHARED_BY_TWO, SHARED_BY_FOUR = Rounding(1 / 12, 2 / 12), Rounding(1 / 12, 4 / 12)
"""To whole grey levels, where so many pixels share their colour."""

BAYER_MARGIN = 4

_BAYER = {
    'bayer_rggb8': cv2.COLOR_BayerRGGB2BGR,
    'bayer_bggr8': cv2.COLOR_BayerBGGR2BGR,
    'bayer_gbrg8': cv2.COLOR_BayerGBRG2BGR,
    'bayer_grbg8': cv2.COLOR_BayerGRBG2BGR,
}


class Frame(Protocol):
    """A decoded picture. Windows are (x0, y0, x1, y1) in pixels, x1 and y1 excluded."""

    width: int
    height: int
    rounding: Rounding

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        """Give a window's pixels, (y1 - y0, x1 - x0, 3) uint8, blue-green-red."""
        ...

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        """Give a window's means over blocks of factor x factor; its corners lie on the blocks.

        factor is 1 or even. A remainder of less than a block at the right and lower edge of
        the picture is left out.
        """
        ...


class ColourFrame:
    """A picture of interleaved colours: bgr8, rgb8, bgra8 or rgba8."""

    def __init__(
        self, pixels: Picture, encoding: str = 'bgr8', rounding: Rounding = NOT_ROUNDED
    ) -> None:
        self.rounding = rounding
        self.height, self.width = pixels.shape[:2]
        self._pixels = pixels
        self._reverse = encoding.startswith('rgb')

    def _bgr(self, pixels: Picture) -> Picture:
        colours = pixels[..., :3]
        return np.ascontiguousarray(colours[..., ::-1] if self._reverse else colours)

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        return self._bgr(self._pixels[y0:y1, x0:x1])

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        return self._bgr(_block_means(self._pixels[y0:y1, x0:x1], factor, factor))


class YuyvFrame:
    """A YUYV picture, (height, width / 2, 4) uint8: luma, blue, luma, red of each pair of pixels.

    The colour is taken to sit in the middle of its pair, as it does where a camera or a converter
    averages the two pixels.
    """

    def __init__(self, pairs: Picture) -> None:
        self.rounding = SHARED_BY_TWO
        self.height, self.width = pairs.shape[0], pairs.shape[1] * 2
        self._pairs = pairs

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        first, last = x0 // 2, (x1 + 1) // 2
        pairs = np.ascontiguousarray(self._pairs[y0:y1, first:last])
        pixels = pairs.reshape(y1 - y0, (last - first) * 2, 2)
        bgr = cv2.cvtColor(pixels, cv2.COLOR_YUV2BGR_YUYV)
        return np.ascontiguousarray(bgr[:, x0 - 2 * first : x1 - 2 * first])

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        if factor == 1:
            return self.window(x0, y0, x1, y1)
        blocks = _block_means(self._pairs[y0:y1, x0 // 2 : x1 // 2], factor // 2, factor)
        luma = cv2.addWeighted(blocks[..., 0], 0.5, blocks[..., 2], 0.5, 0.0)
        pairs = np.ascontiguousarray(np.dstack([luma, blocks[..., 1], luma, blocks[..., 3]]))
        pixels = pairs.reshape(pairs.shape[0], pairs.shape[1] * 2, 2)
        return np.ascontiguousarray(cv2.cvtColor(pixels, cv2.COLOR_YUV2BGR_YUYV)[:, ::2])


class BayerFrame:
    """A colour mosaic of 8 bits; `encoding` names the order of its upper-left cell."""

    def __init__(self, mosaic: Picture, encoding: str) -> None:
        self.rounding = NOT_ROUNDED
        self.height, self.width = mosaic.shape
        self._mosaic = mosaic
        self._code = _BAYER[encoding]
        cell = encoding[len('bayer_') : len('bayer_') + 4]
        self._places = {
            colour: [divmod(k, 2) for k, name in enumerate(cell) if name == colour]
            for colour in 'bgr'
        }

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        # A pixel's colours come from its neighbours, so the window is widened before and cut
        # after; its corner stays on a whole cell, which keeps the mosaic's order.
        left, top = max(x0 - BAYER_MARGIN, 0) // 2 * 2, max(y0 - BAYER_MARGIN, 0) // 2 * 2
        right, bottom = x1 + BAYER_MARGIN, y1 + BAYER_MARGIN
        mosaic = np.ascontiguousarray(self._mosaic[top:bottom, left:right])
        bgr = cv2.cvtColor(mosaic, self._code)
        return np.ascontiguousarray(bgr[y0 - top : y1 - top, x0 - left : x1 - left])

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        if factor == 1:
            return self.window(x0, y0, x1, y1)
        mosaic = self._mosaic[y0 : y0 + (y1 - y0) // 2 * 2, x0 : x0 + (x1 - x0) // 2 * 2]
        means = {
            (row, column): _block_means(mosaic[row::2, column::2], factor // 2, factor // 2)
            for row in (0, 1)
            for column in (0, 1)
        }
        (red,), (blue,) = self._places['r'], self._places['b']
        green = cv2.addWeighted(
            means[self._places['g'][0]], 0.5, means[self._places['g'][1]], 0.5, 0.0
        )
        return np.dstack([means[blue], green, means[red]])


def _block_means(pixels: Picture, across: int, down: int) -> Picture:
    height, width = pixels.shape[0] // down, pixels.shape[1] // across
    if across == down == 1:
        return pixels
    whole = pixels[: height * down, : width * across]
    # Halving is the one scale at which OpenCV takes means of areas with vector instructions.
    while across % 2 == down % 2 == 0 and (across, down) != (2, 2):
        across, down = across // 2, down // 2
        size = (whole.shape[1] // 2, whole.shape[0] // 2)
        whole = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)
    means = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.uint8)
