"""Fair tuning: one optimiser, one budget and one training set for every filter.

The optimiser is the separable CMA-ES of Ros & Hansen, "A simple modification in CMA-ES achieving
linear time and space complexity", PPSN 2008, over the logarithms of the options.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Sequence as Series

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.score import run_together
from binopos_ros.evaluation.trials.sequences import Sequence
from binopos_ros.smoothing.factory import make_filter

Array = NDArray[np.float64]

_MEASUREMENT = {'measurement_scale': (1.0, 1e3), 'measurement_std': (1e-4, 0.03)}
_KALMAN = {**_MEASUREMENT, 'acceleration_density': (1e-6, 1.0)}

#: What is tuned of each filter, and between which values.
SEARCHED: dict[str, dict[str, tuple[float, float]]] = {
    'kalman': _KALMAN,
    'kalman-random-walk': {**_MEASUREMENT, 'walk_density': (1e-7, 1e-2)},
    'sage-husa': {**_KALMAN, 'forgetting': (0.8, 0.9999), 'divergence': (1.2, 10.0)},
    'huber': {**_KALMAN, 'threshold': (0.2, 5.0)},
    'student-t': {**_KALMAN, 'freedom': (2.2, 30.0)},
    'variational-bayes': {**_KALMAN, 'spreading': (0.8, 0.9999)},
    'imm': {
        **_MEASUREMENT,
        'low_density': (1e-9, 1e-3),
        'middle_density': (1e-6, 1e-1),
        'high_density': (1e-4, 10.0),
        'dwell': (0.1, 30.0),
    },
    'coloured-noise': {**_KALMAN, 'frequency': (1.0, 6.0), 'damping': (0.05, 0.9)},
    'median': {'window': (3, 60)},
    'cloud-kalman-paper': {**_KALMAN, 'window': (5, 300)},
}


def objective(filter_name: str, options: dict[str, float], trials: Series[Sequence]) -> float:
    """Return what tuning makes small, about the logarithm of an RMS in metres.

    Half the logarithm of the mean RMS, which large errors rule, and half the mean logarithm of the
    RMS, in which every sequence counts alike.
    """
    smoother = make_filter(filter_name, **options)
    rms = np.array([track.rms for track in run_together(smoother, trials)])
    if not np.all(np.isfinite(rms)):
        return math.inf
    return float(0.5 * np.log(rms.mean()) + 0.5 * np.log(rms).mean())


def options_at(filter_name: str, place: Array) -> dict[str, float]:
    """Return the options at a place in the unit cube of the searched logarithms."""
    result: dict[str, float] = {}
    shares = np.clip(place, 0.0, 1.0).tolist()
    for (name, (low, high)), share in zip(SEARCHED[filter_name].items(), shares, strict=True):
        if name in ('forgetting', 'spreading'):
            value = 1.0 - (1.0 - low) * ((1.0 - high) / (1.0 - low)) ** share
        else:
            value = low * (high / low) ** share
        result[name] = round(value) if isinstance(low, int) else float(f'{value:.4g}')
    return result


def minimise(
    function: Callable[[Array], float], dimensions: int, budget: int
) -> tuple[Array, float]:
    """Return the best of `budget` places in the unit cube, and its value: separable CMA-ES."""
    random = np.random.default_rng(1)
    offspring = 10
    parents = offspring // 2
    weights = math.log(parents + 0.5) - np.log(np.arange(1, parents + 1))
    weights /= weights.sum()
    effective = 1.0 / float(np.sum(weights**2))
    c_sigma = (effective + 2.0) / (dimensions + effective + 5.0)
    d_sigma = 1.0 + c_sigma + 2.0 * max(0.0, math.sqrt((effective - 1) / (dimensions + 1)) - 1.0)
    c_path = 4.0 / (dimensions + 4.0)
    c_one = 2.0 / ((dimensions + 1.3) ** 2 + effective)
    c_mu = 2.0 * (effective - 2.0 + 1.0 / effective) / ((dimensions + 2.0) ** 2 + effective)
    c_one, c_mu = ((dimensions + 2.0) / 3.0 * value for value in (c_one, c_mu))
    c_mu = min(c_mu, 1.0 - min(c_one, 0.5))
    norm = math.sqrt(dimensions) * (1 - 1 / (4 * dimensions) + 1 / (21 * dimensions**2))
    mean, sigma = np.full(dimensions, 0.5), 0.2
    scale, path, path_sigma = np.ones(dimensions), np.zeros(dimensions), np.zeros(dimensions)
    best, best_value = mean, function(mean)
    for generation in range((budget - 1) // offspring):
        steps = random.standard_normal((offspring, dimensions)) * np.sqrt(scale)
        places = np.clip(mean + sigma * steps, 0.0, 1.0)
        steps = (places - mean) / sigma
        values = np.array([function(place) for place in places])
        order = np.argsort(values)[:parents]
        if values[order[0]] < best_value:
            best, best_value = places[order[0]], float(values[order[0]])
        step = weights @ steps[order]
        mean = mean + sigma * step
        path_sigma = (1 - c_sigma) * path_sigma + math.sqrt(
            c_sigma * (2 - c_sigma) * effective
        ) * step / np.sqrt(scale)
        length = float(np.linalg.norm(path_sigma))
        steady = (
            length / math.sqrt(1 - (1 - c_sigma) ** (2 * generation + 2))
            < (1.4 + 2 / (dimensions + 1)) * norm
        )
        path = (1 - c_path) * path
        if steady:
            path = path + math.sqrt(c_path * (2 - c_path) * effective) * step
        scale = (
            max(1.0 - c_one - c_mu, 0.0) * scale
            + c_one * path**2
            + c_mu * weights @ steps[order] ** 2
        )
        sigma *= math.exp(min(1.0, c_sigma / d_sigma * (length / norm - 1.0)))
    return best, best_value
