"""The comparison: the paper's experiments, and mixed sequences that no filter was tuned on."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.evaluation.trials.bound import best_possible
from binopos_ros.evaluation.trials.paths import KINDS
from binopos_ros.evaluation.trials.protocols import (
    average_nees,
    control_experiment,
    mixed_protocol,
    nees_band,
    paper_protocol,
    rms,
    smaller,
)
from binopos_ros.evaluation.trials.sequences import paper_set, unseen_set
from binopos_ros.smoothing import FILTERS

OPPONENTS = [name for name in FILTERS if name != 'cloud-kalman']


@pytest.fixture(scope='module')
def paper():
    """Return the paper's protocol with the filters that the paper names."""
    names = ('none', 'kalman', 'sage-husa', 'bp-kalman', 'cloud-kalman')
    return paper_protocol(names, paper_set(100))


@pytest.fixture(scope='module')
def mixed():
    """Return tracks of every filter over unseen mixed sequences, and the sequences."""
    trials = unseen_set(60)
    return mixed_protocol(FILTERS, trials), trials


def test_error_range_is_smaller_than_the_papers_claims(paper):
    ours = paper['cloud-kalman']
    assert smaller(ours, paper['none']) >= 0.3173
    assert smaller(ours, paper['kalman']) >= 0.2334


def test_smallest_mean_error_in_97_of_100_experiments(paper):
    names = ('cloud-kalman', 'sage-husa', 'bp-kalman')
    means = np.stack([paper[name].means for name in names])
    assert np.sum(means.argmin(axis=0) == 0) >= 97


def test_every_filter_beats_the_unfiltered_positions_of_a_still_target(paper):
    for name in set(paper) - {'none'}:
        assert paper[name].means.mean() < paper['none'].means.mean()


@pytest.mark.parametrize('opponent', OPPONENTS)
def test_lowest_error_on_average_and_in_four_of_five_sequences(mixed, opponent):
    tracks, _ = mixed
    ours, theirs = rms(tracks['cloud-kalman']), rms(tracks[opponent])
    assert ours.mean() < theirs.mean()
    assert np.mean(ours < theirs) >= 0.8


def test_a_third_of_the_unfiltered_error_at_most_where_the_target_is_still_or_slow(mixed):
    tracks, trials = mixed
    slow = np.array([trial.kind in ('still', 'drifting') for trial in trials])
    ratio = rms(tracks['cloud-kalman'])[slow] / rms(tracks['none'])[slow]
    assert ratio.max() <= 1.0 / 3.0


def test_covariance_is_consistent(mixed):
    tracks, trials = mixed
    low, high = nees_band(len(trials))
    assert low <= average_nees(tracks['cloud-kalman']) <= high


@pytest.mark.parametrize('kind', KINDS)
def test_covariance_is_within_a_factor_of_two_for_each_kind_of_path(mixed, kind):
    tracks, trials = mixed
    chosen = zip(tracks['cloud-kalman'], trials, strict=True)
    assert 0.5 < average_nees(track for track, trial in chosen if trial.kind == kind) < 2.0


def test_smoother_that_knows_waves_and_motion_beats_every_filter(mixed):
    tracks, trials = mixed
    for number in range(0, 10):
        bound = best_possible(trials[number]).smoothed
        error = np.sqrt(np.mean(np.sum(bound[30:] ** 2, axis=1)))
        assert error < min(rms(tracks[name])[number] for name in FILTERS)


def test_control_parameter_of_one_is_best_for_a_still_target():
    errors = control_experiment(paper_set(100), (-1.0, 0.5, 1.0, 1.5, 2.0))
    means = {control: error.mean(axis=0) for control, error in errors.items()}
    for control in set(means) - {1.0}:
        assert np.all(means[1.0] < means[control])


def test_nees_band_is_the_chi_squares():
    from scipy.stats import chi2

    for count in (20, 200):
        expected = chi2.ppf([0.025, 0.975], 3 * count) / (3 * count)
        np.testing.assert_allclose(nees_band(count), expected, atol=2e-4)
