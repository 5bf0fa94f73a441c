"""How far the outline's centre is from the image of the disc's centre, and after correction.

Run as `python docs/figures/detection_disc_centre.py`. Discs under water, by the tests' renderer;
the correction is given the disc's position 3 mm off, as a first triangulation may be.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import numpy as np

import rendered
from binopos_ros.detection import detect
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.disc import disc_outlines

TILTS = (0, 20, 40, 50, 60)
SCENES = 10


def offsets(diameter: int, tilt: float, rng: np.random.Generator) -> tuple[float, float]:
    """Mean distance from the disc's centre, before and after correction, px."""
    before, after = [], []
    size = int(1.3 * diameter + 56)
    for _ in range(SCENES):
        view = rendered.View(width=size, height=size, offset=tuple(rng.uniform(-200, 200, 2)))
        place = (size / 2, size / 2)
        azimuth = rng.uniform(0, 2 * np.pi)
        disc = rendered.disc_of(view, diameter, np.radians(tilt), azimuth, place)
        scene = rendered.scene(view, disc, 0.7, samples=int(np.clip(320 / diameter, 5, 10)))
        target = detect(rendered.picture(scene, rendered.Look(noise=1.0), rng))
        if target is None:
            continue
        u, v = view.principal
        matrix = [[view.focal, 0, u], [0, view.focal, v], [0, 0, 1]]
        camera = PinholeCamera(matrix, (), (size, size))
        surface = FlatInterface(view.normal, view.depth, (1.0, view.index))
        rig = StereoRig(camera, camera, np.eye(3), (-0.23, 0, 0), surface)
        (outline,) = disc_outlines(
            lambda points, rig=rig: rig.project(points)[:1],
            np.add(disc.centre, (0.001, -0.001, 0.003)),
            np.array(disc.normal),
            disc.diameter,
        )
        before.append(np.linalg.norm(target.centre - scene.disc_centre))
        after.append(np.linalg.norm(target.centre - outline.offset - scene.disc_centre))
    return float(np.mean(before)), float(np.mean(after))


def main() -> int:
    rng = np.random.default_rng(3)
    print('diameter    tilt   outline   corrected (mean distance from the disc centre, px)')
    for diameter in (20, 40, 120):
        for tilt in TILTS:
            before, after = offsets(diameter, tilt, rng)
            print(f'{diameter:5} px{tilt:7} deg{before:9.3f}{after:12.4f}')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
