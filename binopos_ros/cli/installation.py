"""Files that belong to the package but are no code: where this installation keeps them."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import binopos_ros

PROFILE = Path('config') / 'fastdds.xml'
DEMO_BAG = Path('bags') / 'demo'
UDEV_RULES = Path('config') / '99-binopos-cameras.rules'
SYSTEMD_UNIT = Path('config') / 'binopos.service'


class MissingFileError(RuntimeError):
    """A file that this installation lacks."""


def find(path: Path) -> Path | None:
    """A file or folder of this installation: of a source tree, of colcon or of pip.

    Args:
        path: as it is in the source tree.
    """
    package = Path(binopos_ros.__file__).resolve().parent
    prefixes = [
        Path(entry) for entry in os.environ.get('AMENT_PREFIX_PATH', '').split(':') if entry
    ]
    shares = [prefix / 'share' / 'binopos_ros' for prefix in (*prefixes, Path(sys.prefix))]
    # With `pip install --prefix` the packages lie three levels below it.
    shares += [parent / 'share' / 'binopos_ros' for parent in list(package.parents)[3:4]]
    places = (folder / path for folder in (package.parent, *shares))
    return next((each for each in places if each.exists()), None)


def needed(path: Path) -> Path:
    """As `find`, where it cannot be done without.

    Raises:
        MissingFileError: it is not there.
    """
    place = find(path)
    if place is None:
        msg = f'this installation has no {path}: install the package anew, or take a source tree'
        raise MissingFileError(msg)
    return place
