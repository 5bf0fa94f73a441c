"""Training of the BP-Kalman's network by back-propagation, on the sequences of the tuning."""

from __future__ import annotations

from collections.abc import Sequence as Series

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.score import SETTLING
from binopos_ros.evaluation.trials.sequences import Sequence
from binopos_ros.smoothing.opponents.bp_kalman import (
    INNOVATIONS,
    BackPropagationKalmanFilter,
    Network,
    features,
)

Array = NDArray[np.float64]

_HIDDEN = 8
_EPOCHS = 60
_BATCH = 256
_RATE = 3e-3
#: A target beyond this many deviations is a wrong detection's doing: no network can learn it.
_LARGEST_TARGET = 3.0


def examples(trials: Series[Sequence], **options: float) -> tuple[Array, Array]:
    """Return inputs (n, k) and wished corrections (n,) of a filter with `options`."""
    inputs, wished = [], []
    smoother = BackPropagationKalmanFilter(**options)
    for trial in trials:
        memory, stamp = None, 0.0
        for number in np.flatnonzero(np.isfinite(trial.positions[:, 0])):
            position, covariance = trial.positions[number], trial.covariances[number]
            if memory is None:
                memory = smoother._start(position, covariance)
            else:
                memory = smoother._advance(memory, trial.stamps[number] - stamp)
                noise = smoother.options.measurement_covariance(covariance)
                seen, _, deviation = features(memory.gaussian, memory.innovations, position, noise)
                memory = smoother._correct(memory, position, covariance)
                if number >= SETTLING:
                    error = trial.truth[number] - memory.gaussian.state[:3]
                    inputs.append(seen)
                    wished.append(error / deviation)
            stamp = trial.stamps[number]
    return np.concatenate(inputs), np.concatenate(wished)


def train(inputs: Array, wished: Array) -> Network:
    """Return the network fitted to the examples, by Adam (Kingma & Ba, ICLR 2015)."""
    random = np.random.default_rng(1)
    wished = np.clip(wished, -_LARGEST_TARGET, _LARGEST_TARGET)
    values = [
        random.normal(0.0, 0.4, (INNOVATIONS + 1, _HIDDEN)),
        np.zeros(_HIDDEN),
        random.normal(0.0, 0.1, _HIDDEN),
        np.zeros(1),
    ]
    means = [np.zeros_like(value) for value in values]
    squares = [np.zeros_like(value) for value in values]
    steps = 0
    for epoch in range(_EPOCHS):
        rate = _RATE * (1.0 - epoch / _EPOCHS)
        order = random.permutation(len(wished))
        for begin in range(0, len(order) - _BATCH + 1, _BATCH):
            rows = order[begin : begin + _BATCH]
            steps += 1
            gradients = _gradients(values, inputs[rows], wished[rows])
            for number, gradient in enumerate(gradients):
                means[number] += 0.1 * (gradient - means[number])
                squares[number] += 0.001 * (gradient * gradient - squares[number])
                fair_mean = means[number] / (1.0 - 0.9**steps)
                fair_square = squares[number] / (1.0 - 0.999**steps)
                values[number] -= rate * fair_mean / (np.sqrt(fair_square) + 1e-8)
    return Network(values[0], values[1], values[2], float(values[3][0]))


def _gradients(values: list[Array], inputs: Array, wished: Array) -> list[Array]:
    """Return the derivatives of the mean squared error by back-propagation."""
    hidden, bias, output, output_bias = values
    active = np.tanh(inputs @ hidden + bias)
    error = (active @ output + output_bias - wished) * (2.0 / len(wished))
    back = error[:, None] * output * (1.0 - active * active)
    return [inputs.T @ back, back.sum(axis=0), active.T @ error, error.sum(keepdims=True)]
