"""Layer stacks and rigs that the tests of this room share."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.optics import StereoRig
from layer_stacks import RIGS, STACKS


@pytest.fixture(params=STACKS)
def stack(request: pytest.FixtureRequest) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Indices and thicknesses of one stack after another."""
    return STACKS[request.param]


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest) -> StereoRig:
    """One rig after another."""
    return RIGS[request.param]


@pytest.fixture(params=[name for name in RIGS if name != 'air'])
def bent_rig(request: pytest.FixtureRequest) -> StereoRig:
    """One rig with surfaces after another."""
    return RIGS[request.param]


@pytest.fixture(params=[name for name in RIGS if name != 'air' and 'dome' not in name])
def flat_rig(request: pytest.FixtureRequest) -> StereoRig:
    """One rig with flat surfaces alone after another."""
    return RIGS[request.param]


@pytest.fixture
def crossed() -> StereoRig:
    """Ports before a wall that leans against them."""
    return RIGS['ports before a wall']


@pytest.fixture
def points() -> np.ndarray:
    """105 points (105, 3) beyond all surfaces and before both cameras, m."""
    return np.random.default_rng(3).uniform([-0.5, -0.4, 1.15], [0.6, 0.4, 2.5], (105, 3))
