"""The whole suite on the paper's washbowl: offline speed and memory, accuracy, live latency.

    python bench/pipeline.py [BAG]

BAG is a bag of `binopos simulate --preset washbowl`; without it one is made (300 pairs). The last
part needs ROS and wants both cores for itself.
"""

from __future__ import annotations

import csv
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from binopos_ros.bag import BagReader, BagWriter
from binopos_ros.bag.messages import position_of
from figures import Column, Figures

REPEATS, ROUNDS = 10, 3
SECOND = 1_000_000_000


def run(*words: object) -> tuple[float, float, str]:
    """Seconds, peak memory of the process in MB, and stdout of a binopos verb."""
    begin = time.perf_counter()
    code = (
        'import resource, sys; from binopos_ros.cli import main; status = main(sys.argv[1:]); '
        'print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss); sys.exit(status)'
    )
    done = subprocess.run(
        [sys.executable, '-c', code, *map(str, words)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        sys.exit(done.stderr)
    *lines, peak = done.stdout.splitlines()
    return time.perf_counter() - begin, int(peak.split()[1]) / 1024, '\n'.join(lines)


def repeated(bag: Path, copy: Path) -> Path:
    """The bag played ten times over, its stamps running on."""
    with BagReader(bag) as reader, BagWriter(copy) as writer:
        length = reader.end_ns - reader.start_ns
        period = round(length / (reader.topics['/stereo/truth/pose'].count - 1))
        for topic, info in reader.topics.items():
            writer.add_topic(topic, info.type)
        for k in range(REPEATS):
            shift = k * (length + period)
            for record in reader.messages():
                data = bytearray(record.data)
                # Every message of the suite begins with its header's stamp.
                seconds, rest = struct.unpack_from('<iI', data, 4)
                struct.pack_into('<iI', data, 4, *divmod(seconds * SECOND + rest + shift, SECOND))
                writer.write(record.topic, record.stamp_ns + shift, bytes(data))
    shutil.copy(bag / 'binopos.yaml', copy)
    return copy


def errors(bag: Path, table: Path) -> np.ndarray:
    """(N, 3) m: raw positions minus truth."""
    with BagReader(bag) as reader:
        messages = map(reader.decode, reader.messages(['/stereo/truth/pose']))
        truth = np.array([position_of(message) for message in messages])
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    found = np.array([[float(row[f'raw_{axis}']) for axis in 'xyz'] for row in rows])
    return found - truth


def main() -> None:
    found = Figures('pipeline', peers=('simplejpeg',))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = Path(sys.argv[1]) if len(sys.argv) > 1 else folder / 'washbowl'
        if not bag.exists():
            run('simulate', '-o', bag, '--preset', 'washbowl')
        with BagReader(bag) as reader:
            seconds = (reader.end_ns - reader.start_ns) / SECOND
            pairs = reader.topics['/stereo/truth/pose'].count

        offline = found.table(
            'offline',
            '`process`',
            Column('s', '.2f'),
            Column('times real time', '.1f', '<'),
            Column('peak memory, MB', '.0f'),
        )
        runs = [
            run('process', bag, '-o', folder / f'{k}.mcap', '--csv', folder / f'{k}.csv')
            for k in range(ROUNDS)
        ]
        taken, peaks, _ = zip(*runs, strict=True)
        offline.row(f'{pairs} pairs', taken, seconds / min(taken), max(peaks))
        long = repeated(bag, folder / 'long')
        once, peak, _ = run('process', long, '-o', folder / 'long.mcap')
        offline.row(f'{REPEATS * pairs:,} pairs', once, REPEATS * seconds / once, peak)

        accuracy = found.table(
            'errors',
            '`target/position` against truth, RMS in mm',
            Column('3-D', '.3f'),
            *(Column(axis, '.3f') for axis in 'xyz'),
        )
        for method in ('refractive', 'paper', 'straight'):
            table = folder / f'{method}.csv'
            words = ('--ros-args', '-p', f'triangulator:method:={method}')
            run('process', bag, '-o', folder / f'{method}.mcap', '--csv', table, *words)
            each = errors(bag, table)
            axes = np.sqrt((each**2).mean(axis=0)) * 1e3
            total = np.sqrt((each**2).sum(axis=1).mean()) * 1e3
            accuracy.row(f'`{method}`, {len(each)} pairs', total, *axes)

        live = found.table('live', 'live, at rate 1', Column(''))
        _, _, report = run('replay', bag)
        for line in report.splitlines():
            # The parameters' files lie in a folder that is gone.
            if line.startswith('  ') and not line.startswith('  parameters'):
                live.row(*re.split(r'  +', line.strip(), maxsplit=1))
    found.keep()
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f'processor time in all: {children.ru_utime + children.ru_stime:.0f} s')


if __name__ == '__main__':
    main()
