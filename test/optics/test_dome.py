"""Domes: COLMAP's figures, there and back, least time, and where a dome is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from binopos_ros.optics import DomePort, FlatInterface, OpticsError, PinholeCamera, StereoRig

AIR, GLASS, WATER = 1.0003, 1.49, 1.333
BASELINE = np.array([-0.23, 0.0, 0.0])
WIDE = PinholeCamera(
    [[620.0, 0, 640], [0, 621, 480], [0, 0, 1]],
    (0.012, -0.006, 0.002, -0.0003),
    (1280, 960),
    'equidistant',
)
#: Of COLMAP's tests of refractive cameras; its upper-left pixel has its centre at (0.5, 0.5).
COLMAP = PinholeCamera(
    [[3200.484, 0, 2790.172 - 0.5], [0, 3200.917, 2108.726 - 0.5], [0, 0, 1]],
    (-0.233072717236466, 0.065022474710061, 1.008118149931866e-06, -2.863880315774651e-05),
    (5568, 4176),
)
FIRST = DomePort((0.00042007, 0.00366894, 0.0283927), 0.05, 0.007, (1.003, 1.473, 1.333))
SECOND = DomePort((0.0342007, 0.0366894, 0.0083927), 0.1, 0.007, (1.003, 1.523, 1.333))


def in_front(dome: DomePort | None, camera: PinholeCamera = WIDE) -> StereoRig:
    """A rig of two cameras with the same dome each, 230 mm apart."""
    return StereoRig(camera, camera, np.eye(3), BASELINE, None, dome, dome)


def domes(count: int, seed: int = 4) -> list[DomePort]:
    """Domes with walls of 3 to 20 mm, whose centre is up to 0.9 of the radius from the camera."""
    rng = np.random.default_rng(seed)
    made = []
    for share in np.linspace(0.0, 0.9, count):
        radius, away = rng.uniform(0.03, 0.15), rng.standard_normal(3)
        centre = share * radius * away / np.linalg.norm(away)
        indices = (AIR, rng.uniform(1.46, 1.53), rng.choice([AIR, WATER]))
        made.append(DomePort(centre, radius, rng.uniform(0.003, 0.02), indices))
    return made


def sights(count: int, seed: int = 4) -> np.ndarray:
    """Unit rays (N, 3) of 0 to 85 degrees off the axis."""
    rng = np.random.default_rng(seed)
    off, around = np.radians(np.linspace(0, 85, count)), rng.uniform(0, 2 * np.pi, count)
    across = np.sin(off)
    return np.stack([across * np.cos(around), across * np.sin(around), np.cos(off)], axis=1)


@pytest.mark.parametrize(
    ('dome', 'point', 'pixel'),
    [
        (FIRST, (0, 0, 1), (2795.7902624623, 2157.8033849491)),
        (FIRST, (0.3, -0.2, 1.5), (3350.3615512586, 1790.6483229831)),
        (SECOND, (-0.5, 0.5, 0.9), (1572.3489610201, 3961.8337643745)),
        (SECOND, (0.5, 0.5, 5.5), (3359.4480525955, 2699.1394830160)),
    ],
)
def test_pixels_are_colmaps(dome: DomePort, point: tuple, pixel: tuple) -> None:
    left, _ = in_front(dome, COLMAP).project(point)
    np.testing.assert_allclose(left + 0.5, pixel, atol=1e-8)


@pytest.mark.parametrize(
    'dome',
    [
        DomePort((0, 0, 0), 0.05, 0.007, (AIR, GLASS, WATER)),
        DomePort((0.01, -0.02, 0.03), 0.05, 0.007, (1.0, 1.0, 1.0)),
    ],
)
def test_a_centred_dome_and_one_of_air_are_none(dome: DomePort) -> None:
    points = 0.7 * sights(200)
    found, plain = in_front(dome).differentiate(points), in_front(None).differentiate(points)
    np.testing.assert_allclose(found.left, plain.left, atol=1e-11)
    np.testing.assert_allclose(found.left_by_point, plain.left_by_point, atol=1e-8)


def test_there_and_back_at_every_angle() -> None:
    pixels = WIDE.project(sights(105))
    for dome in domes(30):
        rig = in_front(dome)
        (start, direction), _ = rig.back_project(pixels, pixels)
        np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-14)
        outer = dome.radius + dome.thickness
        np.testing.assert_allclose(np.linalg.norm(start - dome.centre, axis=1), outer, atol=1e-14)
        for distance in (1e-4, 0.01, 1.0, 30.0):
            again, _ = rig.project(start + distance * direction)
            np.testing.assert_allclose(again, pixels, atol=1e-9)


def test_there_and_back_through_a_wall_behind_the_dome() -> None:
    """Into air, too, where light is totally reflected beyond some angle."""
    pixels = WIDE.project(sights(105))
    for dome in domes(6):
        for last in (AIR, WATER):
            wall = FlatInterface((0.2, -0.15, 1.0), 0.4, (dome.target_index, GLASS, last), (0.02,))
            rig = StereoRig(WIDE, WIDE, np.eye(3), BASELINE, wall, dome, dome)
            (start, direction), _ = rig.back_project(pixels, pixels)
            passes = np.isfinite(start).all(axis=1)
            assert passes.sum() > 40
            for distance in (1e-3, 1.0):
                again, _ = rig.project(start + distance * direction)
                np.testing.assert_allclose(again[passes], pixels[passes], atol=1e-9)


def light_time(places: np.ndarray, dome: DomePort, point: np.ndarray) -> float:
    """Optical length of a path through places on both spheres, given by tangent coordinates."""
    spheres = place_on_spheres(places, dome, point)
    corners = np.vstack([np.zeros(3), spheres, point])
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=1) @ dome.indices)


def place_on_spheres(places: np.ndarray, dome: DomePort, point: np.ndarray) -> np.ndarray:
    """Where coordinates (4,), two for each sphere, lie: (2, 3), about the straight line."""
    towards = point / np.linalg.norm(point)
    across = np.linalg.svd(towards[None])[2][1:]
    made = []
    for radius, own in zip((0, dome.thickness), places.reshape(2, 2), strict=True):
        size = dome.radius + radius
        along = towards @ dome.centre
        reach = along + np.sqrt(along**2 - dome.centre @ dome.centre + size**2)
        ray = reach * towards + own @ across - dome.centre
        made.append(dome.centre + size * ray / np.linalg.norm(ray))
    return np.array(made)


def fermat(dome: DomePort, point: np.ndarray) -> np.ndarray:
    """Direction at the camera of the path of least time; no law of refraction in it."""
    coarse = minimize(light_time, np.zeros(4), args=(dome, point), method='BFGS', tol=1e-9)

    def slope(places: np.ndarray) -> np.ndarray:
        """Derivative of the optical length along two tangents of each sphere."""
        spheres = place_on_spheres(places, dome, point)
        legs = np.diff(np.vstack([np.zeros(3), spheres, point]), axis=0)
        pull = np.array(dome.indices)[:, None] * legs / np.linalg.norm(legs, axis=1)[:, None]
        tangents = [np.linalg.svd((s - dome.centre)[None])[2][1:] for s in spheres]
        return np.concatenate([t @ (pull[i] - pull[i + 1]) for i, t in enumerate(tangents)])

    fine = least_squares(slope, coarse.x, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert light_time(fine.x, dome, point) <= coarse.fun + 1e-12
    return place_on_spheres(fine.x, dome, point)[0]


def test_the_ray_is_the_path_of_least_time() -> None:
    for dome, ray in zip(domes(10), sights(10)[::-1], strict=True):
        rig = in_front(dome)
        (start, direction), _ = rig.back_project(WIDE.project(ray), WIDE.project(ray))
        for distance in (0.05, 1.0):
            point = start + distance * direction
            expected = WIDE.project(fermat(dome, point))
            np.testing.assert_allclose(rig.project(point)[0], expected, atol=1e-7)


def test_jacobians_agree_with_differences_at_every_angle() -> None:
    h = 1e-6
    for dome in domes(6):
        rig = in_front(dome)
        (start, direction), _ = rig.back_project(WIDE.project(sights(40)), np.zeros(2))
        points = start + 0.5 * direction
        found, names = rig.differentiate(points), rig.parameter_names
        by_names, _ = rig.parameter_jacobian(points)
        scale = np.abs(found.left_by_point).max()
        for axis, step in enumerate(h * np.eye(3)):
            difference = (rig.project(points + step)[0] - rig.project(points - step)[0]) / (2 * h)
            np.testing.assert_allclose(
                found.left_by_point[:, :, axis], difference, atol=1e-6 * scale
            )
        np.testing.assert_allclose(by_names[:, :, 0], found.left_by_index, atol=1e-7)
        for k, name in enumerate(names):
            step = h * (np.arange(len(names)) == k)
            ahead, behind = (rig.perturbed(s * step).project(points)[0] for s in (1, -1))
            scale = max(np.abs(by_names[:, :, k]).max(), 1.0)
            np.testing.assert_allclose(
                by_names[:, :, k], (ahead - behind) / (2 * h), atol=1e-6 * scale, err_msg=name
            )


def test_a_wall_that_does_nothing_behind_a_dome_changes_nothing() -> None:
    """Another solver, the same rays."""
    wall = FlatInterface((0.1, -0.2, 1.0), 0.4, (WATER, WATER))
    points = np.random.default_rng(1).uniform([-1, -1, 0.8], [1, 1, 2], (100, 3))
    plain = in_front(FIRST)
    both = StereoRig(WIDE, WIDE, np.eye(3), BASELINE, wall, FIRST, FIRST)
    for a, b in zip(both.project(points), plain.project(points), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_a_wall_behind_a_centred_dome_is_a_wall_alone() -> None:
    """And where its far side is air, light that would be totally reflected still finds its way."""
    dome = DomePort((0, 0, 0), 0.05, 0.007, (WATER, GLASS, WATER))
    wall = FlatInterface((0.1, -0.2, 1.0), 0.4, (WATER, GLASS, 1.0), (0.01,))
    points = np.random.default_rng(1).uniform([-2, -2, 0.8], [2, 2, 1.5], (100, 3))
    plain = StereoRig(WIDE, WIDE, np.eye(3), BASELINE, wall)
    both = StereoRig(WIDE, WIDE, np.eye(3), BASELINE, wall, dome, dome)
    for a, b in zip(both.project(points), plain.project(points), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize(
    ('point', 'says'),
    [
        ((0, 0, 0.05), 'camera side'),
        ((0.0, 0.0, 0.0), 'camera side'),
        ((0.3, 0.0, -0.4), '90 degrees or more off the axis'),
        ((np.nan, 0, 1), 'not a finite number'),
    ],
)
def test_what_is_not_seen_through_a_dome_has_a_reason(point: tuple, says: str) -> None:
    rig = in_front(FIRST)
    assert np.isnan(rig.project(point)[0]).all()
    assert says in rig.explain(point)[0]


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (((0, 0), 0.05, 0.007, (1, 1.5, 1.33)), 'centre must be three numbers'),
        (((0, 0, np.nan), 0.05, 0.007, (1, 1.5, 1.33)), 'centre must be three numbers'),
        (((0, 0, 0), 0.0, 0.007, (1, 1.5, 1.33)), 'inner radius must be above 0'),
        (((0, 0, 0), 0.05, np.nan, (1, 1.5, 1.33)), 'thickness must be above 0'),
        (((0, 0, 0), 0.05, 0.007, (1, 1.33)), 'parts 3 media, but 2'),
        (((0, 0, 0), 0.05, 0.007, (1, 9, 1.33)), r'indices\[1\] = 9'),
        (((0, 0, 0.06), 0.05, 0.007, (1, 1.5, 1.33)), 'must stand inside its dome'),
    ],
)
def test_impossible_domes_are_refused_in_one_line(arguments: tuple, says: str) -> None:
    with pytest.raises(OpticsError, match=says) as caught:
        DomePort(*arguments)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'interface': FIRST}, 'a dome belongs to one camera'),
        (
            {'interface': FlatInterface((0, 0, 1), 0.06, (1.333, 1.0)), 'left_port': FIRST},
            'reaches beyond the interface',
        ),
        (
            {'interface': FlatInterface((0, 0, 1), 0.5, (1.0, 1.4)), 'left_port': FIRST},
            'ends in a medium of index 1.333',
        ),
    ],
)
def test_domes_that_fit_nowhere_are_refused_in_one_line(change: dict, says: str) -> None:
    with pytest.raises(OpticsError, match=says) as caught:
        StereoRig(WIDE, WIDE, np.eye(3), BASELINE, **change)
    assert '\n' not in str(caught.value)
