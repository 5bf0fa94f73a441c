"""Bent rays through whole rigs: there and back, least time, derivatives, and why there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize, root

from binopos_ros.optics import FlatInterface, OpticsError, PinholeCamera, StereoRig

Layers = tuple[tuple[float, ...], tuple[float, ...]]
AIR, WATER = 1.0003, 1.333
PINHOLE = PinholeCamera([[800.0, 0, 640], [0, 800, 480], [0, 0, 1]], (), (1280, 960))
BASELINE = np.array([-0.23, 0.0, 0.0])


def in_front(surface: FlatInterface | None, camera: PinholeCamera = PINHOLE) -> StereoRig:
    """A rig of two parallel cameras 230 mm apart."""
    return StereoRig(camera, camera, np.eye(3), BASELINE, surface)


def advance(ray: tuple[np.ndarray, np.ndarray], distance: float) -> np.ndarray:
    """Return points along rays."""
    start, direction = ray
    return start + distance * direction


@pytest.mark.parametrize('roll', [0.0, 1.0, 2.5])
def test_there_and_back_at_every_incidence(stack: Layers, roll: float) -> None:
    """105 rays of 0 to 85 degrees of incidence; surface and ray both lean by half of it."""
    indices, thicknesses = stack
    critical = np.arcsin(min(1.0, min(indices) / indices[0]))
    for incidence in np.linspace(0.0, np.radians(85.0), 105):
        half = incidence / 2
        turn = np.array([np.cos(roll), np.sin(roll), 0.0])
        normal = np.sin(half) * turn + np.array([0, 0, np.cos(half)])
        rig = in_front(FlatInterface(normal, 1.0, indices, thicknesses))
        pixel = PINHOLE.project(-np.sin(half) * turn + np.array([0, 0, np.cos(half)]))
        ray, _ = rig.back_project(pixel, pixel)
        if incidence > critical:
            assert np.isnan(ray).all()
            continue
        for distance in (0.01, 1.0):
            again, _ = rig.project(advance(ray, distance))
            np.testing.assert_allclose(again, pixel, atol=1e-9)


def test_there_and_back_through_every_rig(rig: StereoRig, points: np.ndarray) -> None:
    pixels = rig.project(points)
    for ray, image, side in zip(rig.back_project(*pixels), pixels, (0, 1), strict=True):
        start, direction = ray
        np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-14)
        distance = np.linalg.norm(points - start, axis=1)
        np.testing.assert_allclose(start + distance[:, None] * direction, points, atol=1e-12)
        farther = rig.project(start + (distance[:, None] + 0.3) * direction)[side]
        np.testing.assert_allclose(farther, image, atol=1e-9)


def travel_time(
    crossings: np.ndarray,
    bases: np.ndarray,
    feet: np.ndarray,
    indices: np.ndarray,
    end: np.ndarray,
) -> tuple[float, np.ndarray]:
    """Optical length of a broken line, and its derivative by the crossings' plane coordinates."""
    plane = crossings.reshape(-1, 2)
    corners = np.vstack([np.zeros(3), feet + np.einsum('ma,mai->mi', plane, bases), end])
    legs = np.diff(corners, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    pull = (indices / lengths)[:, None] * legs
    return float(indices @ lengths), np.einsum('mi,mai->ma', pull[:-1] - pull[1:], bases).ravel()


def fermat(rig: StereoRig, side: int, point: np.ndarray) -> np.ndarray:
    """Return the pixel of the path of least time, minimised with scipy, no Snell's law in it."""
    rotation, shift = (np.eye(3), np.zeros(3)) if side == 0 else (rig.rotation, rig.translation)
    planes, indices = [], []
    port = (rig.left_port, rig.right_port)[side]
    for surface, turn, move in ((port, np.eye(3), np.zeros(3)), (rig.interface, rotation, shift)):
        if surface is None:
            continue
        normal = turn @ surface.normal
        depths = surface.distance + normal @ move + np.cumsum([0.0, *surface.thicknesses])
        planes += [(normal, depth) for depth in depths]
        indices = [*indices[:-1], *surface.indices]
    bases = np.array([np.linalg.svd(normal[None])[2][1:] for normal, _ in planes])
    feet = np.array([depth * normal for normal, depth in planes])
    end = rotation @ point + shift
    given = (bases, feet, np.array(indices), end)
    straight = [
        basis @ (end * (depth / (normal @ end)) - foot)
        for basis, foot, (normal, depth) in zip(bases, feet, planes, strict=True)
    ]
    coarse = minimize(travel_time, np.ravel(straight), args=given, jac=True, method='BFGS')
    fine = root(lambda x: travel_time(x, *given)[1], coarse.x, method='hybr', tol=1e-15)
    assert travel_time(fine.x, *given)[0] <= coarse.fun + 1e-12
    first = feet[0] + fine.x[:2] @ bases[0]
    return (rig.left, rig.right)[side].project(first)


def test_the_ray_is_the_path_of_least_time(flat_rig: StereoRig, points: np.ndarray) -> None:
    some = points[:6]
    for side, pixels in enumerate(flat_rig.project(some)):
        expected = np.array([fermat(flat_rig, side, point) for point in some])
        np.testing.assert_allclose(pixels, expected, atol=1e-7)


def test_least_time_at_grazing_incidence() -> None:
    """80 degrees in air, where iterations that start from the straight line go astray."""
    rig = in_front(FlatInterface((0.0, 0.7, 0.714), 0.4, (AIR, 1.46, WATER), (0.01,)))
    reach = np.linspace(0.5, 2.2, 5)[:, None]
    points = rig.interface.normal * 0.6 + reach * np.array([0.1, -0.714, 0.7])
    left, _ = rig.project(points)
    rays = PINHOLE.unproject(left)
    assert np.degrees(np.arccos(rays @ rig.interface.normal)).max() > 75
    np.testing.assert_allclose(left, [fermat(rig, 0, point) for point in points], atol=1e-7)


def test_equal_indices_are_the_pinhole(points: np.ndarray) -> None:
    straight = in_front(None)
    tilted = FlatInterface((0.2, -0.1, 1.0), 0.4, (1.0, 1.0, 1.0), (0.1,))
    for bent, pinhole in zip(
        in_front(tilted).project(points), straight.project(points), strict=True
    ):
        np.testing.assert_allclose(bent, pinhole, atol=1e-12)


def test_point_and_index_jacobians_agree_with_differences(
    rig: StereoRig, points: np.ndarray
) -> None:
    h = 1e-6
    found = rig.differentiate(points)
    for side, (pixels, by_point) in enumerate(
        ((found.left, found.left_by_point), (found.right, found.right_by_point))
    ):
        np.testing.assert_allclose(pixels, rig.project(points)[side], atol=1e-9)
        for axis, step in enumerate(h * np.eye(3)):
            ahead, behind = rig.project(points + step)[side], rig.project(points - step)[side]
            difference = (ahead - behind) / (2 * h)
            np.testing.assert_allclose(
                by_point[:, :, axis], difference, atol=1e-6 * np.abs(by_point).max()
            )
    if rig.target_index is None:
        assert not found.left_by_index.any()
        return
    ahead, behind = (rig.with_target_index(rig.target_index + s).project(points) for s in (h, -h))
    for by_index, a, b in zip(
        (found.left_by_index, found.right_by_index), ahead, behind, strict=True
    ):
        np.testing.assert_allclose(by_index, (a - b) / (2 * h), atol=1e-6 * np.abs(by_index).max())


def test_parameter_jacobians_agree_with_differences(
    bent_rig: StereoRig, points: np.ndarray
) -> None:
    names = bent_rig.parameter_names
    assert names[0] == 'target_index'
    jacobians = bent_rig.parameter_jacobian(points)
    by_index = bent_rig.differentiate(points)
    np.testing.assert_allclose(jacobians[0][:, :, 0], by_index.left_by_index, rtol=1e-9, atol=1e-8)
    h = 1e-6
    for k, name in enumerate(names):
        step = np.zeros(len(names))
        step[k] = h
        ahead, behind = bent_rig.perturbed(step), bent_rig.perturbed(-step)
        for jacobian, a, b in zip(
            jacobians, ahead.project(points), behind.project(points), strict=True
        ):
            scale = max(np.abs(jacobian[:, :, k]).max(), 1.0)
            np.testing.assert_allclose(
                jacobian[:, :, k], (a - b) / (2 * h), atol=1e-6 * scale, err_msg=name
            )


def test_a_port_parallel_to_the_wall_is_one_stack(points: np.ndarray) -> None:
    """The same layers given as port and wall, and as a single interface."""
    normal = np.array([0.1, 0.05, 1.0])
    one = FlatInterface(normal, 0.03, (AIR, 1.46, WATER, 1.49, AIR), (0.006, 0.5, 0.01))
    port = FlatInterface(normal, 0.03, (AIR, 1.46, WATER), (0.006,))
    wall = FlatInterface(normal, 0.536, (WATER, 1.49, AIR), (0.01,))
    both = StereoRig(PINHOLE, PINHOLE, np.eye(3), BASELINE, wall, left_port=port)
    np.testing.assert_allclose(
        both.project(points)[0], in_front(one).project(points)[0], atol=1e-9
    )


def test_a_port_leaning_ever_less_becomes_parallel(points: np.ndarray) -> None:
    """The solver for planes at angles meets the one for parallel planes, at first order."""
    port = FlatInterface((0.0, 0.0, 1.0), 0.03, (AIR, 1.46, WATER), (0.006,))
    pixels = []
    for lean in (0.0, 1e-9, 1e-6):
        wall = FlatInterface((lean, 0.0, 1.0), 0.5, (WATER, 1.49, AIR), (0.01,))
        rig = StereoRig(PINHOLE, PINHOLE, np.eye(3), BASELINE, wall, port, port)
        assert rig.left_view.surfaces.parallel == (lean == 0.0)
        pixels.append(np.hstack(rig.project(points)))
    np.testing.assert_allclose(pixels[1], pixels[0], atol=5e-6)
    np.testing.assert_allclose(
        (pixels[2] - pixels[0]) / 1e-6, (pixels[1] - pixels[0]) / 1e-9, rtol=1e-2, atol=2.0
    )


def test_reasons_and_nan_go_together(rig: StereoRig) -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform([-4, -4, -1], [4, 4, 3], (300, 3))
    points[:3] = [[np.nan, 0, 1], [np.inf, 0, 1], [0, 0, 0]]
    lost = np.isnan(np.hstack(rig.project(points))).any(axis=1)
    np.testing.assert_array_equal(lost, rig.explain(points) != '')
    assert lost.any()
    assert not lost.all()


@pytest.mark.parametrize(
    ('point', 'says'),
    [
        ((0, 0, 0.7), 'camera side'),
        ((0, 0, 0.8), 'camera side'),
        ((0, 0, 0.803), 'camera side'),
        ((0, 0, -1), 'camera side'),
        ((np.nan, 0, 1), 'not a finite number'),
    ],
)
def test_a_target_not_beyond_the_surface_has_a_reason(point: tuple, says: str) -> None:
    rig = in_front(FlatInterface((0, 0, 1), 0.8, (AIR, 1.46, WATER), (0.006,)))
    assert np.isnan(rig.project(point)).all()
    assert says in rig.explain(point)[0]


def test_a_surface_that_slants_hides_points_behind_the_camera() -> None:
    rig = in_front(FlatInterface((0.99, 0.0, 0.1), 0.3, (AIR, WATER)))
    assert 'behind the camera' in rig.explain((2.0, 0.0, -3.0))[0]


def test_a_point_beyond_the_lens_fold_has_a_reason() -> None:
    folding = PinholeCamera(PINHOLE.matrix, [-0.4, 0, 0, 0], PINHOLE.size)
    rig = in_front(FlatInterface((0, 0, 1), 0.8, (AIR, WATER)), folding)
    assert "lens's field" in rig.explain((3.0, 0.0, 1.2))[0]


def test_total_reflection_gives_no_ray() -> None:
    """From water into air beyond asin(1 / 1.333) = 48.6 degrees."""
    rig = in_front(FlatInterface((0, 0, 1), 0.8, (WATER, 1.0)))
    for degrees, lost in ((48.5, False), (48.7, True)):
        pixel = PINHOLE.project([np.tan(np.radians(degrees)), 0, 1])
        assert np.isnan(rig.back_project(pixel, pixel)[0]).any() == lost


def test_shapes_of_one_many_and_none() -> None:
    rig = in_front(FlatInterface((0, 0, 1), 0.8, (AIR, WATER)))
    assert [p.shape for p in rig.project([0, 0, 1])] == [(2,), (2,)]
    assert [p.shape for p in rig.project(np.zeros((0, 3)))] == [(0, 2), (0, 2)]
    (start, direction), _ = rig.back_project([640, 480], [640, 480])
    assert start.shape == direction.shape == (3,)
    many = np.tile([0.01, 0.02, 1.0], (50_000, 1))
    left, right = rig.project(many)
    np.testing.assert_array_equal(left, np.broadcast_to(left[0], left.shape))
    np.testing.assert_array_equal(right, np.broadcast_to(right[0], right.shape))


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (((0, 0, 1), -0.1, (1, 1.33)), 'must lie ahead of the camera'),
        (((0, 0, 1), 0.0, (1, 1.33)), 'must lie ahead of the camera'),
        (((0, 0, 1), np.nan, (1, 1.33)), 'must lie ahead of the camera'),
        (((0, 0, 0), 0.1, (1, 1.33)), 'normal must be a direction'),
        (((0, 1), 0.1, (1, 1.33)), 'normal must be a direction'),
        (((0, 0, np.nan), 0.1, (1, 1.33)), 'normal must be a direction'),
        (((0, 0, 1), 0.1, (1, 0.9)), r'indices\[1\] = 0.9'),
        (((0, 0, 1), 0.1, (0.999, 1.33)), r'indices\[0\] = 0.999'),
        (((0, 0, 1), 0.1, (np.nan, 1.33)), r'indices\[0\] = nan'),
        (((0, 0, 1), 0.1, (1,)), 'one per medium'),
        (((0, 0, 1), 0.1, (1, 1.5, 1.33)), 'one per medium'),
        (((0, 0, 1), 0.1, (1, 1.5, 1.33), (-0.01,)), r'thicknesses\[0\]'),
    ],
)
def test_impossible_interfaces_are_refused_in_one_line(arguments: tuple, says: str) -> None:
    with pytest.raises(OpticsError, match=says) as caught:
        FlatInterface(*arguments)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'rotation': 2 * np.eye(3)}, 'the rotation is not one'),
        ({'rotation': np.diag([1, 1, -1])}, 'the rotation is not one'),
        ({'rotation': np.zeros((2, 2))}, 'the rotation must be 3x3'),
        ({'translation': np.zeros(3)}, 'the translation is zero'),
        ({'translation': (np.nan, 0, 0)}, 'three finite numbers'),
        ({'interface': FlatInterface((1, 0, 0), 0.1, (1, 1.33))}, 'right camera lies'),
        ({'left_port': FlatInterface((0, 0, 1), 0.1, (1, 1.5))}, 'left port ends in a medium'),
        ({'left_port': FlatInterface((0, 0, 1), 0.9, (1, 1))}, 'reaches beyond the interface'),
        (
            {
                'interface': None,
                'left_port': FlatInterface((0, 0, 1), 0.9, (1, 1.33)),
                'right_port': FlatInterface((0, 0, 1), 0.9, (1, 1.34)),
            },
            'end in different media',
        ),
    ],
)
def test_parts_that_do_not_fit_are_refused_in_one_line(change: dict, says: str) -> None:
    parts = {
        'left': PINHOLE,
        'right': PINHOLE,
        'rotation': np.eye(3),
        'translation': BASELINE,
        'interface': FlatInterface((0, 0, 1), 0.8, (1, 1.33)),
    }
    with pytest.raises(OpticsError, match=says) as caught:
        StereoRig(**{**parts, **change})
    assert '\n' not in str(caught.value)


def test_a_rig_in_air_has_no_target_index() -> None:
    with pytest.raises(OpticsError, match='looks through no surface'):
        in_front(None).with_target_index(1.33)
    with pytest.raises(OpticsError, match='must hold 5 numbers'):
        in_front(FlatInterface((0, 0, 1), 0.8, (1, 1.33))).perturbed([1.0])
