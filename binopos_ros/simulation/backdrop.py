"""What lies behind the target: a bowl of water on a table, or the open sea over its bed.

A backdrop turns traced rays into colours (blue, green, red; grey levels from 0 to 255, linear).
"""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.medium import Boundary, Rays, dot, plane_axes
from binopos_ros.simulation.water import Water

Array = NDArray[np.float64]
Image = NDArray[np.float32]

#: Reflectances (blue, green, red) of things that are no target, red brick and orange among them.
DISTRACTOR_COLOURS = (
    (0.60, 0.35, 0.10),
    (0.15, 0.55, 0.20),
    (0.10, 0.60, 0.70),
    (0.12, 0.38, 0.85),
    (0.45, 0.20, 0.45),
    (0.15, 0.22, 0.40),
    (0.60, 0.45, 0.80),
)


@dataclasses.dataclass(frozen=True)
class Basin:
    """A round bowl with upright walls, full of water, on a table.

    Coordinates in its plane are metres along `plane_axes`, from the foot of the rig's origin.

    Attributes:
        surface: the water's surface at rest.
        depth: of the water, m.
        centre: (2,) of the bowl in the plane of the surface, m.
        radius: m.
        floor, table: textures, reflectances of float32 (blue, green, red); the floor's spans the
            square around the bowl, the table's four times its side.
        water: what it does to colours.
    """

    surface: Boundary
    depth: float
    centre: Array
    radius: float
    floor: Image
    table: Image
    water: Water
    rim: float = 0.012

    def plane_coordinates(self, points: Array) -> Array:
        """(N, 3) points to (N, 2) metres from the bowl's axis."""
        first, second = plane_axes(self.surface.normal)
        return np.stack([dot(points, first), dot(points, second)], axis=1) - self.centre

    def light_lengths(self, points: Array, lengths: Array) -> Array:
        """(N,) path of the light through the water to points, m: straight down."""
        return np.maximum(dot(points, self.surface.normal) - self.surface.distance, 0)

    def holds(self, points: Array) -> bool:
        """Whether (N, 3) points all lie in the water of the bowl."""
        depth = dot(points, self.surface.normal) - self.surface.distance
        away = np.hypot(*self.plane_coordinates(points).T)
        return bool(np.all((depth > 0) & (depth < self.depth) & (away < self.radius)))

    def floor_hits(self, rays: Rays) -> Array:
        """(N, 2) where rays meet the plane of the floor, from the bowl's axis."""
        normal = self.surface.normal
        depth = self.surface.distance + self.depth - dot(rays.origins, normal)
        steps = depth / dot(rays.directions, normal)
        return self.plane_coordinates(rays.origins + steps[:, None] * rays.directions)

    def radiance(self, origin: Array, directions: Array, rays: Rays) -> Array:
        """(N, 3) colours of rays that left `origin` and entered the water as `rays`."""
        entries = self.plane_coordinates(rays.entries)
        distance = np.hypot(entries[:, 0], entries[:, 1])
        inside = distance < self.radius
        colours = np.empty((len(directions), 3))
        hits = self.floor_hits(rays)
        factor, veil = self.transmission(entries[inside], hits[inside])
        colours[inside] = factor * self.reflectance(entries[inside], hits[inside]) + veil
        outside = ~inside
        on_rim = outside & (distance < self.radius + self.rim)
        beyond = outside & ~on_rim
        colours[on_rim] = 255 * np.array([0.72, 0.70, 0.66])
        normal = self.surface.normal
        steps = (self.surface.distance + self.depth - origin @ normal) / dot(directions, normal)
        table = self.plane_coordinates(origin + steps[:, None] * directions)
        colours[beyond] = 255 * sample(self.table, table[beyond] / (4 * self.radius))
        return colours

    def reflectance(self, entries: NDArray[Any], hits: NDArray[Any]) -> Image:
        """(N, 3) grey levels before the water's part, of rays from surface to floor plane."""
        colours = sample(self.floor, hits / self.radius)
        colours *= 255
        walls = np.flatnonzero(self._beyond_floor(hits))
        entries, way = entries[walls], hits[walls] - entries[walls]
        share = self._share_to_wall(entries, way)
        angle = np.arctan2(entries[:, 1] + share * way[:, 1], entries[:, 0] + share * way[:, 0])
        tone = 255 * (0.50 + 0.06 * np.cos(3 * angle + 1) - 0.12 * share)
        colours[walls] = tone[:, None] * np.array([1.0, 0.98, 0.92], np.float32)
        return colours

    def transmission(self, entries: NDArray[Any], hits: NDArray[Any]) -> tuple[Array, Array]:
        """Factor and veil, each (N, 3), of the water along the same rays."""
        way = hits - entries
        share = np.ones(len(hits))
        walls = self._beyond_floor(hits)
        share[walls] = self._share_to_wall(entries[walls], way[walls])
        lengths = np.hypot(np.hypot(way[:, 0], way[:, 1]), self.depth)
        return self.water.transmission(share * lengths, share * self.depth)

    def _beyond_floor(self, hits: NDArray[Any]) -> NDArray[np.bool_]:
        return hits[:, 0] ** 2 + hits[:, 1] ** 2 > self.radius**2

    def _share_to_wall(self, entries: NDArray[Any], way: NDArray[Any]) -> NDArray[Any]:
        """(N,) how far along its way to the floor's plane each ray meets the wall, 0 to 1."""
        a = way[:, 0] ** 2 + way[:, 1] ** 2
        b = way[:, 0] * entries[:, 0] + way[:, 1] * entries[:, 1]
        c = entries[:, 0] ** 2 + entries[:, 1] ** 2 - self.radius**2
        root = np.sqrt(np.maximum(b * b - a * c, 0))
        return np.clip((root - b) / np.maximum(a, 1e-30), 0, 1)


@dataclasses.dataclass(frozen=True)
class OpenWater:
    """Water without end over a flat bed.

    Attributes:
        bed_normal: (3,) unit, rig frame, pointing into the ground.
        bed_distance: from the rig's origin along it, m.
        bed: texture, reflectance (blue, green, red), of `bed_extent` metres to each side.
        water: what it does to colours.
    """

    bed_normal: Array
    bed_distance: float
    bed: Image
    water: Water
    bed_extent: float = 4.0

    def light_lengths(self, points: Array, lengths: Array) -> Array:
        """(N,) path of the light through the water to points, m: lamps by the cameras."""
        return lengths

    def holds(self, points: Array) -> bool:
        """Whether (N, 3) points all lie above the bed."""
        return bool(np.all(dot(points, self.bed_normal) < self.bed_distance))

    def radiance(self, origin: Array, directions: Array, rays: Rays) -> Array:
        """(N, 3) colours of rays that entered the water as `rays`."""
        towards = dot(rays.directions, self.bed_normal)
        falls = towards > 1e-3
        height = self.bed_distance - dot(rays.origins, self.bed_normal)
        steps = np.where(falls, height / np.where(falls, towards, 1), np.inf)
        colours = np.empty((len(directions), 3))
        colours[:] = self.water.veil
        hits = rays.origins[falls] + steps[falls, None] * rays.directions[falls]
        first, second = plane_axes(self.bed_normal)
        places = np.stack([dot(hits, first), dot(hits, second)], axis=1) / self.bed_extent
        factor, veil = self.water.transmission(steps[falls], steps[falls])
        colours[falls] = 255 * factor * sample(self.bed, places) + veil
        return colours


Backdrop = Basin | OpenWater

#: Texture sizes from the middle beyond which a place is mirrored back by arithmetic.
FAR = 8.0


def sample(texture: Image, places: NDArray[Any]) -> Image:
    """(N, 3) bilinear samples of a texture at (N, 2) places, each -1 to 1 over the texture.

    Beyond its edges the texture is mirrored. A place that is not finite is the texture's corner.
    """
    height, width = texture.shape[:2]
    count = len(places)
    if count == 0:
        return np.zeros((0, 3), np.float32)
    # cv2.remap takes no more than 32767 rows or columns.
    columns = min(count, 16384)
    rows = -(-count // columns)
    maps = []
    if not np.abs(places).max() < FAR:
        # cv2.remap mirrors one edge after the other, for ever where a place is not finite.
        folded = np.mod(np.where(np.isfinite(places), places, -1.0) + 1, 4)
        places = 1 - np.abs(folded - 2)
    for place, extent in zip(places.T, (width, height), strict=True):
        padded = np.zeros(rows * columns, np.float32)
        padded[:count] = (place + 1) * (0.5 * (extent - 1))
        maps.append(padded.reshape(rows, columns))
    values = cv2.remap(
        texture, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(values, np.float32).reshape(-1, 3)[:count]


def mottled(
    rng: np.random.Generator,
    side: int,
    base: tuple[float, float, float],
    contrast: float,
    patches: tuple[int, ...] = (6, 14, 40, 110),
) -> Image:
    """A square texture of a base colour with smooth random patches, so many along its side."""
    pattern = np.zeros((side, side), np.float32)
    for cells in patches:
        grid = rng.standard_normal((cells, cells), dtype=np.float32)
        pattern += cv2.resize(grid, (side, side), interpolation=cv2.INTER_CUBIC) / 2
    tone = 1 + contrast * pattern
    return np.clip(tone[..., None] * np.array(base, np.float32), 0.02, 0.98).astype(np.float32)


def strew(
    texture: Image, rng: np.random.Generator, count: int, inner: float, outer: float, size: float
) -> None:
    """Draw coloured shapes into a texture, between two shares of its half side from the centre."""
    side = texture.shape[0]
    turn = rng.random() * 2 * np.pi
    for number in range(count):
        angle = turn + 2 * np.pi * number / count
        radius = (inner + (outer - inner) * rng.random()) * side / 2
        centre = side / 2 + radius * np.array([np.cos(angle), np.sin(angle)])
        extent = size * side / 2 * (0.7 + 0.6 * rng.random())
        colour = DISTRACTOR_COLOURS[number % len(DISTRACTOR_COLOURS)]
        shift = 8
        if number % 3 == 0:
            place = tuple(int(value) for value in np.rint(centre * 2**shift))
            cv2.circle(
                texture, place, int(extent * 2**shift), colour, cv2.FILLED, cv2.LINE_8, shift
            )
        else:
            corners = 4 if number % 3 == 1 else 3
            angles = rng.random() * 6 + 2 * np.pi * np.arange(corners) / corners
            outline = centre + extent * np.column_stack([np.cos(angles), np.sin(angles)])
            cv2.fillPoly(
                texture, [np.rint(outline * 2**shift).astype(np.int32)], colour, cv2.LINE_8, shift
            )
