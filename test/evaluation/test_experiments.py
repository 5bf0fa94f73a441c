"""The experiments against what geometry and statistics say of them."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.evaluation import EvaluationError, Settings
from binopos_ros.evaluation.comparison import error_ranges, lag_of, mean_errors
from binopos_ros.evaluation.media import _place, salted, transforming, wavy
from binopos_ros.simulation import washbowl


def test_errors_in_calm_water_reach_the_cramer_rao_bound() -> None:
    """Bound from finite differences of the rig's projection at the experiment's own place."""
    settings = Settings(frames=2000, pixel_std=0.1)
    errors = transforming(settings, 3)['refractive']
    scene = washbowl()
    target = _place(scene, np.random.default_rng([settings.seed, 0, 3]))
    step = 1e-6
    columns = []
    for axis in range(3):
        ahead, behind = (
            np.concatenate(scene.rig.project(target + sign * step * np.eye(3)[axis]))
            for sign in (1, -1)
        )
        columns.append((ahead - behind) / (2 * step))
    jacobian = np.stack(columns, axis=1)
    bound = np.linalg.inv(jacobian.T @ jacobian) * settings.pixel_std**2
    found = errors.T @ errors / len(errors)
    np.testing.assert_allclose(np.sqrt(np.diag(found) / np.diag(bound)), 1, atol=0.06)


def test_straight_rays_are_far_off_in_every_experiment() -> None:
    settings = Settings(frames=40)
    for number in range(3):
        errors = transforming(settings, number)
        size = {name: np.linalg.norm(values, axis=1).mean() for name, values in errors.items()}
        assert size['straight'] > 20 * size['refractive']
        assert size['paper'] < size['straight']


def test_the_index_is_followed_within_its_stated_deviation() -> None:
    found = salted(Settings(experiments=30, frames=40), lambda: None)
    assert (np.diff(found.truth) > 0).all()
    squared = ((found.estimate - found.truth) / found.index_std) ** 2
    assert 0.2 < squared.mean() < 2.5
    size = {name: np.sqrt(np.mean(values**2)) for name, values in found.errors.items()}
    assert size['true mean'] < 0.2e-3
    assert size['true mean'] < size['estimated'] < size['1.333 assumed']


def test_waves_displace_the_target_beyond_its_stated_noise_and_about_its_place() -> None:
    settings = Settings(frames=200)
    for number in range(3):
        trial = wavy(settings, number)
        assert np.ptp(trial.truth, axis=0).max() == 0
        error = trial.positions - trial.truth
        scaled = np.linalg.solve(trial.covariances, error[:, :, None])[:, :, 0]
        assert np.mean(np.sum(error * scaled, axis=1)) / 3 > 10
        # Depth suffers most, and the mean over many waves is near the truth.
        assert error[:, 2].std() > 3 * error[:, :2].std()
        assert np.abs(error.mean(axis=0)).max() < error[:, 2].std()


def test_experiments_repeat_and_differ() -> None:
    settings = Settings(frames=40)
    np.testing.assert_array_equal(wavy(settings, 1).positions, wavy(settings, 1).positions)
    assert not np.allclose(wavy(settings, 1).positions, wavy(settings, 2).positions)


def test_an_estimate_that_trails_by_fifty_milliseconds_has_that_lag() -> None:
    times = np.arange(0, 10, 1 / 30)
    velocity = np.column_stack([np.cos(times), np.sin(2 * times), 0 * times])

    def place(at: np.ndarray) -> np.ndarray:
        return np.column_stack([np.sin(at), -0.5 * np.cos(2 * at), 0 * at])

    late = place(times - 0.05) - place(times)
    assert lag_of(late, velocity) == pytest.approx(0.05, rel=0.01)
    assert np.isnan(lag_of(late, 1e-3 * velocity))


def test_error_range_and_euclidean_error_are_the_papers() -> None:
    errors = np.zeros((1, 60, 3))
    errors[0, 0] = 1.0  # before the filter has settled
    errors[0, 40] = [3.0, 0.0, -4.0]
    errors[0, 50] = [-1.0, 0.0, 0.0]
    np.testing.assert_allclose(error_ranges(errors), [[4.0, 0.0, 4.0]])
    np.testing.assert_allclose(mean_errors(errors), [(np.sqrt(3) + 5 + 1) / 60])


@pytest.mark.parametrize(
    'bad', [{'experiments': 1}, {'frames': 10}, {'pixel_std': 0.0}, {'sequences': 0}]
)
def test_sizes_that_compare_nothing_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(EvaluationError, match='give'):
        Settings(**bad)  # type: ignore[arg-type]
