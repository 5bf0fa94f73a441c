"""Draw docs/figures/domes.png: what a dome does to positions that does not sit on its camera.

Run as `python docs/figures/domes.py`. Two cameras 0.12 m apart behind domes of 50 mm with 5 mm of
acrylic, in water; targets on the axis between them. Prints the figures that docs/domes.md quotes.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import matplotlib.pyplot as plt
import numpy as np

from binopos_ros.optics import DomePort, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

BASELINE = 0.12
MEDIA = (1.0, 1.49, 1.333)
RADIUS, WALL = 0.05, 0.005
NOISE = 0.01 * np.eye(2)  # px^2


def rig_with(left: tuple[float, ...], right: tuple[float, ...]) -> StereoRig:
    """Return the rig whose domes' centres lie off their cameras by so much, m."""
    camera = PinholeCamera([[800, 0, 640], [0, 800, 480], [0, 0, 1]], (), (1280, 960))
    domes = (DomePort(centre, RADIUS, WALL, MEDIA) for centre in (left, right))
    return StereoRig(camera, camera, np.eye(3), (-BASELINE, 0, 0), None, *domes)


def error(rig: StereoRig, depth: float) -> float:
    """Return how much too far, mm, a target at a depth (m) comes out without its domes."""
    point = np.array([BASELINE / 2, 0.0, depth])
    ignored = StereoRig(rig.left, rig.right, rig.rotation, rig.translation)
    found = triangulate(ignored, *rig.project(point), method='straight')
    return float(1e3 * (found.points - point)[2])


def spread(deviation: float, depth: float) -> float:
    """Return the deviation of range, mm, by that of both domes' centres, m, in each direction."""
    rig = rig_with((0, 0, 0), (0, 0, 0))
    pixels = rig.project(np.array([BASELINE / 2, 0.0, depth]))
    known = [deviation if '.centre.' in name else 0.0 for name in rig.parameter_names]
    more, less = (
        triangulate(rig, *pixels, NOISE, NOISE, parameter_covariance=np.diag(np.square(std)))
        for std in (known, np.zeros(len(known)))
    )
    return float(1e3 * np.sqrt(more.covariances[2, 2] - less.covariances[2, 2]))


def main() -> None:
    """Draw both panels, and print what the text quotes."""
    figure, (ahead, aside) = plt.subplots(1, 2, figsize=(10, 3.8), constrained_layout=True)
    offsets = np.linspace(-5e-3, 5e-3, 41)
    for depth in (0.5, 1.0, 2.0):
        along = [error(rig_with((0, 0, o), (0, 0, o)), depth) for o in offsets]
        ahead.plot(1e3 * offsets, along, label=f'{depth:g} m')
        across = [error(rig_with((o, 0, 0), (-o, 0, 0)), depth) for o in offsets]
        aside.plot(1e3 * offsets, across, label=f'{depth:g} m')
    ahead.set(xlabel='centre ahead of the camera (mm)', ylabel='error of range, dome ignored (mm)')
    aside.set(xlabel='centre to the right, left housing; to the left, right (mm)')
    ahead.legend(title='target at')
    for axes in (ahead, aside):
        axes.grid(alpha=0.3)
    figure.savefig(Path(__file__).with_name('domes.png'), dpi=90)

    print('| target at | 1 mm ahead, both | 1 mm apart, sideways | centres known to 0.2 mm |')
    print('|---|---|---|---|')
    both, apart = (rig_with((0, 0, 1e-3), (0, 0, 1e-3)), rig_with((1e-3, 0, 0), (-1e-3, 0, 0)))
    for depth in (0.5, 1.0, 2.0):
        print(
            f'| {depth:g} m | {error(both, depth):+.1f} mm | {error(apart, depth):+.1f} mm '
            f'| {spread(2e-4, depth):.1f} mm |'
        )


if __name__ == '__main__':
    main()
