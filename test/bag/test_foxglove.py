"""Recordings, read by what Foxglove and Lichtblick read with: every field of every message."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from binopos_ros.bag import BagReader, BagWriter
from binopos_ros.bag.recording import RecorderOptions, Recording
from binopos_ros.cli import main

pytestmark = pytest.mark.xdist_group('foxglove')

HERE = Path(__file__).parent / 'foxglove'
#: Set by whom it matters to that this is tested, not skipped.
REQUIRED = os.environ.get('BINOPOS_FOXGLOVE') == 'required'


def unavailable(reason: str) -> None:
    if REQUIRED:
        pytest.fail(f'{reason}, and BINOPOS_FOXGLOVE says that it is required')
    pytest.skip(reason)


@pytest.fixture(scope='session')
def packages(project: Path) -> Path:
    """A folder with the packages of the npm registry in it, kept beside the tests' environment."""
    for tool in ('node', 'npm'):
        if shutil.which(tool) is None:
            unavailable(f'{tool} is not installed: it reads bags as Foxglove does')
    pins = (HERE / 'package.json').read_bytes()
    folder = project / '.venv' / f'foxglove-{hashlib.sha1(pins).hexdigest()[:8]}'
    if not (folder / 'ready').is_file():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'package.json').write_bytes(pins)
        words = ('npm', 'install', '--ignore-scripts', '--no-audit', '--no-fund', '--no-progress')
        try:
            done = subprocess.run(
                words, cwd=folder, capture_output=True, text=True, timeout=120, check=False
            )
            problem = done.stderr.strip().splitlines()[-1:] if done.returncode else []
        except subprocess.TimeoutExpired:
            problem = ['no answer within two minutes']
        if problem or not (folder / 'node_modules').is_dir():
            unavailable(f'the npm registry gives no packages to read with: {" ".join(problem)}')
        (folder / 'ready').touch()
    return folder


def read_by_foxglove(packages: Path, file: Path) -> list[list[Any]]:
    done = subprocess.run(
        ['node', str(HERE / 'read.mjs'), str(file)],
        cwd=packages,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def read_by_us(file: Path) -> list[list[Any]]:
    with BagReader(file) as reader:
        return [
            [
                record.topic,
                reader.topics[record.topic].type,
                str(record.stamp_ns),
                plain(reader.decode(record)),
            ]
            for record in reader.messages()
        ]


def plain(value: Any) -> Any:
    """A message as the other side prints it."""
    if isinstance(value, np.ndarray):
        if value.dtype == np.uint8:
            data = value.tobytes()
            return {'bytes': len(data), 'sha1': hashlib.sha1(data).hexdigest()}
        return value.tolist()
    if dataclasses.is_dataclass(value):
        # A type's name and its constants are not sent; they alone have a default.
        sent = [each for each in dataclasses.fields(value) if each.default is dataclasses.MISSING]
        return {field.name: plain(getattr(value, field.name)) for field in sent}
    return [plain(each) for each in value] if isinstance(value, list) else value


@pytest.fixture(scope='module')
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp('foxglove') / 'bag.mcap'
    assert main(['simulate', '-o', str(bag), '--preset', 'demo', '--pairs', '6']) == 0
    return bag


def test_it_reads_what_simulate_writes(packages: Path, simulated: Path) -> None:
    found = read_by_foxglove(packages, simulated)
    assert found == read_by_us(simulated)
    assert len(found) == 6 * 5


def test_it_reads_what_process_writes(packages: Path, simulated: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out.mcap'
    assert main(['process', str(simulated), '-o', str(out)]) == 0
    found = read_by_foxglove(packages, out)
    assert found == read_by_us(out)
    assert {topic.rpartition('/')[2] for topic, *_ in found} >= {'centroid', 'position', 'pose'}


@pytest.mark.parametrize('compression', ['none', 'zstd', 'lz4'])
def test_it_reads_what_the_recorder_writes(
    packages: Path, simulated: Path, tmp_path: Path, compression: str
) -> None:
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag'), compression=compression))
    with BagReader(simulated) as reader:
        for topic, info in reader.topics.items():
            recording.add_topic(topic, info.type)
        for number, record in enumerate(reader.messages()):
            recording.write(record.topic, record.stamp_ns, record.data)
            if number == 12:
                recording.split()
    recording.close()
    files = sorted((tmp_path / 'bag').glob('*.mcap'))
    assert len(files) == 2
    assert [each for file in files for each in read_by_foxglove(packages, file)] == read_by_us(
        simulated
    )


def test_it_reads_a_bag_of_a_recorder_that_was_killed(
    packages: Path, simulated: Path, tmp_path: Path
) -> None:
    writer = BagWriter(tmp_path / 'bag', crash_safe=True)
    with BagReader(simulated) as reader:
        for topic, info in reader.topics.items():
            writer.add_topic(topic, info.type)
        for record in reader.messages():
            writer.write(record.topic, record.stamp_ns, record.data)
    writer.flush()
    # Never closed: what is on the disk is all that a killed recorder leaves.
    (file,) = (tmp_path / 'bag').glob('*.mcap')
    assert read_by_foxglove(packages, file) == read_by_us(simulated)
