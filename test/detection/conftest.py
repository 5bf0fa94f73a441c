"""Fixtures of the detector's tests: a renderer of its own, and real pictures."""

from __future__ import annotations

import csv
from pathlib import Path
from types import ModuleType
from typing import NamedTuple
from xml.etree import ElementTree

import pytest

import rendered as independent_renderer


@pytest.fixture(scope='session')
def rendered() -> ModuleType:
    """The independent renderer."""
    return independent_renderer


SIDES_OF_A_BOX = ('xmin', 'ymin', 'xmax', 'ymax')


class Buoy(NamedTuple):
    """A real picture: its JPEG, the box around the buoy or None, and the hundred it lies in."""

    name: str
    jpeg: bytes
    box: tuple[int, int, int, int] | None
    hundred: int


@pytest.fixture(scope='session')
def buoys(shared_data: Path) -> list[Buoy]:
    folder = shared_data / 'robosub-red-buoy'
    if not folder.is_dir():
        pytest.skip(f'{folder} is not there: the real pictures are not in this checkout')
    with (folder / 'index.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    return [
        Buoy(
            row['image'],
            (folder / 'Images' / f'{row["image"]}.jpg').read_bytes(),
            tuple(int(row[key]) for key in ('xmin', 'ymin', 'xmax', 'ymax'))  # type: ignore
            if row['xmin']
            else None,
            int(row['image']) // 100 * 100,
        )
        for row in rows
    ]


Box = tuple[int, int, int, int]


@pytest.fixture(scope='session')
def decoys(shared_data: Path) -> list[tuple[int, bytes, list[Box]]]:
    """Pictures in which something else looks red: number, JPEG, boxes about red buoys."""
    folder = shared_data / 'robosub-decoys'
    if not folder.is_dir():
        pytest.skip(f'{folder} is not there: the pictures of decoys are not in this checkout')
    return [
        (int(path.stem), path.read_bytes(), _boxes(folder / 'Annotations' / f'{path.stem}.xml'))
        for path in sorted((folder / 'Images').glob('*.jpg'))
    ]


def _boxes(path: Path) -> list[Box]:
    if not path.is_file():
        return []
    found = ElementTree.parse(path).getroot().iter('object')
    return [
        tuple(int(float(each.findtext(f'bndbox/{side}', ''))) for side in SIDES_OF_A_BOX)  # type: ignore
        for each in found
        if each.findtext('name') == 'buoy_red'
    ]
