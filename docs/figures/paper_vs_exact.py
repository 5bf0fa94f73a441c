"""By how much the paper's method misses the target, over incidence and depth.

Noise-free images of known points through a water surface, triangulated by the paper's method
(straight rays to one virtual point, then one refraction, Eq. 4-12 mended). What is left is the
method's own error: the straight rays do not meet in one point.

    python docs/figures/paper_vs_exact.py

prints the table of docs/paper.md and writes docs/figures/paper_vs_exact.png.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation.paper import triangulate_paper

BASELINE = 0.23
SURFACE = 0.8
INDEX = 1.333
AZIMUTHS = {
    'beyond the left camera': 180.0,
    'beyond the right camera': 0.0,
    'at 45 degrees, left': 135.0,
    'across the baseline': 90.0,
}
TABLE_ANGLES = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
TABLE_DEPTHS = (0.05, 0.2, 0.5, 1.0)


def washbowl() -> StereoRig:
    """The paper's rig: parallel cameras that look straight down on the water."""
    camera = PinholeCamera(
        [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]], [], (1280, 960)
    )
    surface = FlatInterface((0.0, 0.0, 1.0), SURFACE, (1.0, INDEX))
    return StereoRig(camera, camera, np.eye(3), (-BASELINE, 0.0, 0.0), surface)


def targets(angles: np.ndarray, depths: np.ndarray, azimuth: float) -> np.ndarray:
    """Points (A, D, 3) seen from the middle of the baseline under the angles of incidence."""
    sine = np.sin(np.radians(angles))[:, None]
    reach = SURFACE * np.tan(np.radians(angles))[:, None]
    reach = reach + depths * sine / np.sqrt(INDEX**2 - sine**2)
    x = BASELINE / 2 + reach * np.cos(np.radians(azimuth))
    y = reach * np.sin(np.radians(azimuth))
    return np.stack(np.broadcast_arrays(x, y, SURFACE + depths), axis=-1)


def errors(rig: StereoRig, points: np.ndarray) -> np.ndarray:
    """Distance (A, D) between what the paper's method finds and the truth, m."""
    flat = points.reshape(-1, 3)
    found, _ = triangulate_paper(rig, *rig.project(flat))
    return np.linalg.norm(found - flat, axis=1).reshape(points.shape[:2])


def main() -> None:
    rig = washbowl()
    print(
        f"Error of the paper's method, mm (baseline {BASELINE} m, surface at {SURFACE} m, "
        f'n = {INDEX}, no noise)'
    )
    for name, azimuth in AZIMUTHS.items():
        print(
            f'\nTarget {name}\n\n| incidence | '
            + ' | '.join(f'{depth:g} m of water' for depth in TABLE_DEPTHS)
            + ' |'
        )
        print('|---' * (len(TABLE_DEPTHS) + 1) + '|')
        points = targets(np.array(TABLE_ANGLES), np.array(TABLE_DEPTHS), azimuth)
        for angle, row in zip(TABLE_ANGLES, errors(rig, points), strict=True):
            print(f'| {angle:.0f} deg | ' + ' | '.join(f'{1e3 * e:.2f}' for e in row) + ' |')

    angles, depths = np.linspace(0.0, 65.0, 131), np.linspace(0.02, 1.0, 99)
    figure, panels = plt.subplots(1, 4, figsize=(15, 4.2), sharey=True, layout='constrained')
    for panel, (name, azimuth) in zip(panels, AZIMUTHS.items(), strict=True):
        millimetres = 1e3 * errors(rig, targets(angles, depths, azimuth))
        image = panel.pcolormesh(
            angles,
            depths,
            np.maximum(millimetres, 1e-3).T,
            norm=LogNorm(1e-2, 1e2),
            shading='auto',
        )
        levels = (0.1, 1.0, 10.0)
        if millimetres.max() > levels[0]:
            lines = panel.contour(angles, depths, millimetres.T, levels, colors='white')
            panel.clabel(lines, fmt='%g mm')
        panel.set(title=f'target {name}', xlabel='angle of incidence, degrees')
    panels[0].set_ylabel('depth of water over the target, m')
    figure.colorbar(image, ax=panels, label="error of the paper's method, mm")
    path = Path(__file__).with_suffix('.png')
    figure.savefig(path, dpi=110)


if __name__ == '__main__':
    main()
