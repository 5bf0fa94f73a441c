"""What the default filter believes: the rungs of its ladder while a target rests, goes and shakes.

python docs/figures/smoothing_ladder.py [PNG]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import matplotlib.pyplot as plt
import numpy as np

from binopos_ros.smoothing import ladder, rungs

RATE = 30.0
#: Deviation of a measured position (mm).
NOISE = 1.0
SECONDS = 12.0
#: Seconds at which it begins to go, stops, begins to be shaken, and rests again.
GOES, STOPS, SHAKES, RESTS = 3.0, 5.0, 7.0, 10.0


def main() -> None:
    """Draw the picture."""
    target = Path(sys.argv[1] if len(sys.argv) > 1 else 'docs/figures/smoothing_ladder.png')
    stamps = np.arange(0.0, SECONDS, 1.0 / RATE)
    going = np.clip(stamps, GOES, STOPS) - GOES
    shaken = (stamps >= SHAKES) & (stamps < RESTS)
    truth = 20.0 * going + 8.0 * shaken * np.sin(2.0 * np.pi * 3.0 * (stamps - SHAKES))
    measured = truth + np.random.default_rng(1).normal(0.0, NOISE, stamps.size)
    filtered, shares = run(measured)
    figure, (path, errors, shares_of) = plt.subplots(
        3, 1, figsize=(8, 7), sharex=True, height_ratios=(2, 2, 3), layout='constrained'
    )
    path.plot(stamps, truth, 'k', lw=1)
    path.set_ylabel('target (mm)')
    path.set_title('rests, goes straight on, rests, is shaken at 3 Hz, rests')
    errors.plot(stamps, measured - truth, '.', color='0.7', label='positions')
    errors.plot(stamps, filtered - truth, color='tab:red', label='poses')
    errors.set_ylabel('error (mm)')
    errors.legend(loc='lower left', ncol=2)
    order = np.argsort(rungs.HEIGHTS, kind='stable')
    shares_of.pcolormesh(stamps, np.arange(rungs.RUNGS), shares[:, order].T, cmap='Blues')
    shares_of.set_yticks(np.arange(rungs.RUNGS), [names()[rung] for rung in order], fontsize=7)
    shares_of.set_ylabel('probability of each rung')
    shares_of.set_xlabel('time (s)')
    figure.savefig(target, dpi=100)


def run(measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (n,), mm, and the probabilities (n, R) of the rungs, along one axis."""
    variance = np.full(3, NOISE**2)
    chain = rungs.switching(20.0)
    now = ladder.start(np.full(3, measured[0]), variance)
    poses, shares = [], []
    for number, position in enumerate(measured):
        if number > 0:
            now = ladder.advance(now, chain, 1.0 / RATE)
            now = ladder.correct(now, np.full(3, position), variance, 0.02, 1e9)
        poses.append(ladder.mean_position(now)[0])
        shares.append(now.moments[ladder.WEIGHT, 0])
    return np.array(poses), np.array(shares)


def names() -> list[str]:
    """Return what each rung is called."""
    standing = ['at rest', *(f'wanders, {gained:g}' for gained in rungs.GAINED[1:])]
    return [*standing, 'steady', *(f'{index:g}' for index in rungs.INDICES[rungs.STEADY + 1 :])]


if __name__ == '__main__':
    main()
