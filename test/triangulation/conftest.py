"""Rigs and points that the tests of this room share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from binopos_ros.optics import StereoRig
from every_rig import RIGS, inverse_information


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest) -> StereoRig:
    """One rig after another."""
    return RIGS[request.param]


@pytest.fixture
def washbowl() -> StereoRig:
    """The paper's rig: 230 mm apart, 0.8 m above calm water."""
    return RIGS['washbowl']


@pytest.fixture
def scatter() -> Callable[[int], np.ndarray]:
    """Points (N, 3) beyond every rig's surfaces, m."""
    return lambda count: np.random.default_rng(7).uniform(
        [-0.25, -0.25, 1.0], [0.4, 0.25, 1.6], (count, 3)
    )


@pytest.fixture
def bound() -> Callable[..., np.ndarray]:
    """The Cramer-Rao bound as a function."""
    return inverse_information
