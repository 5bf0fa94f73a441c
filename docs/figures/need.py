"""Does my rig need refraction? What it costs to leave it out: the table of docs/need.md.

Three ways are tried on rigs whose truth is known: a calibration in air used as it is,
a calibration in water by OpenCV that takes the refraction for a part of the lens, and the suite's
own model, given by hand with the errors of a ruler and a protractor.
"""

from __future__ import annotations

import cv2
import numpy as np

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

CAMERA = PinholeCamera(
    [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]], np.zeros(5), (1280, 960)
)
BASELINE = 0.12
PORT = ((0.0, 0.0, 1.0), 0.03, (1.0, 1.49, 1.333), (0.008,))
SURFACE = ((0.03, 0.06, 1.0), 0.8, (1.0, 1.333))
#: Ranges of the boards that are calibrated with (m), and seed.
BOARDS, SEED = (0.6, 1.0), 5


def rig(kind: str, tilt: float = 0.0) -> StereoRig:
    """A rig with ports or above water, its surfaces tilted by so much more (rad)."""
    normal, *rest = SURFACE if kind == 'above water' else PORT
    tilt += np.radians(15.0) if 'tilted' in kind else 0.0
    surface = FlatInterface(FlatInterface(normal, *rest).tilted(0.0, tilt), *rest)
    where = (
        {'interface': surface}
        if kind == 'above water'
        else {'left_port': surface, 'right_port': surface}
    )
    return StereoRig(CAMERA, CAMERA, np.eye(3), [-BASELINE, 0.0, 0.0], **where)


def calibrated_in_water(truth: StereoRig, near: float, far: float) -> StereoRig:
    """What OpenCV's stereoCalibrate makes of boards behind the surface, five lens terms each."""
    rng = np.random.default_rng(SEED)
    board = np.zeros((54, 3), np.float32)
    board[:, :2] = 0.025 * np.stack(np.meshgrid(np.arange(9), np.arange(6)), -1).reshape(-1, 2)
    seen: list[list[np.ndarray]] = [[], []]
    while len(seen[0]) < 25:
        turn = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        middle = [*rng.uniform(-0.25, 0.25, 2), rng.uniform(near, far)]
        points = (board - board.mean(axis=0)) @ turn.T + middle
        pixels = truth.project(points)
        inside = [((p > 0) & (p < [1280, 960])).all() for p in pixels]
        if all(inside):
            for side in (0, 1):
                seen[side].append(pixels[side].astype(np.float32))
    objects = [board] * len(seen[0])
    cameras = [cv2.calibrateCamera(objects, each, CAMERA.size, None, None)[1:3] for each in seen]
    found = cv2.stereoCalibrate(
        objects, *seen, *cameras[0], *cameras[1], CAMERA.size, flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    k1, d1, k2, d2, rotation, translation = found[1:7]
    lenses = PinholeCamera(k1, d1.ravel(), CAMERA.size), PinholeCamera(k2, d2.ravel(), CAMERA.size)
    return StereoRig(*lenses, rotation, translation.ravel())


def errors(model: StereoRig, truth: StereoRig, points: np.ndarray) -> tuple[float, float]:
    """RMS of a model's positions of points, and what is left of it about their mean (mm)."""
    pixels = truth.project(points)
    method = 'straight' if model.target_index is None else 'refractive'
    found = triangulate(model, *pixels, method=method).points
    off = 1000.0 * (found - points)
    both = (off, off - np.nanmean(off, axis=0))
    whole, left = (float(np.sqrt(np.nanmean(np.sum(each**2, axis=1)))) for each in both)
    return whole, left


def main() -> None:
    """Print the table."""
    columns = (
        'rig',
        'target at (m)',
        'calibrated in air, rays straight',
        'calibrated in water by OpenCV',
        'the suite, surface 1 degree off',
    )
    print('| ' + ' | '.join(columns) + ' |')
    print('|---' * len(columns) + '|')
    for kind, ranges in (
        ('behind ports', (0.3, 0.8, 1.5, 3.0)),
        ('ports, tilted 15 degrees', (0.3, 0.8, 1.5, 3.0)),
        ('above water', (0.9, 1.0, 1.3)),
    ):
        truth = rig(kind)
        first = 0.9 if kind == 'above water' else 0.0
        wet = calibrated_in_water(truth, max(BOARDS[0], first), max(BOARDS[1], first + 0.3))
        air = StereoRig(CAMERA, CAMERA, np.eye(3), truth.translation)
        models = (air, wet, rig(kind, np.radians(1.0)))
        for distance in ranges:
            grid = np.stack(np.meshgrid([-0.15, 0.0, 0.15], [-0.1, 0.0, 0.1]), -1).reshape(-1, 2)
            points = np.column_stack([grid * min(distance, 1.0), np.full(9, distance)])
            cells = [errors(model, truth, points) for model in models]
            row = ' | '.join(f'{whole:.1f} ({left:.1f})' for whole, left in cells)
            print(f'| {kind} | {distance:g} | {row} |')


if __name__ == '__main__':
    main()
