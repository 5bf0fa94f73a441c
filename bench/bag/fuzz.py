"""Damaged bags by the hundred thousand: `python bench/bag/fuzz.py [COUNT] [SEED]`.

MCAP of every compression, in chunks and without, sqlite3 and metadata, with bytes changed, cut,
doubled or left out and lengths that lie, under a limit of 2 GiB of addresses. Counts what came of
each; anything but messages or a refusal in one line ends the run.
"""

from __future__ import annotations

import collections
import logging
import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import malice

ADDRESSES = 2 << 30


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    logging.disable(logging.CRITICAL)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    answers: collections.Counter[str] = collections.Counter()
    slowest = 0.0
    with tempfile.TemporaryDirectory(prefix='binopos_fuzz_') as folder:
        for name, read in malice.inputs(Path(folder), count, seed):
            start = time.perf_counter()
            try:
                answers[read()] += 1
            except Exception:
                print(f'{name}, of seed {seed}:', file=sys.stderr)
                raise
            slowest = max(slowest, time.perf_counter() - start)
    print(f'{count} damaged bags, seed {seed}: the slowest took {slowest:.2f} s')
    for answer, times in answers.most_common():
        print(f'  {times:7d}  {answer}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
