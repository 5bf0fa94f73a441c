"""Tune the filters and write the values into binopos_ros/smoothing/tuned.py.

python bench/tune_filters.py [FILTER ...] tunes these (default: all), each with the same optimiser,
budget and training sequences; test sequences are never looked at.
"""

from __future__ import annotations

import argparse
import fcntl
import importlib
import pprint
import time
from pathlib import Path

from binopos_ros.smoothing import tuned
from binopos_ros.smoothing.trials.sequences import training_set
from binopos_ros.smoothing.trials.tuning import SEARCHED, minimise, objective, options_at

HEADER = '''"""Tuned defaults of every filter, found by ``python bench/tune_filters.py``."""

from __future__ import annotations

'''


def main() -> None:
    """Tune the named filters one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('filters', nargs='*', default=list(SEARCHED), help='names; default: all')
    parser.add_argument('--budget', type=int, default=201, help='evaluations per filter')
    parser.add_argument('--sequences', type=int, default=40, help='training sequences')
    arguments = parser.parse_args()
    trials = training_set(arguments.sequences)
    for name in arguments.filters:
        began = time.perf_counter()
        place, value = minimise(
            lambda at, name=name: objective(name, options_at(name, at), trials),
            len(SEARCHED[name]),
            arguments.budget,
        )
        options = options_at(name, place)
        save(name, options)
        seconds = time.perf_counter() - began
        print(f'{name}: {value:.4f} in {seconds:.0f} s: {options}', flush=True)


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
