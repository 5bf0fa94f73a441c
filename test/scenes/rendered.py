"""Pictures of a disc under water with known truth, made without the package under test.

Every sub-pixel's ray is bent at a flat surface by the vector form of Snell's law and cut with the
disc's plane; the image of a point is found by bisection on its own. Nothing of `binopos_ros` is
used.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class View:
    """A pinhole camera of `focal` px, looking through a flat surface of water.

    The surface lies `depth` m along `normal` from the camera; index 1 stands for no water.
    """

    width: int = 256
    height: int = 256
    focal: float = 900.0
    offset: tuple[float, float] = (0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    depth: float = 0.8
    index: float = 1.333

    @property
    def principal(self) -> np.ndarray:
        middle = np.array([(self.width - 1) / 2, (self.height - 1) / 2])
        return middle - np.array(self.offset)

    def rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the rays of pixels (N, 2) enter the water, and their unit directions there."""
        flat = (pixels - self.principal) / self.focal
        air = np.column_stack([flat, np.ones(len(flat))])
        air /= np.linalg.norm(air, axis=1, keepdims=True)
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        along = air @ normal
        points = air * (self.depth / along)[:, None]
        inside = np.sqrt(1 - (1 - along**2) / self.index**2)
        water = air / self.index + (inside - along / self.index)[:, None] * normal
        return points, water

    def image_of(self, point: np.ndarray) -> np.ndarray:
        """The pixel (2,) in which a point under water is seen, by bisection."""
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        below = point @ normal - self.depth
        foot = point - (point @ normal) * normal
        reach = np.linalg.norm(foot)
        if reach == 0:
            crossing = normal * self.depth
        else:
            low, high = 0.0, reach
            for _ in range(200):
                middle = (low + high) / 2
                sine_air = middle / np.hypot(middle, self.depth)
                sine_water = (reach - middle) / np.hypot(reach - middle, below)
                low, high = (low, middle) if sine_air > self.index * sine_water else (middle, high)
            crossing = normal * self.depth + foot / reach * (low + high) / 2
        return self.principal + self.focal * crossing[:2] / crossing[2]


@dataclass(frozen=True)
class Disc:
    """A disc: centre m, unit normal, diameter m."""

    centre: tuple[float, float, float]
    normal: tuple[float, float, float]
    diameter: float


@dataclass(frozen=True)
class Scene:
    """A disc's coverage of each pixel, and where it is.

    outline_centre is the centre of the covered area, disc_centre the image of the disc's centre.
    """

    coverage: np.ndarray
    outline_centre: np.ndarray
    disc_centre: np.ndarray
    area: float


@dataclass(frozen=True)
class Look:
    """How the picture is taken. Colours are blue, green, red; slope is grey levels per px."""

    disc: tuple[float, float, float] = (48.0, 40.0, 190.0)
    ground: tuple[float, float, float] = (150.0, 140.0, 110.0)
    slope: tuple[float, float] = (0.0, 0.0)
    shading: tuple[float, float] = (0.0, 0.0)
    noise: float = 2.0
    quality: int | None = None
    texture: float = 0.0


def scene(view: View, disc: Disc, blur: float = 0.7, samples: int = 6) -> Scene:
    """Trace a disc's coverage, with a Gaussian blur of that many px."""
    seen = view.image_of(np.array(disc.centre))
    u = (np.arange(view.width * samples) + 0.5) / samples - 0.5
    v = (np.arange(view.height * samples) + 0.5) / samples - 0.5
    reach = 0.75 * disc.diameter * view.focal / disc.centre[2] * 1.2 + 4
    across = np.flatnonzero(np.abs(u - seen[0]) < reach)
    down = np.flatnonzero(np.abs(v - seen[1]) < reach)
    grid = np.stack(np.meshgrid(u[across], v[down]), axis=-1).reshape(-1, 2)
    points, water = view.rays(grid)
    normal = np.array(disc.normal) / np.linalg.norm(disc.normal)
    centre = np.array(disc.centre)
    on_plane = points + water * (((centre - points) @ normal) / (water @ normal))[:, None]
    within = np.linalg.norm(on_plane - centre, axis=1) < disc.diameter / 2
    fine = np.zeros((view.height * samples, view.width * samples), np.float32)
    fine[np.ix_(down, across)] = within.reshape(len(down), len(across))
    area = float(within.sum()) / samples**2
    centroid = grid[within].mean(0)
    fine = cv2.GaussianBlur(fine, (0, 0), blur * samples)
    blocks = fine.reshape(view.height, samples, view.width, samples)
    return Scene(blocks.mean((1, 3)), centroid, seen, area)


def disc_of(
    view: View,
    diameter: float,
    tilt: float,
    azimuth: float,
    place: tuple[float, float],
    below: float = 0.4,
) -> Disc:
    """A disc of about that diameter, px, whose centre is seen near `place`, px, tilted by rad."""
    points, water = view.rays(np.array([place]))
    centre = points[0] + water[0] * below
    size = diameter * (view.depth + below / view.index) / view.focal
    normal = (
        np.sin(tilt) * np.cos(azimuth),
        np.sin(tilt) * np.sin(azimuth),
        -np.cos(tilt),
    )
    return Disc(tuple(centre), normal, size)


def picture(scene_: Scene, look: Look, rng: np.random.Generator) -> np.ndarray:
    """A picture (height, width, 3) uint8 of a scene, after noise but before any JPEG."""
    height, width = scene_.coverage.shape
    x = np.arange(width) - scene_.outline_centre[0]
    y = np.arange(height) - scene_.outline_centre[1]
    tilted = look.slope[0] * x + (look.slope[1] * y)[:, None]
    shaded = look.shading[0] * x + (look.shading[1] * y)[:, None]
    ground = np.array(look.ground) + tilted[..., None]
    if look.texture:
        rough = cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), 2.5)
        ground = ground + (look.texture * rough / rough.std())[..., None]
    disc = np.array(look.disc) + shaded[..., None]
    share = scene_.coverage[..., None]
    mean = ground * (1 - share) + disc * share
    noisy = mean + look.noise * rng.standard_normal(mean.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def jpeg(image: np.ndarray, quality: int) -> bytes:
    """A JPEG of 4:2:0, as cameras send it."""
    done, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return data.tobytes()


def yuyv(image: np.ndarray) -> np.ndarray:
    """YUYV (height, 2 width) of narrow range, as webcams send it: two pixels share their chroma.

    The matrix is that of ITU-R BT.601 for 8 bits.
    """
    blue, green, red = np.moveaxis(image.astype(float) / 255, -1, 0)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    blueness, redness = (blue - luma) / 1.772, (red - luma) / 1.402
    packed = np.empty((image.shape[0], image.shape[1] * 2))
    packed[:, 0::2] = 16 + 219 * luma
    packed[:, 1::4] = 128 + 224 * (blueness[:, 0::2] + blueness[:, 1::2]) / 2
    packed[:, 3::4] = 128 + 224 * (redness[:, 0::2] + redness[:, 1::2]) / 2
    return np.clip(np.round(packed), 0, 255).astype(np.uint8)
