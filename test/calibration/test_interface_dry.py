"""Interfaces that end in air: plates, dry windows, a tank that is seen through."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.report.verdicts import (
    IRRELEVANT,
    verdicts,
)
from binopos_ros.optics import FlatInterface
from binopos_ros.optics.rig_state import RigState
from binopos_ros.triangulation import triangulate

TILTS = (15.0, 55.0)
EVERYWHERE = (0.6, 0.5)  # parts of the depth: as far aside as both pictures reach


@pytest.mark.parametrize('measured', [False, True])
@pytest.mark.parametrize(
    ('indices', 'thicknesses'),
    [
        ((1.0, 1.49, 1.0), (0.012,)),
        ((1.0, 1.49, 1.333, 1.49, 1.0), (0.01, 0.3, 0.01)),
        ((1.333, 1.49, 1.0), (0.01,)),
    ],
)
def test_what_ends_in_air_is_calibrated(
    board_viewer: Any,
    dry_rig: Any,
    indices: tuple[float, ...],
    thicknesses: tuple[float, ...],
    measured: bool,
) -> None:
    rng = np.random.default_rng(3)
    media = FlatInterface([0.05, -0.04, 1.0], 0.3, indices, thicknesses)
    rig, reach = dry_rig(media), 0.3 + sum(thicknesses)
    views = board_viewer(rig, (reach + 0.2, reach + 0.6), rng, 8, 0.1, TILTS, EVERYWHERE)
    ruler: dict[str, Any] = {'distance': 0.3, 'deviations': {'distance': 0.001}}
    guess = InterfaceGuess('interface', indices, thicknesses, **(ruler if measured else {}))
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, [guess])
    assert result.dropped == ()
    assert result.adjustment is not None
    assert result.adjustment.sigma == pytest.approx(0.1, rel=0.05)
    found = result.state.interfaces['interface']
    assert found.indices[-1] == 1.0
    by_name = {verdict.name: verdict for verdict in verdicts(result)}
    assert 'target_index' not in by_name
    angle = np.arccos(min(1.0, float(found.normal @ media.normal)))
    assert angle < 4.0 * result.deviation('interface.normal.0')
    if len(indices) == 3 and indices[0] == 1.0:
        assert 'only shifts the rays' in by_name['interface.normal.0'].text
    else:
        assert angle < np.radians(0.1)
    distance = by_name['interface.distance']
    if indices[0] == 1.0:
        assert distance.grade == IRRELEVANT
        assert 'does not matter' in distance.text
    else:
        assert distance.value == pytest.approx(0.3, abs=0.004)
    seen = rig.project(np.array([[0.1, 0.05, reach + 0.3]]))
    where = triangulate(result.state.rig(), *seen).points[0]
    np.testing.assert_allclose(where, [0.1, 0.05, reach + 0.3], atol=1e-3)


@pytest.mark.parametrize('seed', [3, 4, 5])
def test_an_index_known_to_be_about_one_ends_at_one_or_above(
    board_viewer: Any, dry_rig: Any, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    rig = dry_rig(FlatInterface([0.05, -0.04, 1.0], 0.3, (1.333, 1.49, 1.0), (0.01,)))
    views = board_viewer(rig, (0.5, 0.9), rng, 8, 0.1, TILTS, EVERYWHERE)
    guess = InterfaceGuess(
        'interface', (1.333, 1.49, 1.0), (0.01,), deviations={'target_index': 0.001}
    )
    result = calibrate_interface(replace(RigState.of(rig), interfaces={}), views, [guess])
    index = verdicts(result)[0]
    assert 1.0 <= index.value < 1.0 + 4.0 * index.deviation
    assert 0.0 < index.deviation < 0.001
