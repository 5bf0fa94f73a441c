"""The simulator: how true its pictures are, and what they cost.

    python bench/simulation/rendering.py

Bias is the centre of mass of a white disc's light in the dark against the centroid of its
outline, of which 4000 points are traced one by one; over 8 places each. Times are of one
processor.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np

from binopos_ros.simulation import PRESETS, Choices, Disc, Renderer, Scene, Sensor, Water
from binopos_ros.simulation.backdrop import OpenWater
from binopos_ros.simulation.target import HarmonicPath
from figures import Column, Figures

CLEAR = Water(absorption=(0.0, 0.0, 0.0), scattering=0.0, veil=(0.0, 0.0, 0.0))
DARKNESS = OpenWater(np.array([0, 1.0, 0]), 10.0, np.zeros((2, 2, 3), np.float32), CLEAR)
PICTURES = 20
FRAMES, ROUNDS = 1000, 5


def main() -> None:
    found = Figures('simulation/rendering')
    table = found.table(
        'truth',
        'disc in the bowl',
        Column('diameter (px)', '.1f'),
        Column('mean bias (px)', '.4f'),
        Column('worst of 8 (px)', '.4f'),
        Column('area (relative)', '.5f'),
    )
    for label, waves in (('calm', None), ('waves of 0.4 mm', 0.0004)):
        for diameter in (0.012, 0.03, 0.1):
            wide, errors, areas = biases(waves, diameter)
            bias = float(np.linalg.norm(errors.mean(axis=0)))
            table.row(label, wide, bias, np.abs(errors).max(), np.abs(areas).max())
    table = found.table(
        'pictures',
        'pictures, noise and JPEG included',
        Column('one pair, one processor (ms)', '.0f'),
    )
    for name, choices in (
        ('washbowl', Choices()),
        ('washbowl', Choices(waves=0.0007)),
        ('ports', Choices()),
        ('demo', Choices()),
    ):
        label = name + (', waves' if choices.waves else '')
        table.row(label, 1e3 * costs_of_pairs(PRESETS[name].make(choices)))
    table = found.table(
        'pixels', 'apparent pixels, without pictures', Column('pairs a second', ',.0f')
    )
    for label, choices in (('calm', Choices()), ('waves', Choices(waves=0.0007))):
        scene = PRESETS['washbowl'].make(choices)
        times = scene.times(FRAMES)
        rates = []
        for _ in range(ROUNDS):
            start = time.process_time()
            scene.measurements(times)
            rates.append(FRAMES / (time.process_time() - start))
        table.row(label, rates)
    found.keep()


def biases(waves: float | None, diameter: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Apparent diameter, errors of the centre (8, 2) px and of the area (8,), relative."""
    scene = PRESETS['demo'].make(Choices(waves=waves))
    errors, areas, wide = [], [], 0.0
    for moment in np.linspace(0.1, 9, 8):
        positions, normals = scene.path.poses(moment)
        lit = dataclasses.replace(
            scene,
            water=CLEAR,
            backdrop=DARKNESS,
            target=Disc(diameter, (1.0, 1.0, 1.0)),
            path=HarmonicPath(positions[0], normals[0]),
            sensor=Sensor(exposure=1.0, blur=0.6),
        )
        share = Renderer(lit, 0).light(moment)[..., 1].astype(float) / 255
        v, u = np.mgrid[: share.shape[0], : share.shape[1]]
        centre, area = outline(lit, moment)
        errors.append(np.array([(u * share).sum(), (v * share).sum()]) / share.sum() - centre)
        areas.append(share.sum() / area - 1)
        wide = np.sqrt(4 * area / np.pi)
    return wide, np.array(errors), np.array(areas)


def outline(scene: Scene, moment: float) -> tuple[np.ndarray, float]:
    """Centroid (px) and area (px^2) of the disc's outline, by Green's theorem."""
    positions, normals = scene.path.poses(moment)
    first = np.cross(normals[0], [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(normals[0], first)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)[:, None]
    rim = positions[0] + scene.target.diameter / 2 * (
        np.cos(angle) * first + np.sin(angle) * second
    )
    points = scene.views[0].apparent(rim, moment)
    start = points.mean(axis=0)
    a = points - start
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    area = cross.sum() / 2
    return start + ((a + b) * cross[:, None]).sum(axis=0) / (6 * area), abs(area)


def costs_of_pairs(scene: Scene) -> np.ndarray:
    """Processor seconds of each pair, noise and JPEG included."""
    renderers = [Renderer(scene, side) for side in range(2)]
    taken = []
    for number in range(PICTURES):
        start = time.process_time()
        for renderer in renderers:
            noise = np.random.Generator(np.random.SFC64([0, number]))
            scene.sensor.encode(renderer.picture(number / scene.rate, noise))
        taken.append(time.process_time() - start)
    return np.array(taken)


if __name__ == '__main__':
    main()
