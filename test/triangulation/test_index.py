"""The live index: consistent, efficient, honest where it cannot be seen, hard to fool."""

import math
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from scipy import optimize
from scipy.stats import norm

from binopos_ros.optics import FlatInterface, OpticsError, PinholeCamera, StereoRig
from binopos_ros.optics.column import mean_index
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.evidence import gather_evidence
from binopos_ros.triangulation.following import NOT_OBSERVABLE, OUTLIER
from binopos_ros.triangulation.index import IndexEstimator
from binopos_ros.triangulation.paper import frame_index

PIXEL_STD = 0.1
COVARIANCE = PIXEL_STD**2 * np.eye(2)
CAMERA = PinholeCamera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], [], (1280, 960))
WIDE = PinholeCamera(
    [[600, 0, 639.5], [0, 602, 479.5], [0, 0, 1]], [-0.05, 0.01, 0.0005, 0.0], (1280, 960)
)


class Setting(NamedTuple):
    """A rig through a medium of about `index`, and the box (low, high) its target moves in, m."""

    rig: StereoRig
    low: tuple
    high: tuple


def rig_through(*surfaces, camera=CAMERA, turn=(0, 0, 0), shift=(-0.23, 0, 0)):
    rotation = cv2.Rodrigues(np.array(turn, dtype=float))[0]
    return StereoRig(camera, camera, rotation, shift, *surfaces)


def flat(normal, distance, *indices, glass=()):
    return FlatInterface(normal, distance, indices, glass)


SETTINGS = {
    'washbowl, corner': Setting(
        rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), (0.45, 0.3, 1.2), (0.7, 0.5, 1.3)
    ),
    'oblique to both': Setting(
        rig_through(flat((0.3, 0.3, 1), 0.3, 1, 1.355)), (0.2, 0.0, 0.8), (0.6, 0.4, 1.2)
    ),
    'oblique along the baseline': Setting(
        rig_through(flat((0.5, 0, 1), 0.5, 1, 1.355)), (0.0, 0.15, 0.9), (0.4, 0.4, 1.3)
    ),
    'tank wall': Setting(
        rig_through(flat((0, 0, 1), 0.1, 1, 1.5, 1.355, glass=(0.01,)), camera=WIDE),
        (0.25, 0.15, 0.5),
        (0.45, 0.4, 0.9),
    ),
    'toed in': Setting(
        rig_through(flat((0, 0.2, 1), 0.3, 1, 1.355), turn=(0.01, 0.2, 0.02)),
        (0.2, 0.2, 0.7),
        (0.4, 0.4, 1.1),
    ),
    'wide baseline': Setting(
        rig_through(flat((0, 0, 1), 0.3, 1, 1.355), shift=(-0.6, 0.02, 0.0), camera=WIDE),
        (0.5, 0.2, 0.8),
        (0.8, 0.5, 1.2),
    ),
    'one camera above the other': Setting(
        rig_through(flat((0, 0.3, 1), 0.6, 1, 1.355), shift=(0.0, -0.3, 0.0)),
        (0.2, 0.2, 1.0),
        (0.5, 0.5, 1.4),
    ),
    'one camera ahead': Setting(
        rig_through(flat((0, 0, 1), 0.5, 1, 1.355), shift=(-0.2, 0.0, 0.1)),
        (0.2, 0.2, 0.8),
        (0.5, 0.4, 1.2),
    ),
    'a port each': Setting(
        rig_through(
            None,
            flat((0.1, 0, 1), 0.05, 1, 1.5, 1.355, glass=(0.008,)),
            flat((-0.2, 0.1, 1), 0.05, 1, 1.5, 1.355, glass=(0.008,)),
            camera=WIDE,
        ),
        (-0.1, 0.1, 0.6),
        (0.3, 0.4, 1.0),
    ),
    'brine, far': Setting(
        rig_through(flat((0.2, 0.4, 1), 0.4, 1, 1.355), shift=(-0.4, 0, 0)),
        (0.3, 0.0, 1.0),
        (0.8, 0.5, 1.8),
    ),
}


def path(setting, count, random):
    """Points (count, 3) of the box that both cameras have in the image."""
    points = random.uniform(setting.low, setting.high, (20 * count, 3))
    width, height = setting.rig.left.size
    pixels = images(setting.rig, points).reshape(-1, 2, 2)
    inside = ((pixels > 0) & (pixels < (width, height))).all(axis=(1, 2))
    return points[inside][:count]


def images(rig, points):
    return np.hstack(rig.project(points))


def information(rig, points):
    """Whitened p (N,4) of each pair by finite differences of `project`: |p|^2 is its information.

    The Fisher information on the index with the point eliminated, by a way of its own.
    """
    h = 1e-5
    by_point = np.stack(
        [(images(rig, points + h * e) - images(rig, points - h * e)) / (2 * h) for e in np.eye(3)],
        axis=2,
    )
    index = rig.target_index
    up, down = (images(rig.with_target_index(index + s), points) for s in (h, -h))
    by_index = (up - down) / (2 * h)
    fitted = [
        np.linalg.lstsq(J, g, rcond=None)[0] for J, g in zip(by_point, by_index, strict=True)
    ]
    return (by_index - np.einsum('nij,nj->ni', by_point, fitted)) / PIXEL_STD


def run(estimator, rig, pixels, rate=30.0, start=0.0, std=PIXEL_STD):
    """Feed pairs (N,4) px; return the states."""
    covariance = std**2 * np.eye(2)
    return [
        estimator.update(rig, row[:2], row[2:], covariance, covariance, start + k / rate)
        for k, row in enumerate(pixels)
    ]


def trial(name, runs, pairs, prior_std, random, strata=True):
    """Errors (R,), deviations (R,) of the index and the bound of the deviation, over `runs` runs.

    With `strata` the one combination of all noises that moves the estimate is drawn by strata, the
    rest freely: the same distribution, and a mean square that `runs` runs fix far better than
    free draws do.
    """
    setting = SETTINGS[name]
    points = path(setting, pairs, random)
    rig = setting.rig
    weights = np.concatenate([[1.0 / prior_std], information(rig, points).ravel()])
    bound = 1.0 / np.linalg.norm(weights)
    direction = weights * bound
    quantiles = (random.permutation(runs) + random.uniform(size=runs)) / runs
    drawn = norm.ppf(quantiles) if strata else random.standard_normal(runs)
    errors, stds = [], []
    for along in drawn:
        noise = random.standard_normal(len(weights))
        noise += direction * (along - direction @ noise)
        truth = rig.target_index - prior_std * noise[0]
        exact = images(rig.with_target_index(truth), points)
        estimator = IndexEstimator(rig.target_index, prior_std)
        state = run(estimator, rig, exact + PIXEL_STD * noise[1:].reshape(-1, 4))[-1]
        errors.append(state.mean - truth)
        stds.append(state.std)
    return np.array(errors), np.array(stds), bound


@pytest.fixture(scope='module')
def trials():
    """Index errors and deviations of 1,000 runs over all settings, and each setting's bound."""
    random = np.random.default_rng(20)
    return [trial(name, 1000 // len(SETTINGS), 15, 0.015, random) for name in SETTINGS]


def test_the_error_is_as_large_as_it_says_over_a_thousand_runs(trials):
    squares = np.concatenate([(errors / stds) ** 2 for errors, stds, _ in trials])
    assert len(squares) == 1000
    assert squares.mean() == pytest.approx(1.0, abs=0.05)


def test_the_error_is_within_a_tenth_of_the_bound_in_every_setting(trials):
    for errors, stds, bound in trials:
        assert np.sqrt(np.mean(errors**2)) < 1.1 * bound
        assert stds.mean() == pytest.approx(bound, rel=0.1)


@pytest.mark.parametrize('name', SETTINGS)
def test_a_pairs_evidence_is_the_fisher_information_and_the_best_index(name):
    """Against finite differences, and against a fit of point and index at once (scipy)."""
    setting, random = SETTINGS[name], np.random.default_rng(3)
    rig = setting.rig
    points = path(setting, 5, random)
    expected = np.linalg.norm(information(rig, points), axis=1)
    measured = images(rig, points) + 0.01 * PIXEL_STD * random.standard_normal((5, 4))
    for point, row, gain in zip(points, measured, expected, strict=True):
        evidence = gather_evidence(rig, row[:2], row[2:], COVARIANCE, COVARIANCE)
        assert evidence.clue.gain == pytest.approx(gain, rel=2e-3, abs=2e-3)
        if gain < 10.0:
            continue  # The best index of so dull a pair need not be one at all.

        def residual(unknown, row=row):
            return (images(rig.with_target_index(unknown[3]), unknown[:3]) - row) / PIXEL_STD

        best = optimize.least_squares(residual, [*point, rig.target_index], x_scale='jac').x
        suggested = rig.target_index + evidence.clue.innovation / evidence.clue.gain
        assert suggested == pytest.approx(best[3], abs=0.02 / gain)


def test_the_frames_own_index_is_the_papers():
    setting = SETTINGS['oblique along the baseline']
    points = path(setting, 20, np.random.default_rng(4))
    pixels = images(setting.rig, points)
    pixels += 0.02 * np.random.default_rng(5).standard_normal(pixels.shape)
    expected, _ = frame_index(setting.rig, pixels[:, :2], pixels[:, 2:])
    states = run(IndexEstimator(1.35, 0.01), setting.rig, pixels)
    found = np.array([state.frame_index for state in states])
    std = np.array([state.frame_index_std for state in states])
    assert np.abs(found - expected).max() < 0.1 * std.max()


SEEN_EQUALLY = {
    'over the middle of the baseline': (
        rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), (0.115, -0.3, 1.0), (0.115, 0.3, 1.3)
    ),
    'the same, the surface tilted across the baseline': (
        rig_through(flat((0, 0.5, 1), 0.6, 1, 1.355)), (0.115, -0.1, 1.0), (0.115, 0.3, 1.5)
    ),
    'behind glass': (
        rig_through(flat((0, 0, 1), 0.1, 1, 1.5, 1.355, glass=(0.01,))),
        (0.115, -0.3, 0.6), (0.115, 0.3, 1.0)
    ),
    'mirrored ports': (
        rig_through(
            None,
            flat((0.15, 0.1, 1), 0.05, 1, 1.355),
            flat((-0.15, 0.1, 1), 0.05, 1, 1.355),
        ),
        (0.115, -0.2, 0.6), (0.115, 0.2, 1.2)
    ),
    'in the plane of both centres and the normal': (
        rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), (-0.2, 0.0, 1.0), (0.5, 0.0, 1.4)
    ),
    'in that plane, the surface tilted along the baseline': (
        rig_through(flat((0.4, 0, 1), 0.5, 1, 1.355)), (-0.2, 0.0, 1.0), (0.4, 0.0, 1.6)
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', SEEN_EQUALLY)
def test_where_the_index_cannot_be_seen_it_says_so_every_time(name):
    rig, low, high = SEEN_EQUALLY[name]
    random = np.random.default_rng(6)
    for _ in range(5):
        points = random.uniform(low, high, (60, 3))
        estimator = IndexEstimator(1.34, 0.015)
        noise = PIXEL_STD * random.standard_normal((60, 4))
        for state in run(estimator, rig, images(rig, points) + noise):
            assert state.reason == NOT_OBSERVABLE
            assert not state.observed
            assert (state.mean, state.std) == pytest.approx((1.34, 0.015), abs=1e-12)
            assert math.isnan(state.frame_index)


@pytest.mark.parametrize('name', SEEN_EQUALLY)
def test_there_the_positions_covariance_shows_what_the_index_leaves_open(name):
    rig, low, high = SEEN_EQUALLY[name]
    random = np.random.default_rng(7)
    squares = []
    for point in random.uniform(low, high, (200, 3)):
        truth = random.normal(1.355, 0.015)
        pixels = images(rig.with_target_index(truth), point) + PIXEL_STD * random.standard_normal(
            4
        )
        state = IndexEstimator(1.355, 0.015).update(
            rig, pixels[:2], pixels[2:], COVARIANCE, COVARIANCE
        )
        miss = state.point - point
        squares.append(miss @ np.linalg.solve(state.covariance, miss))
    assert np.mean(squares) == pytest.approx(3.0, abs=4 * math.sqrt(6 / 200))


def test_positions_are_as_far_off_as_they_say_while_the_index_is_learnt():
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(8)
    squares = []
    for _ in range(150):
        truth = random.normal(1.355, 0.015)
        points = path(setting, 12, random)
        pixels = images(setting.rig.with_target_index(truth), points)
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        state = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)[-1]
        miss = state.point - points[-1]
        squares.append(miss @ np.linalg.solve(state.covariance, miss))
    assert np.mean(squares) == pytest.approx(3.0, abs=4 * math.sqrt(6 / 150))


def test_it_is_observed_once_the_data_outweigh_the_prior():
    setting, random = SETTINGS['washbowl, corner'], np.random.default_rng(9)
    points = path(setting, 100, random)
    told = np.cumsum(np.sum(information(setting.rig, points) ** 2, axis=1))
    pixels = images(setting.rig, points) + PIXEL_STD * random.standard_normal((100, 4))
    states = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)
    observed = np.array([state.observed for state in states])
    outweighed = told > 1 / 0.015**2
    assert 0 < outweighed.sum() < 100
    assert np.abs(observed.argmax() - outweighed.argmax()) <= 1
    assert observed[observed.argmax() :].all()


def test_gross_outliers_neither_move_it_nor_make_it_sure():
    setting, random = SETTINGS['one camera above the other'], np.random.default_rng(10)
    squares, reasons = [], []
    for _ in range(40):
        truth = random.normal(1.355, 0.015)
        pixels = images(setting.rig.with_target_index(truth), path(setting, 60, random))
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        wrong = random.uniform(size=60) < 0.1
        pixels[wrong, 2:] += random.uniform(-20, 20, (wrong.sum(), 2))
        states = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)
        squares.append(((states[-1].mean - truth) / states[-1].std) ** 2)
        reasons += [state.reason for state, bad in zip(states, wrong, strict=True) if bad]
    assert np.mean(squares) < 1.6
    assert np.mean([reason == OUTLIER for reason in reasons]) > 0.9


def test_it_follows_salt_that_dissolves_and_a_constant_index_does_not():
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(11)
    stamps = np.arange(900) / 10.0
    truth = 1.335 + 0.02 * stamps / stamps[-1]
    points = path(setting, len(stamps), random)
    pixels = np.array(
        [
            images(setting.rig.with_target_index(index), point)
            for index, point in zip(truth, points, strict=True)
        ]
    )
    pixels += PIXEL_STD * random.standard_normal(pixels.shape)
    following = run(IndexEstimator(1.335, 0.015, drift=1e-3), setting.rig, pixels, rate=10.0)
    constant = run(IndexEstimator(1.335, 0.015), setting.rig, pixels, rate=10.0)
    late = slice(300, None)
    scores = [
        (state.mean - index) / state.std
        for state, index in zip(following[late], truth[late], strict=True)
    ]
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
    assert all(state.observed for state in following[late])
    lags = [
        np.sqrt(
            np.mean([(s.mean - n) ** 2 for s, n in zip(states[late], truth[late], strict=True)])
        )
        for states in (following, constant)
    ]
    assert lags[1] > 2 * lags[0]


def test_without_data_it_returns_to_the_prior_and_is_never_less_sure_than_it():
    setting, random = SETTINGS['tank wall'], np.random.default_rng(12)
    estimator = IndexEstimator(1.34, 0.015, drift=1e-3)
    pixels = images(setting.rig, path(setting, 30, random))
    assert run(estimator, setting.rig, pixels)[-1].observed
    lost = [np.nan, np.nan]
    stds = []
    for elapsed in (1, 60, 600, 1e5):
        state = estimator.update(setting.rig, lost, lost, stamp=1.0 + elapsed)
        stds.append(state.std)
    assert stds == sorted(stds)
    assert stds[-1] == pytest.approx(0.015)
    assert state.mean == pytest.approx(1.34)
    assert not state.observed


def test_a_stamp_that_jumps_back_forgets_nothing():
    setting, random = SETTINGS['tank wall'], np.random.default_rng(13)
    pixels = images(setting.rig, path(setting, 30, random))
    estimator = IndexEstimator(1.34, 0.015, drift=1e-3)
    before = run(estimator, setting.rig, pixels, start=1e6)[-1]
    after = run(estimator, setting.rig, pixels[:1], start=0.0)[-1]
    assert after.std <= before.std


def test_an_index_that_jumps_is_found_again():
    setting, random = SETTINGS['oblique along the baseline'], np.random.default_rng(14)
    points = path(setting, 300, random)
    noise = PIXEL_STD * random.standard_normal((300, 4))
    estimator = IndexEstimator(1.36, 0.015)
    run(estimator, setting.rig, images(setting.rig.with_target_index(1.333), points) + noise)
    brine = images(setting.rig.with_target_index(1.38), points) + noise
    states = run(estimator, setting.rig, brine)
    assert states[-1].mean == pytest.approx(1.38, abs=4 * states[-1].std)


def correlated(random, count, correlation, std):
    noise = random.standard_normal((count, 4))
    for k in range(1, count):
        noise[k] = correlation * noise[k - 1] + math.sqrt(1 - correlation**2) * noise[k]
    return std * noise


@pytest.mark.parametrize(
    ('correlation', 'std'),
    [(0.9, PIXEL_STD), (0.0, 3 * PIXEL_STD), (0.9, 3 * PIXEL_STD), (0.9, 20 * PIXEL_STD)],
)
def test_noise_that_is_not_as_stated_does_not_make_it_overconfident(correlation, std):
    """Waves disturb neighbouring pairs alike; detectors understate their noise."""
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(15)
    squares = []
    for _ in range(12):
        truth = random.normal(1.355, 0.015)
        pixels = images(setting.rig.with_target_index(truth), path(setting, 250, random))
        pixels += correlated(random, 250, correlation, std)
        state = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)[-1]
        squares.append(((state.mean - truth) / state.std) ** 2)
    assert np.mean(squares) < 2.5


def test_a_known_floor_shows_the_index_where_the_rays_do_not():
    rig, random = rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), np.random.default_rng(16)
    squares, stds = [], []
    for _ in range(100):
        truth, error = random.normal(1.355, 0.015), random.normal(0.0, 1e-3)
        points = np.column_stack(
            [np.full(25, 0.115), random.uniform(-0.2, 0.2, 25), np.full(25, 1.29)]
        )
        pixels = images(rig.with_target_index(truth), points)
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        plane = KnownPlane.at_depth(rig.interface, 0.49 + error, 1e-3)
        states = run(IndexEstimator(1.355, 0.015, known_plane=plane), rig, pixels)
        assert states[-1].observed
        squares.append(((states[-1].mean - truth) / states[-1].std) ** 2)
        stds.append(states[-1].std)
        miss = states[-1].point - points[-1]
        assert abs(miss[2]) < 4.5e-3
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 100))
    # A millimetre of the floor is 0.0027 of the index, however many pairs there are.
    assert min(stds) > 0.0026
    assert max(stds) < 0.0035


def test_errors_of_the_surface_bound_what_any_number_of_pairs_can_tell():
    setting, random = SETTINGS['tank wall'], np.random.default_rng(17)
    rig = setting.rig
    std = {'interface.distance': 1e-3, 'interface.normal.0': 1e-3, 'interface.normal.1': 1e-3}
    covariance = np.diag([std.get(name, 0.0) ** 2 for name in rig.parameter_names])
    squares, naive, stds, misses = [], [], [], []
    for _ in range(60):
        change = np.sqrt(np.diag(covariance)) * random.standard_normal(len(covariance))
        truth = random.normal(1.355, 0.015)
        points = path(setting, 25, random)
        pixels = images(rig.perturbed(change).with_target_index(truth), points)
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        state = run(IndexEstimator(1.355, 0.015, parameter_covariance=covariance), rig, pixels)[-1]
        squares.append(((state.mean - truth) / state.std) ** 2)
        stds.append(state.std)
        miss = state.point - points[-1]
        misses.append(miss @ np.linalg.solve(state.covariance, miss))
        blind = run(IndexEstimator(1.355, 0.015), rig, pixels)[-1]
        naive.append(((blind.mean - truth) / blind.std) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 60))
    assert np.mean(misses) == pytest.approx(3.0, abs=4 * math.sqrt(6 / 60))
    assert np.mean(naive) > 2.0
    assert min(stds) > 1e-3


def test_what_a_calibration_leaves_in_the_pixels_does_not_average_out():
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(18)
    squares, naive = [], []
    for _ in range(40):
        truth = random.normal(1.355, 0.015)
        pixels = images(setting.rig.with_target_index(truth), path(setting, 60, random))
        pixels += random.normal(0.0, 0.2, 4) + PIXEL_STD * random.standard_normal(pixels.shape)
        state = run(IndexEstimator(1.355, 0.015, calibration_std=0.2), setting.rig, pixels)[-1]
        squares.append(((state.mean - truth) / state.std) ** 2)
        blind = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)[-1]
        naive.append(((blind.mean - truth) / blind.std) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 40))
    assert np.mean(naive) > 3.0


def test_in_salt_water_with_a_gradient_it_finds_the_mean_index_and_the_depth():
    """The paper's Sec. 5.3: the washbowl, the target on the floor, salt not stirred."""
    random = np.random.default_rng(19)
    setting = SETTINGS['washbowl, corner']
    layers, step = 20, 0.0245
    errors, scores = {'estimated': [], 'assumed': []}, []
    for _ in range(12):
        surface, floor = np.sort(random.uniform(1.333, 1.38, 2))
        indices = np.linspace(surface, floor, layers)
        truth = mean_index(indices, [step] * layers)
        graded = rig_through(FlatInterface((0, 0, 1), 0.8, (1.0, *indices), [step] * (layers - 1)))
        points = path(setting, 150, random)
        points[:, 2] = 0.8 + layers * step
        pixels = images(graded, points) + PIXEL_STD * random.standard_normal((150, 4))
        states = run(IndexEstimator(1.355, 0.0144), setting.rig, pixels)
        fresh = triangulate(
            setting.rig.with_target_index(1.33), pixels[-30:, :2], pixels[-30:, 2:]
        )
        found = np.array([state.point for state in states[-30:]])
        errors['estimated'].append(np.mean(found - points[-30:], axis=0))
        errors['assumed'].append(np.mean(fresh.points - points[-30:], axis=0))
        scores.append((states[-1].mean - truth) / states[-1].std)
        assert states[-1].observed
    rms = {name: np.sqrt(np.mean(np.square(e))) for name, e in errors.items()}
    assert rms['estimated'] < 0.25 * rms['assumed']
    assert np.mean(np.square(scores)) < 2.5


def orientation(path):
    """Camera, centre (3,) m and camera_from_world (3,3) of an OpenPTV .ori file (SOURCE.md)."""
    numbers = [float(word) for word in path.read_text().split()]
    centre, from_camera = np.array(numbers[:3]) * 1e-3, np.array(numbers[6:15]).reshape(3, 3)
    x, y, constant = numbers[15:18]
    pixel = 0.00586
    focal = constant / pixel
    matrix = [[focal, 0, 960 + x / pixel], [0, focal, 600 - y / pixel], [0, 0, 1]]
    camera = PinholeCamera(matrix, [], (1920, 1200))
    return camera, centre, np.diag([1, -1, -1]) @ from_camera.T


def test_a_real_rig_whose_epipolar_errors_are_systematic_is_not_overconfident(shared_data):
    """Air, glass, water; the published calibration leaves 0.5 px of epipolar error per plane.

    Taken for noise, these errors make an index of 1.43; considered, they leave room for water.
    """
    folder = shared_data / 'openptv-multiplane' / 'cal'
    left, left_centre, left_from_world = orientation(folder / 'cam1.tif.ori')
    right, right_centre, right_from_world = orientation(folder / 'cam2.tif.ori')
    glass = FlatInterface(
        left_from_world @ (0, 0, -1), left_centre[2] - 0.012, (1, 1.46, 1.34), (0.006,)
    )
    rig = StereoRig(
        left,
        right,
        right_from_world @ left_from_world.T,
        right_from_world @ (left_centre - right_centre),
        glass,
    )
    dots = [
        [np.loadtxt(folder / f'plane{plane}_cam{camera}.tif.crd') for camera in (1, 2)]
        for plane in (1, 2, 3, 4)
    ]
    pixels = np.vstack([np.hstack([one[:, 1:], two[:, 1:]]) for one, two in dots])
    pixels = np.random.default_rng(0).permutation(pixels)
    considered = run(IndexEstimator(1.34, 0.03, calibration_std=0.5), rig, pixels, std=0.2)[-1]
    assert abs(considered.mean - 1.333) < 3 * considered.std
    blind = run(IndexEstimator(1.34, 0.03), rig, pixels, std=0.2)[-1]
    for name, state in (('considered', considered), ('taken for noise', blind)):
        print(f'{name}: {state.mean:.3f} +- {state.std:.3f}')
    assert blind.std < considered.std
    assert abs(blind.mean - 1.333) > 3 * blind.std


@pytest.mark.parametrize('prior_mean', [1.02, 1.33, 2.5])
def test_with_a_wide_prior_the_index_stays_possible_and_is_found(prior_mean):
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(21)
    pixels = images(setting.rig, path(setting, 60, random))
    pixels += PIXEL_STD * random.standard_normal(pixels.shape)
    states = run(IndexEstimator(prior_mean, 0.5), setting.rig, pixels)
    assert all(1.0 <= state.mean <= 4.0 for state in states)
    assert states[-1].mean == pytest.approx(1.355, abs=4 * states[-1].std)
    assert states[-1].std < 0.005


@pytest.mark.parametrize(
    ('left', 'covariance', 'reason'),
    [
        ([np.nan, 480.0], COVARIANCE, 'finite'),
        ([600.0, 480.0], [[1.0, 2.0], [2.0, 1.0]], 'left covariance is not positive definite'),
        ([100.0, 480.0], COVARIANCE, ''),
    ],
)
def test_a_pair_without_a_point_leaves_the_index_alone_and_has_a_reason(left, covariance, reason):
    rig = SETTINGS['washbowl, corner'].rig
    state = IndexEstimator(1.34, 0.015).update(rig, left, [500.0, 480.0], covariance, COVARIANCE)
    assert reason in state.reason
    assert state.reason
    assert (state.mean, state.std, state.observed) == (1.34, 0.015, False)
    assert np.isnan(state.point).all()
    assert np.isnan(state.covariance).all()


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'prior_mean': 0.9, 'prior_std': 0.01}, 'no refractive index'),
        ({'prior_mean': math.nan, 'prior_std': 0.01}, 'no refractive index'),
        ({'prior_mean': 1.33, 'prior_std': 0.0}, 'prior std'),
        ({'prior_mean': 1.33, 'prior_std': 0.01, 'drift': -1e-4}, 'drift'),
        ({'prior_mean': 1.33, 'prior_std': 0.01, 'gate': 0.0}, 'gate'),
        ({'prior_mean': 1.33, 'prior_std': 0.01, 'parameter_covariance': np.ones(3)}, 'shape'),
        (
            {'prior_mean': 1.33, 'prior_std': 0.01, 'parameter_covariance': np.diag([0, -1, 1])},
            'positive',
        ),
    ],
)
def test_bad_options_are_refused_in_one_line(arguments, message):
    with pytest.raises(TriangulationError, match=message) as caught:
        IndexEstimator(**arguments)
    assert '\n' not in str(caught.value)


def test_bad_calls_are_refused_in_one_line():
    air = rig_through(None)
    rig = SETTINGS['washbowl, corner'].rig
    estimator = IndexEstimator(1.33, 0.01)
    with pytest.raises((TriangulationError, OpticsError), match='no surface'):
        estimator.update(air, (600, 480), (500, 480))
    with pytest.raises(TriangulationError, match='one pair at a time'):
        estimator.update(rig, [(600, 480)] * 2, [(500, 480)] * 2)
    with pytest.raises(TriangulationError, match=r'interface\.distance'):
        IndexEstimator(1.33, 0.01, parameter_covariance=np.eye(2)).update(
            rig, (600, 480), (5, 480)
        )
