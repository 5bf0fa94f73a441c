"""Paths of a target over time: still, drifting, moving, manoeuvring, stop-and-go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: The kinds of path.
KINDS = ('still', 'drifting', 'moving', 'manoeuvring', 'stop-and-go')

_STEP = 1e-3
#: Half the extent of the water that the targets keep to, about its middle (m).
_EXTENT = np.array([0.3, 0.2, 0.12])


class Path(NamedTuple):
    """Positions, velocities and accelerations (n, 3) in m, m/s, m/s^2, about the middle."""

    position: Array
    velocity: Array
    acceleration: Array


def draw_path(kind: str, times: Array, random: np.random.Generator) -> Path:
    """Draw a path of that kind, within 0.3 x 0.2 x 0.12 m about its middle, at `times` (n,), s."""
    fine = np.arange(times[0], times[-1] + 2.0 * _STEP, _STEP)
    velocity = _VELOCITIES[kind](fine, random)
    position = np.cumsum(velocity, axis=0) * _STEP
    middle = 0.5 * (position.max(axis=0) + position.min(axis=0))
    extent = 0.5 * (position.max(axis=0) - position.min(axis=0))
    shrink = min(1.0, float(np.min(_EXTENT / np.maximum(extent, 1e-12))))
    place = random.uniform(-1.0, 1.0, 3) * (_EXTENT - shrink * extent)
    position = shrink * (position - middle) + place
    velocity = shrink * velocity
    acceleration = np.gradient(velocity, _STEP, axis=0)
    return Path(*(_at(times, fine, values) for values in (position, velocity, acceleration)))


def _at(times: Array, fine: Array, values: Array) -> Array:
    return np.column_stack([np.interp(times, fine, column) for column in values.T])


def _direction(random: np.random.Generator) -> Array:
    """Return a unit vector, flatter than the sphere's: basins are wider than deep."""
    vector = random.standard_normal(3) * np.array([1.0, 0.7, 0.4])
    return vector / np.linalg.norm(vector)


def _smooth(values: Array, seconds: float) -> Array:
    """Return `values` (n, k) under a raised-cosine window: bounded acceleration."""
    length = max(int(seconds / _STEP), 3)
    window = np.hanning(length + 2)[1:-1]
    padded = np.pad(values, ((length, length), (0, 0)), mode='edge')
    spectrum = np.fft.rfft(padded, axis=0)
    kernel = np.zeros(len(padded))
    kernel[:length] = window / window.sum()
    kernel = np.roll(kernel, -(length // 2))
    result = np.fft.irfft(spectrum * np.fft.rfft(kernel)[:, None], len(padded), axis=0)
    return result[length:-length]


def _still(fine: Array, random: np.random.Generator) -> Array:
    return np.zeros((fine.size, 3))


def _drifting(fine: Array, random: np.random.Generator) -> Array:
    speed = np.exp(random.uniform(np.log(0.001), np.log(0.01)))
    steady = np.tile(speed * _direction(random), (fine.size, 1))
    wander = _smooth(random.standard_normal((fine.size, 3)), 3.0)
    return steady + 0.3 * speed * wander / max(float(wander.std()), 1e-12)


def _moving(fine: Array, random: np.random.Generator) -> Array:
    """Straight at a constant speed; back again after each 3 to 6 s, by a smooth turn."""
    speed = random.uniform(0.03, 0.2)
    velocity = np.tile(speed * _direction(random), (fine.size, 1))
    turns = np.cumsum(random.uniform(3.0, 6.0, 50)) + fine[0]
    sign = np.where(np.searchsorted(turns, fine) % 2 == 0, 1.0, -1.0)
    return _smooth(velocity * sign[:, None], random.uniform(0.3, 0.8))


def _manoeuvring(fine: Array, random: np.random.Generator) -> Array:
    """Turn after turn: circles of changing size and sense, faster and slower."""
    count = 3
    frequency = random.uniform(0.1, 0.6, (count, 1, 1))
    phase = random.uniform(0.0, 2.0 * np.pi, (count, 1, 3))
    size = random.uniform(0.3, 1.0, (count, 1, 3)) * np.array([1.0, 0.7, 0.4])
    swings = size * np.cos(2.0 * np.pi * frequency * fine[None, :, None] + phase)
    velocity = np.asarray(swings.sum(axis=0))
    speed = random.uniform(0.05, 0.25)
    return speed * velocity / float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))


def _stop_and_go(fine: Array, random: np.random.Generator) -> Array:
    velocity = np.zeros((fine.size, 3))
    now, go = fine[0], bool(random.integers(2))
    while now < fine[-1]:
        until = now + random.uniform(1.0, 3.0)
        if go:
            leg = (fine >= now) & (fine < until)
            velocity[leg] = random.uniform(0.03, 0.2) * _direction(random)
        now, go = until, not go
    return _smooth(velocity, random.uniform(0.2, 0.6))


_VELOCITIES = {
    'still': _still,
    'drifting': _drifting,
    'moving': _moving,
    'manoeuvring': _manoeuvring,
    'stop-and-go': _stop_and_go,
}
