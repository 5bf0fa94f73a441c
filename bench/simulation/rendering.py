"""The simulator: how true its pictures are, and what they cost.

    python bench/simulation/rendering.py

Bias is the centre of mass of a white disc's light in the dark against the centroid of its
outline, of which 4000 points are traced one by one; over 8 places each. Times are of one
processor.
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from binopos_ros.simulation import PRESETS, Choices, Disc, Renderer, Scene, Sensor, Water
from binopos_ros.simulation.backdrop import OpenWater
from binopos_ros.simulation.target import HarmonicPath

CLEAR = Water(absorption=(0.0, 0.0, 0.0), scattering=0.0, veil=(0.0, 0.0, 0.0))
DARKNESS = OpenWater(np.array([0, 1.0, 0]), 10.0, np.zeros((2, 2, 3), np.float32), CLEAR)
PICTURES = 20
FRAMES = 1000


def main() -> None:
    print('disc in the bowl   diameter (px)   bias (px)   worst (px)   area (relative)')
    for label, waves in (('calm', None), ('waves of 0.4 mm', 0.0004)):
        for diameter in (0.012, 0.03, 0.1):
            wide, errors, areas = biases(waves, diameter)
            print(
                f'{label:16} {wide:12.1f} {np.linalg.norm(errors.mean(axis=0)):14.5f}'
                f' {np.abs(errors).max():12.5f} {np.abs(areas).max():14.5f}'
            )
    print('\npictures           per pair (ms)')
    for name, choices in (
        ('washbowl', Choices()),
        ('washbowl', Choices(waves=0.0007)),
        ('ports', Choices()),
        ('demo', Choices()),
    ):
        label = name + (', waves' if choices.waves else '')
        print(f'{label:16} {1e3 * cost_of_pair(PRESETS[name].make(choices)):12.0f}')
    print('\napparent pixels of the disc without rendering, pairs per second')
    for label, choices in (('calm', Choices()), ('waves', Choices(waves=0.0007))):
        scene = PRESETS['washbowl'].make(choices)
        times = scene.times(FRAMES)
        start = time.process_time()
        scene.measurements(times)
        print(f'{label:16} {FRAMES / (time.process_time() - start):12.0f}')


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


def cost_of_pair(scene: Scene) -> float:
    """Processor seconds of one pair, noise and JPEG included."""
    renderers = [Renderer(scene, side) for side in range(2)]
    start = time.process_time()
    for number in range(PICTURES):
        for renderer in renderers:
            noise = np.random.Generator(np.random.SFC64([0, number]))
            scene.sensor.encode(renderer.picture(number / scene.rate, noise))
    return (time.process_time() - start) / PICTURES


if __name__ == '__main__':
    main()
