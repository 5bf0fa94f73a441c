"""Real dots behind glass in water, two cameras: OpenPTV's multiplane example.

`bench/triangulation/multiplane.py` prints the figures of the same fits.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

import multiplane_fits

WATER_AT_20_C = 1.333


@pytest.fixture(scope='module')
def multiplane() -> ModuleType:
    """The fits."""
    return multiplane_fits


@pytest.fixture(scope='module')
def folder(shared_data: Path) -> Path:
    return shared_data / 'openptv-multiplane'


@pytest.mark.parametrize(
    ('method', 'least', 'most'),
    [('refractive', 0.0, 0.71), ('paper', 0.0, 0.72), ('straight', 6.0, 6.2)],
)
def test_with_the_published_calibration(
    multiplane: ModuleType, folder: Path, method: str, least: float, most: float
) -> None:
    """3-D RMS over all 1620 dots, mm."""
    poses = [multiplane.published(folder, camera) for camera in (1, 2)]
    errors = multiplane.located(folder, poses, multiplane.PLANES, multiplane.Media(), method)
    assert len(errors) == 1620
    assert least <= multiplane.rms(errors) <= most


def test_a_refit_predicts_the_plane_it_has_not_seen(multiplane: ModuleType, folder: Path) -> None:
    """Fitted to planes 1, 2 and 4; a pinhole cannot do it with any pose and focal length."""
    unseen = {}
    for bent in (True, False):
        media = multiplane.Media(bent=bent)
        poses, _, _ = multiplane.refit(folder, (1, 2, 4), media)
        unseen[bent] = multiplane.rms(multiplane.located(folder, poses, (3,), media, 'refractive'))
    assert unseen[True] <= 0.60
    assert unseen[False] > 1.5


def test_the_index_left_free_is_waters_within_its_uncertainty(
    multiplane: ModuleType, folder: Path
) -> None:
    """Within the 95 % interval, which is narrow enough to tell water from air and glass.

    If every dot erred on its own it would be known ten times as well: an image errs as one.
    """
    found = multiplane.free_index(folder)
    assert abs(found.index - WATER_AT_20_C) <= found.interval < 0.05
    assert found.dots < 0.2 * found.images
