"""Pictures against analytic integrals: the disc's centre and area, free of sampling's bias."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from binopos_ros.optics import PinholeCamera, StereoRig
from binopos_ros.simulation.backdrop import OpenWater, sample
from binopos_ros.simulation.disc_painter import half_plane_coverage
from binopos_ros.simulation.presets import Choices, domes, ports, washbowl
from binopos_ros.simulation.raster import NODE_SPACING, interpolate
from binopos_ros.simulation.render import Renderer
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Sensor
from binopos_ros.simulation.target import Disc, HarmonicPath
from binopos_ros.simulation.water import Water

Array = NDArray[np.float64]
#: What the pictures are allowed, px. Most of it is no fault of theirs: for a disc of few pixels
#: the centre of mass of exact pixel areas itself wanders by 0.003 px about the disc's centre.
TOLERANCE = 0.005
CLEAR = Water(absorption=(0.0, 0.0, 0.0), scattering=0.0, veil=(0.0, 0.0, 0.0))
DARKNESS = OpenWater(np.array([0, 1.0, 0]), 10.0, np.zeros((2, 2, 3), np.float32), CLEAR)
WHITE = (1.0, 1.0, 1.0)


def lit_disc(scene: Scene, diameter: float, position: Array, normal: Array, blur: float) -> Scene:
    """The scene with a white disc alone in the dark."""
    return dataclasses.replace(
        scene,
        water=CLEAR,
        backdrop=DARKNESS,
        target=Disc(diameter, WHITE),
        path=HarmonicPath(position, normal / np.linalg.norm(normal)),
        sensor=Sensor(exposure=1.0, blur=blur),
    )


def centre_and_area(light: NDArray[np.float32]) -> tuple[Array, float]:
    """Centre of mass (px) and area (px^2) of the light of a white disc."""
    share = light[..., 1].astype(float) / 255
    v, u = np.mgrid[: share.shape[0], : share.shape[1]]
    area = share.sum()
    return np.array([(u * share).sum(), (v * share).sum()]) / area, area


def outline_integral(scene: Scene, side: int, time: float) -> tuple[Array, float]:
    """The same from the outline: 4000 rim points, each seen by itself, and Green's theorem."""
    positions, normals = scene.path.poses(time)
    reference = np.eye(3)[np.argmin(np.abs(normals[0]))]
    first = np.cross(normals[0], reference)
    first /= np.linalg.norm(first)
    second = np.cross(normals[0], first)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    rim = positions[0] + scene.target.diameter / 2 * (
        np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    )
    outline = scene.views[side].apparent(rim, time)
    return polygon(outline)


def polygon(outline: Array) -> tuple[Array, float]:
    start = outline.mean(axis=0)
    a = outline - start
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    area = cross.sum() / 2
    return start + ((a + b) * cross[:, None]).sum(axis=0) / (6 * area), abs(area)


@pytest.mark.parametrize('blur', [0.0, 0.8])
@pytest.mark.parametrize('radius', [4.0, 19.0, 60.0])
def test_a_disc_in_air_square_to_the_camera_is_a_circle_at_its_projection(
    radius: float, blur: float
) -> None:
    """No tracing in the truth: a pinhole turns such a disc into a circle of known place."""
    camera = PinholeCamera(
        np.array([[500.0, 0, 160], [0, 500, 120], [0, 0, 1]]), np.zeros(5), (320, 240)
    )
    rig = StereoRig(camera, camera, np.eye(3), [-0.1, 0, 0])
    rng = np.random.default_rng(int(radius))
    base = Scene(rig, CLEAR, DARKNESS, HarmonicPath(np.zeros(3), np.array([0, 0, -1.0])))
    for _ in range(5):
        centre = np.array([160, 120]) + rng.uniform(-20, 20, 2)
        position = np.append((centre - [160, 120]) / 500, 1.0) * 0.8
        scene = lit_disc(base, 2 * radius * 0.8 / 500, position, np.array([0, 0, -1.0]), blur)
        found, area = centre_and_area(Renderer(scene, 0).light(0.0))
        np.testing.assert_allclose(found, centre, atol=TOLERANCE if radius < 5 else 5e-4)
        assert area == pytest.approx(np.pi * radius**2, rel=2e-3 if radius < 5 else 2e-4)


@pytest.mark.parametrize('tilt', [0.0, 0.6, 1.2])
@pytest.mark.parametrize('side', [0, 1])
def test_a_tilted_disc_in_the_bowl_is_unbiased(side: int, tilt: float) -> None:
    scene = washbowl(half_size=True)
    position, normal = (values[0] for values in scene.path.poses(0.4))
    position = position + 0.05 * normal
    turned = normal * np.cos(tilt) + np.array([1.0, 0.3, 0]) * np.sin(tilt)
    scene = lit_disc(scene, 0.06, position, turned, 0.6)
    found, area = centre_and_area(Renderer(scene, side).light(0.4))
    expected, expected_area = outline_integral(scene, side, 0.4)
    np.testing.assert_allclose(found, expected, atol=0.002)
    assert area == pytest.approx(expected_area, rel=1e-3)


@pytest.mark.parametrize(('make', 'diameter'), [(ports, 0.01), (ports, 0.08), (domes, 0.08)])
def test_a_disc_behind_the_ports_is_unbiased(make: type, diameter: float) -> None:
    scene = make()
    position, normal = (values[0] for values in scene.path.poses(1.3))
    scene = lit_disc(scene, diameter, position, normal, 0.0)
    found, area = centre_and_area(Renderer(scene, 1).light(1.3))
    expected, expected_area = outline_integral(scene, 1, 1.3)
    np.testing.assert_allclose(found, expected, atol=TOLERANCE)
    assert area == pytest.approx(expected_area, rel=5e-3)


def test_a_disc_under_waves_is_unbiased() -> None:
    scene = washbowl(Choices(waves=0.0004, seed=8), half_size=True)
    position, normal = (values[0] for values in scene.path.poses(0.0))
    for time in (0.0, 0.21, 0.77):
        lit = lit_disc(scene, 0.06, position, normal, 0.6)
        found, area = centre_and_area(Renderer(lit, 0).light(time))
        expected, expected_area = outline_integral(lit, 0, time)
        np.testing.assert_allclose(found, expected, atol=0.003)
        assert area == pytest.approx(expected_area, rel=1e-3)


def test_the_truth_is_where_the_picture_shows_the_disc() -> None:
    """In the calm preset itself, on an even floor: red against the same picture without disc."""
    scene = washbowl(half_size=True)
    even = np.full((8, 8, 3), 0.5, np.float32)
    scene = dataclasses.replace(scene, backdrop=dataclasses.replace(scene.backdrop, floor=even))
    bare = dataclasses.replace(scene, target=Disc(1e-6))
    for side in range(2):
        with_disc = Renderer(scene, side).light(0.5).astype(float)
        without = Renderer(bare, side).light(0.5).astype(float)
        red = with_disc[..., 2] - with_disc[..., 1] - without[..., 2] + without[..., 1]
        v, u = np.mgrid[: red.shape[0], : red.shape[1]]
        found = np.array([(u * red).sum(), (v * red).sum()]) / red.sum()
        expected, _ = outline_integral(scene, side, 0.5)
        np.testing.assert_allclose(found, expected, atol=TOLERANCE)
        # Perspective and refraction put the outline's centre beside the image of the centre.
        np.testing.assert_allclose(scene.measurements([0.5])[side][0], expected, atol=0.1)


@pytest.mark.parametrize('offset', [(0.1, 0.2), (0.5, 0.35), (0.77, 0.9)])
def test_coverage_of_a_small_disc_is_exact_in_every_pixel(offset: tuple[float, float]) -> None:
    """Against 128 x 128 points in each pixel."""
    camera = PinholeCamera(
        np.array([[500.0, 0, 20], [0, 500, 16], [0, 0, 1]]), np.zeros(5), (40, 32)
    )
    rig = StereoRig(camera, camera, np.eye(3), [-0.1, 0, 0])
    base = Scene(rig, CLEAR, DARKNESS, HarmonicPath(np.zeros(3), np.array([0, 0, -1.0])))
    position = np.array([offset[0] / 500, offset[1] / 500, 1.0])
    scene = lit_disc(base, 2 * 4.0 / 500, position, np.array([0, 0, -1.0]), 0.0)
    share = Renderer(scene, 0).light(0.0)[..., 1] / 255
    ticks = (np.arange(128) + 0.5) / 128 - 0.5
    v, u = np.mgrid[:32, :40]
    inside = (u[..., None, None] + ticks - 20 - offset[0]) ** 2 + (
        v[..., None, None] + ticks[:, None] - 16 - offset[1]
    ) ** 2 < 16.0
    np.testing.assert_allclose(share, inside.mean(axis=(2, 3)), atol=2e-3)


def test_the_wavy_background_lies_where_the_exact_trace_has_it() -> None:
    """Interpolated floor positions in units of pixels, against a ray through every pixel."""
    scene = washbowl(Choices(waves=0.001, seed=2))
    view, basin = scene.views[0], scene.backdrop
    columns, rows = np.arange(600, 600 + 13 * NODE_SPACING), np.arange(400, 400 + 9 * NODE_SPACING)
    u, v = np.meshgrid(columns, rows)
    exact = basin.floor_hits(view.look(np.column_stack([u.ravel(), v.ravel()]), 0.6))
    nodes_u, nodes_v = np.meshgrid(
        600 + NODE_SPACING * np.arange(-2, 13 + 3), 400 + NODE_SPACING * np.arange(-2, 9 + 3)
    )
    nodes = basin.floor_hits(
        view.look(np.column_stack([nodes_u.ravel(), nodes_v.ravel()]), 0.6)
    ).reshape(*nodes_u.shape, 2)
    exact = exact.reshape(*u.shape, 2)
    pixel = np.linalg.norm(np.diff(exact, axis=1), axis=2).mean()
    for axis in range(2):
        dense = interpolate(nodes[..., axis].astype(np.float32))
        assert np.abs(dense - exact[..., axis]).max() / pixel < 0.005


def test_coverage_of_half_planes_against_a_fine_grid() -> None:
    rng = np.random.default_rng(0)
    slopes = rng.normal(size=(200, 2))
    slopes[:20, 0] = 0.0
    slopes[20:30, 1] = slopes[20:30, 0]
    values = rng.uniform(-1, 1, 200) * np.abs(slopes).sum(axis=1)
    ticks = (np.arange(400) + 0.5) / 400 - 0.5
    x, y = np.meshgrid(ticks, ticks)
    for value, (slope_x, slope_y) in zip(values, slopes, strict=True):
        share = half_plane_coverage(np.array(value), np.array(slope_x), np.array(slope_y))
        counted = np.mean(value + slope_x * x + slope_y * y < 0)
        assert float(share) == pytest.approx(counted, abs=2e-3)


def test_a_disc_out_of_sight_leaves_the_background() -> None:
    scene = washbowl(half_size=True)
    away = dataclasses.replace(
        scene, path=HarmonicPath(np.array([3.0, 0, 1.25]), np.array([0, 0, -1.0]))
    )
    bare = dataclasses.replace(scene, target=Disc(1e-6))
    np.testing.assert_array_equal(Renderer(away, 0).light(0), Renderer(bare, 0).light(0))


def test_a_disc_cut_by_the_picture_s_border_is_drawn_to_the_border() -> None:
    scene = washbowl(half_size=True)
    rays = scene.views[0].look(np.array([[0.0, 200.0]]), 0.0)
    position = (rays.origins + 0.4 * rays.directions)[0]
    lit = lit_disc(scene, 0.06, position, np.array([0, 0, -1.0]), 0.0)
    light = Renderer(lit, 0).light(0.0)
    assert light[200, 0, 1] == pytest.approx(255)
    assert 0 < np.count_nonzero(light[..., 1] > 1) < 1000


def test_a_texture_goes_on_mirrored_however_far_a_ray_falls_and_wherever_it_does_not():
    texture = np.random.default_rng(0).random((40, 50, 3)).astype(np.float32)
    near = np.random.default_rng(1).uniform(-1, 1, (300, 2))
    seen = sample(texture, near)
    for far in (near + 4 * 1000, 2 - near, 2 - near - 4 * 1000):
        np.testing.assert_allclose(sample(texture, far), seen, atol=1e-3)
    lost = np.array([[np.nan, 0.0], [np.inf, -np.inf], [1e30, 0.0]])
    assert np.isfinite(sample(texture, np.concatenate([near, lost]))).all()
