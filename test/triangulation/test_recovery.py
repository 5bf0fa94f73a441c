"""After any fault the stage is itself again: good positions at once, the index where it says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from binopos_ros.optics import CameraInfo, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Position, Triangulator

PERIOD = 33_333_333
NOISE = 0.05  # px
TRUTH, PRIOR = 1.345, 1.333
BASELINE, FOCAL = 0.23, 900.0
NORMAL, DISTANCE = [0.05, 0.02, 1.0], 0.8
K = (FOCAL, 0, 640.0, 0, FOCAL, 480.0, 0, 0, 1.0)
CAMERA = PinholeCamera(np.reshape(K, (3, 3)), np.zeros(5), (1280, 960))
WATER = StereoRig(
    CAMERA, CAMERA, np.eye(3), [-BASELINE, 0, 0], FlatInterface(NORMAL, DISTANCE, (1.0, TRUTH))
)


def stage(**values: float) -> Triangulator:
    """The stage with both calibrations, its index about the truth."""
    parameters = {
        'interface.normal': NORMAL,
        'interface.distance': DISTANCE,
        'interface.indices': [1.0, PRIOR],
        'interface.normal_std': 0.0,
        'interface.distance_std': 0.0,
        'baseline_std': 0.0,
        'index.std': 0.02,
        **values,
    }
    triangulator = Triangulator(build(TriangulatorOptions, parameters))
    for side, shift in (('left', 0.0), ('right', -BASELINE * FOCAL)):
        p = (FOCAL, 0, 640.0, shift, 0, FOCAL, 480.0, 0, 0, 0, 1.0, 0)
        info = CameraInfo(side, 1280, 960, 'plumb_bob', (0.0,) * 5, K, p=p)
        triangulator.set_camera(side, info)
    return triangulator


def place(k: int) -> np.ndarray:
    """The target at pair k: about 0.3 m/s."""
    return np.array(
        [
            0.35 + 0.15 * np.sin(0.05 * k),
            0.1 + 0.1 * np.cos(0.07 * k),
            1.2 + 0.05 * np.sin(0.03 * k),
        ]
    )


class Fault:
    """What becomes of the two pixels of a pair while a fault lasts."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)

    def spoil(self, kind: str, k: int, left: np.ndarray, right: np.ndarray) -> tuple:
        random = self.random
        if kind == 'nan':
            return left, np.array([np.nan, 1.0])
        if kind == 'sides swapped':
            return right, left
        if kind == 'another instant':
            return left, WATER.project(place(k - 8))[1]
        if kind == 'anything':
            return random.uniform((0, 0), (1280, 960), (2, 2))
        if kind == 'far outside':
            return left, 1e7 * right
        if kind == 'noisy rows':
            return left, right + random.normal(0, 8, 2)
        if kind == 'rows apart':
            return left, right + np.array([0.0, 4.0])
        if kind == 'rows a little apart':
            return left, right + np.array([0.0, 1.0])
        return left + random.normal(0, 100, 2), right + random.normal(0, 100, 2)


KINDS = [
    'nan',
    'sides swapped',
    'another instant',
    'anything',
    'far outside',
    'noisy rows',
    'rows apart',
    'rows a little apart',
    'jumps',
]


def feed(triangulator: Triangulator, k: int, pixels: tuple) -> list:
    """What the stage makes of pair k."""
    return [
        result
        for side, pixel in zip(('left', 'right'), pixels, strict=True)
        for result in triangulator.add(
            side, Centroid(10**18 + k * PERIOD, side, pixel, NOISE**2 * np.eye(2), 40.0)
        )
    ]


def score(found: Position, k: int) -> float:
    """Normalised squared error of a position."""
    miss = found.point - place(k)
    return float(miss @ np.linalg.solve(found.covariance, miss))


faults = st.lists(
    st.tuples(st.sampled_from(KINDS), st.integers(1, 60)), min_size=1, max_size=6
).map(tuple)


@settings(max_examples=15, deadline=None, derandomize=True)
@example(before=30, sequence=tuple((kind, 40) for kind in KINDS), seed=1, gate=10.0, bias=0.1)
@example(before=200, sequence=(('rows a little apart', 300),), seed=2, gate=10.0, bias=0.0)
@example(before=200, sequence=(('another instant', 300),), seed=3, gate=0.0, bias=0.0)
@example(before=200, sequence=(('noisy rows', 600),), seed=4, gate=0.0, bias=0.0)
@given(
    before=st.integers(0, 60),
    sequence=faults,
    seed=st.integers(0, 2**16),
    gate=st.sampled_from([0.0, 10.0]),
    bias=st.sampled_from([0.0, 0.1]),
)
def test_after_any_fault_positions_are_good_again(before, sequence, seed, gate, bias) -> None:
    """Every pair gives a position; each is as good as it says once the stage has settled."""
    triangulator = stage(epipolar_gate=gate, **{'index.calibration_std': bias})
    fault = Fault(seed)
    random = np.random.default_rng(seed + 1)
    kinds = [''] * before + [kind for kind, count in sequence for _ in range(count)]
    good = 60
    for k, kind in enumerate(kinds + [''] * good):
        pixels = tuple(pixel + random.normal(0, NOISE, 2) for pixel in WATER.project(place(k)))
        results = feed(triangulator, k, fault.spoil(kind, k, *pixels) if kind else pixels)
        for found in results:
            if isinstance(found, Position):
                assert np.isfinite(found.point).all()
                assert np.linalg.eigvalsh(found.covariance).min() > 0
        since = k - len(kinds)
        if since < 0:
            continue
        (found,) = results
        assert isinstance(found, Position)
        assert np.linalg.norm(found.point - place(k)) < 0.03
        if since >= 20:
            assert score(found, k) < 30
            assert abs(found.index.mean - TRUTH) < 4 * found.index.std


@pytest.mark.parametrize('kind', KINDS)
def test_a_short_fault_does_not_cost_what_is_known_of_the_index(kind: str) -> None:
    """A fault of a third of a second after twenty of them: the index is as sure as before."""
    triangulator, fault = stage(**{'index.calibration_std': 0.0}), Fault(5)
    random = np.random.default_rng(6)
    known = {}
    for k in range(640):
        pixels = tuple(pixel + random.normal(0, NOISE, 2) for pixel in WATER.project(place(k)))
        if 600 <= k < 610:
            pixels = fault.spoil(kind, k, *pixels)
        for found in feed(triangulator, k, pixels):
            if isinstance(found, Position):
                known[k] = found.index
    assert known[599].observed
    assert known[639].std < 1.5 * known[599].std
    assert abs(known[639].mean - TRUTH) < 4 * known[639].std
