"""A robot that hovers a metre before a target at rest: its bag, and what `process` makes of it."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from binopos_ros.bag import BagReader, BagWriter
from verbs import binopos

PAIRS = 40
ODOMETRY = '/stereo/platform/odometry'


def process(bag: Path, out: Path, *values: str) -> tuple[dict[int, dict[str, str]], str]:
    """The rows by stamp that `process` writes with parameters of the smoother, and its report."""
    out.mkdir(exist_ok=True)
    parameters = [word for value in values for word in ('-p', f'smoother:{value}')]
    done = binopos(
        *('process', bag, '-o', out / 'out.mcap', '--csv', out / 'out.csv'),
        *(['--ros-args', *parameters] if parameters else []),
    )
    assert done.returncode == 0, done.stderr
    return rows_of(out), done.stdout


def rows_of(folder: Path) -> dict[int, dict[str, str]]:
    """The rows by stamp in what `process` wrote."""
    with (folder / 'out.csv').open(newline='') as stream:
        return {int(row['stamp'].replace('.', '')): row for row in csv.DictReader(stream)}


def places(rows: dict[int, dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[axis] or 'nan') for axis in 'xyz'] for row in rows.values()])


def decoded(folder: Path, topic: str) -> list[Any]:
    """The messages of a topic in what `process` wrote."""
    with BagReader(folder / 'out.mcap') as reader:
        return [reader.decode(each) for each in reader.messages([f'/stereo/{topic}'])]


def words(folder: Path) -> list[str]:
    """What the target's health went through."""
    told = [each.message for each in decoded(folder, 'target/health')]
    return [word for word, before in zip(told, ['', *told], strict=False) if word != before]


def edited(bag: Path, folder: Path, topic: str, change: Callable[[bytes], Any]) -> Path:
    """The bag with the messages of a topic changed: `change` gives what to write, None nothing."""
    folder.mkdir()
    with BagReader(bag) as reader, BagWriter(folder / 'bag') as writer:
        for name, info in reader.topics.items():
            writer.add_topic(name, info.type, qos=tuple(info.qos))
        for record in reader.messages():
            data = change(record.data) if record.topic == topic else record.data
            if data is not None:
                writer.write(record.topic, record.stamp_ns, data)
    (folder / 'bag' / 'binopos.yaml').write_text((bag / 'binopos.yaml').read_text())
    return folder / 'bag'
