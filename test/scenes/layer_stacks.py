"""Stacks of layers, and rigs of every kind that look through them."""

from __future__ import annotations

import numpy as np

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig

AIR, GLASS, ACRYLIC, WATER = 1.0003, 1.46, 1.49, 1.333

STACKS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    'air/water': ((AIR, WATER), ()),
    'air/glass/water': ((AIR, GLASS, WATER), (0.006,)),
    'air/glass/air': ((AIR, GLASS, AIR), (0.01,)),
    'water/glass/air': ((WATER, GLASS, AIR), (0.01,)),
    'water/air': ((WATER, AIR), ()),
    'air/glass/acrylic/water': ((AIR, GLASS, ACRYLIC, WATER), (0.004, 0.02)),
    'salt gradient': (
        (AIR, *np.linspace(1.333, 1.37, 30).tolist()),
        (*[0.4 / 29] * 29,),
    ),
    'housing in salt gradient': (
        (AIR, GLASS, *np.linspace(1.333, 1.37, 10).tolist()),
        (0.006, *[0.04] * 9),
    ),
}


def rotation(x: float, y: float, z: float) -> np.ndarray:
    """Turn about x, then y, then z, rad."""
    cx, sx, cy, sy, cz, sz = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(z), np.sin(z)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]) @ about_y @ about_x


def camera() -> PinholeCamera:
    """A camera with every usual term."""
    matrix = np.array([[820.0, 0.3, 645.0], [0.0, 823.0, 478.0], [0.0, 0.0, 1.0]])
    return PinholeCamera(matrix, [-0.21, 0.06, 1e-3, -7e-4, 0.01], (1280, 960))


def make_rigs() -> dict[str, StereoRig]:
    """Rigs of every kind: none, one shared surface, ports or domes, and these before a wall."""
    left = right = camera()
    place = rotation(0.03, 0.1, -0.02), np.array([-0.23, 0.01, 0.02])
    port = FlatInterface((0.1, 0.05, 1.0), 0.03, (AIR, GLASS, WATER), (0.006,))
    other = FlatInterface((-0.1, 0.02, 1.0), 0.035, (AIR, GLASS, WATER), (0.006,))
    wall = FlatInterface((-0.2, 0.1, 1.0), 0.6, (WATER, ACRYLIC, AIR), (0.01,))
    rigs = {'air': StereoRig(left, right, *place)}
    for name, (indices, thicknesses) in STACKS.items():
        surface = FlatInterface((0.1, -0.08, 1.0), 0.5, indices, thicknesses)
        rigs[name] = StereoRig(left, right, *place, surface)
    rigs['ports'] = StereoRig(left, right, *place, None, port, other)
    rigs['ports before a wall'] = StereoRig(left, right, *place, wall, port, other)
    dome = DomePort((0.004, -0.003, 0.012), 0.05, 0.007, (AIR, ACRYLIC, WATER))
    other_dome = DomePort((-0.02, 0.03, -0.01), 0.06, 0.004, (AIR, GLASS, WATER))
    rigs['domes'] = StereoRig(left, right, *place, None, dome, other_dome)
    rigs['domes before a wall'] = StereoRig(left, right, *place, wall, dome, other_dome)
    rigs['a dome and a port'] = StereoRig(left, right, *place, None, dome, other)
    return rigs


RIGS = make_rigs()
