"""The likeliest point: exact without noise, efficient with it, and honest about its covariance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

import layer_stacks
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import TriangulationError, triangulate
from every_rig import RIGS

Scatter = Callable[[int], np.ndarray]
Bound = Callable[..., np.ndarray]
LEFT = np.array([[0.010, 0.004], [0.004, 0.020]])  # px^2
RIGHT = np.array([[0.015, -0.006], [-0.006, 0.008]])


def noisy(
    rig: StereoRig, points: np.ndarray, left: np.ndarray, right: np.ndarray, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points' pixels with Gaussian noise."""
    rng = np.random.default_rng(seed)
    images = rig.project(points)
    first, second = (
        image + rng.standard_normal(image.shape) @ np.linalg.cholesky(cov).T
        for image, cov in zip(images, (left, right), strict=True)
    )
    return first, second


def normalised_squared_error(errors: np.ndarray, covariances: np.ndarray) -> float:
    """Return the mean of e^T C^-1 e: 3 for an honest covariance of a point."""
    return float(
        np.einsum(
            'ni,ni->n', errors, np.linalg.solve(covariances, errors[..., None])[..., 0]
        ).mean()
    )


@pytest.mark.parametrize('method', ['refractive', 'straight'])
def test_without_noise_the_point_comes_back(rig: StereoRig, scatter: Scatter, method: str) -> None:
    points = scatter(300)
    if method == 'straight':
        rig = StereoRig(rig.left, rig.right, rig.rotation, rig.translation)
    found = triangulate(rig, *rig.project(points), method=method)
    np.testing.assert_allclose(found.points, points, atol=1e-11)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-8)
    assert set(found.reasons) == {''}


def test_through_domes_and_a_wall_behind_them_the_point_comes_back() -> None:
    rig = layer_stacks.RIGS['domes before a wall']
    points = np.random.default_rng(3).uniform([-0.4, -0.3, 1.15], [0.5, 0.3, 1.8], (100, 3))
    found = triangulate(rig, *rig.project(points))
    np.testing.assert_allclose(found.points, points, atol=1e-11)
    one = triangulate(rig, *(pixels[0] for pixels in rig.project(points)))
    np.testing.assert_allclose(one.points, points[0], atol=1e-11)
    np.testing.assert_allclose(one.covariances, found.covariances[0], rtol=1e-7)


def test_error_reaches_the_cramer_rao_bound_and_the_covariance_is_consistent(
    rig: StereoRig, scatter: Scatter, bound: Bound
) -> None:
    points = scatter(10_000)
    found = triangulate(rig, *noisy(rig, points, LEFT, RIGHT), LEFT, RIGHT)
    assert set(found.reasons) == {''}
    errors = found.points - points
    best = bound(rig, points, LEFT, RIGHT)
    rms = np.sqrt((errors**2).sum(axis=1).mean())
    assert rms <= 1.05 * np.sqrt(np.trace(best, axis1=1, axis2=2).mean())
    assert normalised_squared_error(errors, found.covariances) == pytest.approx(3.0, rel=0.02)


def test_one_pair_at_a_time_gives_what_the_batch_gives(rig: StereoRig, scatter: Scatter) -> None:
    left, right = noisy(rig, scatter(20), LEFT, RIGHT)
    batch = triangulate(rig, left, right, LEFT, RIGHT)
    for i in range(20):
        one = triangulate(rig, left[i], right[i], LEFT, RIGHT)
        assert (one.points.shape, one.covariances.shape) == ((3,), (3, 3))
        np.testing.assert_allclose(one.points, batch.points[i], atol=1e-12)
        np.testing.assert_allclose(one.covariances, batch.covariances[i], rtol=1e-7, atol=1e-15)
        np.testing.assert_allclose(one.residuals, batch.residuals[i], atol=1e-7)
        assert one.reasons == ''


def test_the_point_is_the_minimum_that_scipy_finds(rig: StereoRig, scatter: Scatter) -> None:
    """A pixel of noise, each covariance its own: scipy's minimiser of the same error agrees."""
    points = scatter(6)
    rng = np.random.default_rng(4)
    factors = rng.uniform(0.3, 1.0, (2, 6, 2, 2)) * [[1, 0], [0.5, 1]]
    covs = factors @ np.swapaxes(factors, 2, 3)
    images = [image + rng.standard_normal((6, 2)) for image in rig.project(points)]
    found = triangulate(rig, *images, *covs)
    whiten = np.linalg.inv(np.linalg.cholesky(covs))
    for i, start in enumerate(points):

        def residual(point: np.ndarray, i: int = i) -> np.ndarray:
            pairs = zip(whiten[:, i], images, rig.project(point), strict=True)
            return np.concatenate([w @ (image[i] - seen) for w, image, seen in pairs])

        best = least_squares(residual, start, x_scale=1e-3, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        sigma = np.sqrt(np.diagonal(found.covariances[i]))
        assert (np.abs(found.points[i] - best.x) < 1e-4 * sigma).all()
        left, right = rig.project(found.points[i])
        np.testing.assert_allclose(
            found.residuals[i], np.r_[images[0][i] - left, images[1][i] - right], atol=1e-6
        )


SURFACE = {
    'target_index': 2e-3,
    'interface.distance': 1e-3,
    'interface.normal.0': 2e-3,
    'interface.normal.1': 3e-3,
}
CENTRES = {f'{side}_port.centre.{i}': 2e-4 for side in ('left', 'right') for i in range(3)}


@pytest.mark.parametrize(
    ('name', 'sigmas'), [('washbowl', SURFACE), ('wide lenses behind domes', CENTRES)]
)
def test_parameter_uncertainty_is_added_as_simulation_shows(
    name: str, sigmas: dict[str, float]
) -> None:
    """Triangulate with rigs drawn from the parameters' distribution: the scatter is predicted."""
    rig = RIGS[name]
    point = np.array([0.1, 0.15, 1.2])
    pixels = rig.project(point)
    names = rig.parameter_names
    std = np.array([sigmas.get(name, 0.0) for name in names])
    known = triangulate(rig, *pixels, LEFT, RIGHT)
    unsure = triangulate(rig, *pixels, LEFT, RIGHT, parameter_covariance=np.diag(std**2))
    rng = np.random.default_rng(2)
    cloud = np.array(
        [
            triangulate(
                rig.perturbed(std * rng.standard_normal(len(names))), *pixels, LEFT, RIGHT
            ).points
            for _ in range(800)
        ]
    )
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(unsure.covariances - known.covariances)), cloud.std(axis=0), rtol=0.1
    )


def test_straight_covariance_is_consistent(scatter: Scatter) -> None:
    camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
    rig = StereoRig(camera, camera, np.eye(3), (-0.23, 0, 0))
    points = scatter(10_000)
    found = triangulate(rig, *noisy(rig, points, LEFT, RIGHT), LEFT, RIGHT, method='straight')
    errors = found.points - points
    assert normalised_squared_error(errors, found.covariances) == pytest.approx(3.0, rel=0.02)


def test_straight_rays_misplace_a_target_under_water(
    washbowl: StereoRig, scatter: Scatter
) -> None:
    """Apparent depth is about 3/4 of the true one; the likeliest point is not shallower."""
    points = scatter(100)
    images = washbowl.project(points)
    straight = triangulate(washbowl, *images, method='straight').points
    shallow = (straight[:, 2] - 0.8) / (points[:, 2] - 0.8)
    assert 0.6 < shallow.min() <= shallow.max() < 0.8
    np.testing.assert_allclose(triangulate(washbowl, *images).points, points, atol=1e-11)


def test_the_papers_method_is_exact_where_both_angles_are_equal(washbowl: StereoRig) -> None:
    """On the middle plane both rays bend alike; elsewhere it misses by a little."""
    middle, aside = np.array([0.115, 0.1, 1.2]), np.array([0.4, 0.1, 1.2])
    for point, least, most in ((middle, 0.0, 1e-9), (aside, 1e-3, 1e-2)):
        found = triangulate(washbowl, *washbowl.project(point), method='paper')
        assert least <= np.abs(found.points - point).max() < most
        assert np.linalg.eigvalsh(found.covariances).min() > 0


@pytest.mark.parametrize('method', ['refractive', 'straight', 'paper'])
def test_parallel_rays_have_no_point(washbowl: StereoRig, method: str) -> None:
    """Both cameras straight down, 230 mm apart."""
    found = triangulate(washbowl, [640, 480], [640, 480], method=method)
    assert np.isnan(found.points).all()
    assert 'parallel' in found.reasons


@pytest.mark.parametrize(
    ('target', 'says'),
    [
        ((0.1, 0.0, 0.5), 'camera side'),  # above the water
        ((0.1, 0.0, 0.799), 'camera side'),
        ((0.1, 0.0, -1.0), 'camera side'),  # diverging rays
    ],
)
def test_targets_not_in_the_water_have_a_reason(
    washbowl: StereoRig, target: tuple[float, ...], says: str
) -> None:
    in_air = StereoRig(washbowl.left, washbowl.right, washbowl.rotation, washbowl.translation)
    images = in_air.project(np.abs(target))
    if target[2] < 0:
        images = images[::-1]
    found = triangulate(washbowl, *images)
    assert np.isnan(found.points).all()
    assert np.isnan(found.covariances).all()
    assert says in found.reasons


def test_a_target_nearer_than_the_port_has_a_reason() -> None:
    camera = PinholeCamera([[300, 0, 640], [0, 300, 480], [0, 0, 1]], (), (1280, 960))
    port = FlatInterface((0, 0, 1), 0.15, (1.0, 1.46, 1.333), (0.01,))
    rig = StereoRig(camera, camera, np.eye(3), (-0.1, 0, 0), None, port, port)
    in_air = StereoRig(camera, camera, np.eye(3), (-0.1, 0, 0))
    found = triangulate(rig, *in_air.project([0.05, 0.0, 0.1]))
    assert 'camera side' in found.reasons


def test_total_reflection_has_a_reason() -> None:
    camera = PinholeCamera([[400, 0, 640], [0, 400, 480], [0, 0, 1]], (), (1280, 960))
    out_of_water = FlatInterface((0, 0, 1), 0.3, (1.333, 1.0))
    rig = StereoRig(camera, camera, np.eye(3), (-0.2, 0, 0), out_of_water)
    found = triangulate(rig, [640 + 400 * 1.2, 480], [640 + 400 * 0.9, 480])
    assert 'total reflection' in found.reasons


def test_rays_that_meet_behind_the_cameras_have_a_reason() -> None:
    camera = PinholeCamera([[400, 0, 640], [0, 400, 480], [0, 0, 1]], (), (1280, 960))
    rig = StereoRig(camera, camera, np.eye(3), (-0.2, 0, 0))
    for method in ('refractive', 'straight'):
        found = triangulate(rig, [600, 480], [640, 480], method=method)
        assert 'behind' in found.reasons


@pytest.mark.parametrize('method', ['refractive', 'straight', 'paper'])
def test_one_bad_pair_spoils_no_other(washbowl: StereoRig, scatter: Scatter, method: str) -> None:
    points = scatter(6)
    left, right = washbowl.project(points)
    covs = np.tile(LEFT, (6, 1, 1))
    left[1, 0] = np.nan
    right[2, 1] = np.inf
    covs[3] = [[1, 2], [2, 1]]
    covs[4] = [[1, 0.5], [-0.5, 1]]
    covs[5, 0, 0] = np.nan
    found = triangulate(washbowl, left, right, RIGHT, covs, method=method)
    assert found.reasons[0] == ''
    for i, says in enumerate(('finite', 'finite', 'right cov', 'right cov', 'finite'), start=1):
        assert says in found.reasons[i]
        for part in (found.points, found.covariances, found.residuals):
            assert np.isnan(part[i]).all()
    assert np.isfinite(found.points[0]).all()


def test_wildly_mismatched_pixels_end_in_a_number_or_a_reason(washbowl: StereoRig) -> None:
    """Whatever is asked, nothing is both without reason and without number; and nothing hangs."""
    rng = np.random.default_rng(9)
    left = rng.uniform([-2000, -2000], [3000, 3000], (400, 2))
    right = left - rng.uniform([-500, -100], [1000, 100], (400, 2))
    found = triangulate(washbowl, left, right, LEFT, RIGHT)
    good = found.reasons == ''
    assert good.any()
    assert not good.all()
    for part in (found.points, found.covariances, found.residuals):
        finite = np.isfinite(part).all(axis=tuple(range(1, part.ndim)))
        np.testing.assert_array_equal(finite, good)
    assert (found.points[good, 2] > 0.8).all()


def test_no_pairs_give_no_points(washbowl: StereoRig) -> None:
    for method in ('refractive', 'straight', 'paper'):
        found = triangulate(washbowl, np.zeros((0, 2)), np.zeros((0, 2)), method=method)
        assert found.points.shape == (0, 3)
        assert found.reasons.shape == (0,)


@pytest.mark.parametrize(
    ('arguments', 'options', 'says'),
    [
        (([1, 2], [[1, 2]]), {}, 'of one shape'),
        (([1, 2, 3], [1, 2, 3]), {}, 'must have the shape'),
        (([1, 2], [1, 2]), {'method': 'magic'}, "'magic' is unknown; choose one of refractive"),
        (([1, 2], [1, 2]), {'left_cov': np.eye(3)}, 'left_cov must have the shape'),
        (([1, 2], [1, 2]), {'parameter_covariance': np.eye(2)}, 'must be 5x5'),
        (([1, 2], [1, 2]), {'parameter_covariance': -np.eye(5)}, 'is no covariance'),
        (
            ([1, 2], [1, 2]),
            {'parameter_covariance': np.eye(5), 'method': 'paper'},
            "belongs to method 'refractive'",
        ),
    ],
)
def test_bad_arguments_are_refused_in_one_line(
    washbowl: StereoRig, arguments: tuple, options: dict, says: str
) -> None:
    with pytest.raises(TriangulationError, match=says) as caught:
        triangulate(washbowl, *arguments, **options)
    assert '\n' not in str(caught.value)
