"""Many bags, a process each, as many at a time as asked for, and one summary.

A bag's outputs are what `binopos process` writes for it alone, to the last byte: nothing is shared
between the processes.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import NamedTuple

from binopos_ros.cli import USAGE_ERROR
from binopos_ros.cli.outputs import OutputError
from binopos_ros.cli.progress import progress
from binopos_ros.cli.terminal import fitted
from binopos_ros.report import Report

BAG_SUFFIXES = ('.mcap', '.bag', '.db3')
#: Columns that a path may take, so that its counts stand beside it on 80.
LONGEST_PATH = 48

#: Does the work of one bag; a function of a module, as it runs in another process.
Work = Callable[[argparse.Namespace], Report]


class Outcome(NamedTuple):
    """What came of one bag: counts, or the line that says why it could not be processed."""

    pairs: int
    poses: int
    drops: Counter[str]
    fault: str = ''

    @classmethod
    def failed(cls, fault: str) -> Outcome:
        """What came of a bag that could not be processed."""
        return cls(0, 0, Counter(), fault)

    @property
    def status(self) -> int:
        """The exit status that the bag alone would give."""
        return USAGE_ERROR if self.fault else int(not self.poses)


def each_alone(arguments: argparse.Namespace) -> list[argparse.Namespace]:
    """The arguments for each bag alone: its outputs lie in the folders that were named.

    Raises:
        OutputError: two bags would have the same output, or the output is no folder.
    """
    folders = [folder for folder in (arguments.output, arguments.csv) if folder is not None]
    for folder in folders:
        if folder.suffix in ('.mcap', '.csv') or folder.is_file():
            msg = f'{folder} is no folder: for several bags name one, in which each has its output'
            raise OutputError(msg)
    names: dict[str, Path] = {}
    alone = []
    for bag in arguments.bags:
        name = bag.stem if bag.suffix in BAG_SUFFIXES else bag.resolve().name
        if name in names:
            msg = f'{names[name]} and {bag} would both be written to {name}.mcap: rename one'
            raise OutputError(msg)
        names[name] = bag
        table = arguments.csv and arguments.csv / f'{name}.csv'
        own = {'bag': bag, 'output': arguments.output / f'{name}.mcap', 'csv': table}
        alone.append(argparse.Namespace(**{**vars(arguments), **own}))
    return alone


def process_all(work: Work, arguments: argparse.Namespace) -> int:
    """Do the work of all bags and print the summary; the exit status is that of the worst."""
    alone = each_alone(arguments)
    outcomes: dict[int, Outcome] = {}
    with progress('bags', len(alone)) as tick:
        for k, outcome in _outcomes(work, alone, arguments.jobs or 1):
            outcomes[k] = outcome
            tick()
    ordered = [outcomes[k] for k in range(len(alone))]
    print(fitted(summary([each.bag for each in alone], ordered)))
    return max(each.status for each in ordered)


def summary(bags: Sequence[Path], outcomes: Sequence[Outcome]) -> str:
    """A line for each bag, and what they come to together.

    Paths that are too long for a column leave the rest of their line to stand beside them.
    """
    width = min(max(len(str(bag)) for bag in bags), LONGEST_PATH)
    rows = [
        f'  {bag!s:<{width}}  {each.fault or f"{each.poses} poses of {each.pairs} pairs"}'
        for bag, each in zip(bags, outcomes, strict=True)
    ]
    drops = sum((each.drops for each in outcomes), Counter[str]())
    faults = sum(bool(each.fault) for each in outcomes)
    totals = [
        ('bags', f'{len(bags)}, {faults} of them could not be processed'),
        ('pairs seen', str(sum(each.pairs for each in outcomes))),
        ('poses', str(sum(each.poses for each in outcomes))),
        *[(f'dropped: {reason}', str(count)) for reason, count in drops.most_common()],
    ]
    width = max(len(name) for name, _ in totals)
    return '\n'.join([*rows, *(f'  {name:<{width}}  {value}' for name, value in totals)])


def _outcomes(
    work: Work, alone: Sequence[argparse.Namespace], jobs: int
) -> Iterator[tuple[int, Outcome]]:
    """The bags' places and outcomes, as they come."""
    running: set[SpawnProcess] = set()
    pool = ThreadPoolExecutor(jobs)
    try:
        futures = {pool.submit(_outcome, work, each, running): k for k, each in enumerate(alone)}
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        # Where all went well nothing runs any more.
        pool.shutdown(wait=False, cancel_futures=True)
        for process in running.copy():
            process.terminate()
        pool.shutdown()


def _outcome(work: Work, arguments: argparse.Namespace, running: set[SpawnProcess]) -> Outcome:
    # Nothing of this process but the arguments: its threads would not survive a fork.
    context = multiprocessing.get_context('spawn')
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work_alone, args=(work, arguments, sender), daemon=True)
    process.start()
    running.add(process)
    sender.close()
    try:
        outcome: Outcome = receiver.recv()
    except EOFError:
        process.join()
        outcome = Outcome.failed(f'its process ended with status {process.exitcode}')
    process.join()
    running.discard(process)
    return outcome


def _work_alone(work: Work, arguments: argparse.Namespace, sender: Connection) -> None:
    """What runs in a bag's process: no word of its own, the outcome to the sender."""
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            report = work(arguments)
    except (ValueError, OSError, RuntimeError) as error:
        sender.send(Outcome.failed(' '.join(str(error).split())))
    except KeyboardInterrupt:
        sender.send(Outcome.failed('interrupted'))
    else:
        sender.send(Outcome(report.seen, len(report.filtered.stamps), report.drops))
