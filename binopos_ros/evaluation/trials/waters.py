"""Waters that the default filter was not designed on: two cameras above a free surface.

The waves are traced by Fermat's principle (:mod:`binopos_ros.evaluation.trials.basin`), and the
pixels go through `Tracker`, whose rays' miss has to tell of the waves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from binopos_ros.evaluation.trials.basin import Basin
from binopos_ros.evaluation.trials.motions import Views
from binopos_ros.evaluation.trials.paths import draw_path
from binopos_ros.optics import StereoRig
from binopos_ros.simulation.waves import WaveSpectrum

_PIXEL_STD = 0.05
#: Of the water under the surface and above the target, and of the target's middle (m).
_DEPTH, _TARGET = 0.6, 0.32


class Water(NamedTuple):
    """A band of waves (Hz), the frequency of the highest, and the RMS of their slope."""

    lowest: float
    highest: float
    peak: float
    slope: float = 0.02


WATERS = {
    'calm': Water(1.6, 6.0, 2.5, 0.0),
    'basin': Water(1.6, 6.0, 2.5),
    'chop': Water(0.8, 1.2, 1.0),
    'swell': Water(0.15, 0.5, 0.3),
    'long chop': Water(0.3, 0.6, 0.45),
    'broadband': Water(0.2, 8.0, 1.5),
}


def draw_water(
    name: str, path: str, seed: int, frames: int = 300, rate: float = 30.0
) -> tuple[StereoRig, Views]:
    """Return a rig above one of WATERS, and what it sees of a target at `rate` (Hz); seeded.

    `path` is one of `paths.KINDS`, noise is 0.05 px.
    """
    random = np.random.default_rng([seed, list(WATERS).index(name)])
    water = WATERS[name]
    stamps = np.arange(frames) / rate
    basin = Basin(surface=random.uniform(0.6, 0.9), focal_length=random.uniform(850.0, 1010.0))
    middle = np.array([0.5 * basin.baseline, 0.0, basin.surface + _TARGET])
    truth = middle + draw_path(path, stamps, random).position
    spectrum = WaveSpectrum(1e-3, water.peak, water.lowest, water.highest, _DEPTH)
    waves = spectrum.realise(random)
    envelope = np.full(frames, water.slope / waves.rms_slope)
    left, right = basin.pixels(truth, stamps, waves, envelope)
    left = left + random.normal(0.0, _PIXEL_STD, left.shape)
    right = right + random.normal(0.0, _PIXEL_STD, right.shape)
    covariance = _PIXEL_STD**2 * np.eye(2)
    return basin.rig, Views(stamps, truth, left, right, covariance, np.zeros(frames, bool))
