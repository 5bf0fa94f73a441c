"""What to expect from the pool deck: the table of docs/pool.md.

Two cameras of 900 px look straight down on the water 1.5 m below; the prop's centre is known to
0.2 px in both pictures. *off* is a surface that was measured 10 mm and half a degree wrong.
"""

from __future__ import annotations

import numpy as np

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

CAMERA = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
DECK = 1.5  # m
NOISE = 0.2**2 * np.eye(2)  # px^2
LEANING = (np.tan(np.radians(0.5)), 0.0, 1.0)


def main() -> None:
    """Print the table."""
    print('| baseline | prop under water | across | along | straight rays | surface off |')
    print('|---|---|---|---|---|---|')
    for baseline in (0.3, 0.6):
        rig, off = (
            StereoRig(
                CAMERA,
                CAMERA,
                np.eye(3),
                (-baseline, 0, 0),
                FlatInterface(normal, distance, (1.0, 1.333)),
            )
            for normal, distance in (((0, 0, 1), DECK), (LEANING, DECK + 0.01))
        )
        for depth in (1.0, 2.0, 4.0):
            prop = np.array([baseline / 2, 0.1, DECK + depth])
            pixels = rig.project(prop)
            found = triangulate(rig, *pixels, NOISE, NOISE)
            across, _, along = 1e3 * np.sqrt(np.diag(found.covariances))
            straight = triangulate(rig, *pixels, method='straight').points - prop
            wrong = triangulate(off, *pixels).points - prop
            bent, leaning = (1e3 * np.linalg.norm(each) for each in (straight, wrong))
            print(
                f'| {baseline} m | {depth:g} m | {across:.1f} mm | {along:.0f} mm '
                f'| {bent:.0f} mm | {leaning:.1f} mm |'
            )


if __name__ == '__main__':
    main()
