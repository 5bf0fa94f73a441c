"""Tune the filters and write the values into binopos_ros/smoothing/tuned.py.

python bench/smoothing/tune.py [FILTER ...] tunes these (default: all), each with the same
optimiser, budget and training sequences; test sequences are never looked at. The default
filter has nothing that is tuned but the constants of `wave_bases.Motion`, found the same way.
"""

from __future__ import annotations

import argparse
import fcntl
import importlib
import pprint
import time
from collections.abc import Sequence as Series
from pathlib import Path

import numpy as np

from binopos_ros.evaluation.trials.sequences import Sequence, training_set
from binopos_ros.evaluation.trials.training import examples, train
from binopos_ros.evaluation.trials.tuning import SEARCHED, minimise, objective, options_at
from binopos_ros.smoothing import tuned
from binopos_ros.smoothing.opponents import bp_weights

WEIGHTS_HEADER = '''"""The BP-Kalman filter's network, from ``python bench/smoothing/tune.py``."""
'''
HEADER = '''"""Tuned defaults of every filter, found by ``python bench/smoothing/tune.py``."""

from __future__ import annotations

'''


def main() -> None:
    """Tune the named filters one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        'filters', nargs='*', default=[*SEARCHED, 'bp-kalman'], help='names; default: all'
    )
    parser.add_argument('--budget', type=int, default=201, help='evaluations per filter')
    parser.add_argument('--sequences', type=int, default=40, help='training sequences')
    arguments = parser.parse_args()
    trials = training_set(arguments.sequences)
    for name in arguments.filters:
        if name == 'bp-kalman':
            train_network(trials)
            continue
        began = time.perf_counter()
        place, value = minimise(
            lambda at, name=name: objective(name, options_at(name, at), trials),
            len(SEARCHED[name]),
            arguments.budget,
        )
        options = options_at(name, place)
        save(name, {**tuned.TUNED[name], **options})
        seconds = time.perf_counter() - began
        print(f'{name}: {value:.4f} in {seconds:.0f} s: {options}', flush=True)


def train_network(trials: Series[Sequence]) -> None:
    """Train the BP-Kalman's network on top of the tuned Kalman filter, and write its weights."""
    kalman = tuned.TUNED['kalman']
    save('bp-kalman', kalman)
    inputs, wished = examples(trials, **kalman)
    network = train(inputs, wished)
    before, after = np.mean(wished**2), np.mean((wished - network(inputs)) ** 2)
    lines = [WEIGHTS_HEADER]
    for name, value in zip(('HIDDEN', 'HIDDEN_BIAS', 'OUTPUT'), network[:3], strict=True):
        lines.append(f'{name} = {pprint.pformat(np.round(value, 5).tolist(), width=96)}')
    lines.append(f'OUTPUT_BIAS = {network.output_bias:.5f}')
    Path(bp_weights.__file__).write_text('\n'.join(lines) + '\n')
    print(f'bp-kalman: mean squared error {before:.4f} before, {after:.4f} with the network')


def save(name: str, options: dict[str, float]) -> None:
    """Replace one filter's values in tuned.py; safe beside another run of this command."""
    path = Path(tuned.__file__)
    with path.open('r+') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        values = dict(importlib.reload(tuned).TUNED)
        values[name] = options
        text = pprint.pformat(values, width=98)
        file.seek(0)
        file.write(f'{HEADER}TUNED: dict[str, dict[str, float]] = {text}\n')
        file.truncate()


if __name__ == '__main__':
    main()
