"""Sequences of measured positions with known truth, seeded: the trials' raw material."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.basin import Basin
from binopos_ros.evaluation.trials.paths import KINDS, Path, draw_path
from binopos_ros.simulation.waves import WaveSpectrum

Array = NDArray[np.float64]

FRAME_RATE = 30.0
#: Seeds of the training sequences start here, those of the tests there: they never meet.
TRAINING_SEED = 1_000_000
TEST_SEED = 2_000_000


@dataclasses.dataclass(frozen=True)
class Sequence:
    """One trial.

    Attributes
    ----------
    kind : str
        Of the target's path.
    stamps : (n,) array
        Of all frames (s), those without a position too.
    path : Path
        Truth at the stamps, rig frame.
    positions : (n, 3) array
        Measured (m); nan where the frame gave none.
    covariances : (n, 3, 3) array
        What the triangulator says of them (m^2): pixel noise, no waves.
    media : (n, 3, 3) array
        What the miss of the two rays says of the waves (m^2), of those that swing to and fro.
    wrong : (n,) array of bool
        Where the detector took another thing for the target.
    basin : Basin
        The scene.
    spectrum : WaveSpectrum
        Of the waves at envelope 1.
    envelope : (n,) array
        Factor on the waves' height over time.
    pixel_std : float
        Noise of the centroids (px).

    """

    kind: str
    stamps: Array
    path: Path
    positions: Array
    covariances: Array
    media: Array
    wrong: NDArray[np.bool_]
    basin: Basin
    spectrum: WaveSpectrum
    envelope: Array
    pixel_std: float

    @property
    def truth(self) -> Array:
        """True positions (n, 3), m."""
        return self.path.position


def paper_sequence(seed: int) -> Sequence:
    """Return an experiment of the paper's Sec. 5.4: a still target under waves, 100 frames.

    The washbowl: surface at 0.8 m, the target 0.49 m under it, pixel noise of 0.05 px; the waves'
    height and peak differ from one experiment to the next.
    """
    random = np.random.default_rng(seed)
    frames = 100
    stamps = np.arange(frames) / FRAME_RATE
    spectrum = _draw_spectrum(random, 2e-4, 8e-4)
    target = np.array([0.115, 0.0, 1.29]) + random.uniform(-1, 1, 3) * [0.15, 0.1, 0.0]
    path = Path(np.tile(target, (frames, 1)), np.zeros((frames, 3)), np.zeros((frames, 3)))
    return _measure('still', Basin(), path, stamps, spectrum, np.ones(frames), 0.05, 0.0, random)


def mixed_sequence(seed: int, frames: int = 300) -> Sequence:
    """Return one sequence of the mixed protocol; the kinds of path follow each other by seed.

    Calm to rough (steady, rising or falling), pixel noise of 0.03 to 0.15 px, 0 to 5 % wrong
    detections, stamps that jitter by 1 ms, single frames missing and, in half of the sequences,
    gaps of up to 0.7 s.
    """
    random = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    stamps = np.arange(frames) / FRAME_RATE + random.normal(0.0, 1e-3, frames)
    basin = Basin(surface=random.uniform(0.5, 1.0), focal_length=random.uniform(800.0, 1000.0))
    path = draw_path(kind, stamps, random)
    middle = np.array([0.115, 0.0, basin.surface + random.uniform(0.25, 0.45)])
    path = path._replace(position=path.position + middle)
    spectrum = _draw_spectrum(random, 1e-4, 1.5e-3)
    envelope = _draw_envelope(stamps, random)
    sequence = _measure(
        kind,
        basin,
        path,
        stamps,
        spectrum,
        envelope,
        random.uniform(0.03, 0.15),
        random.uniform(0.0, 0.05),
        random,
    )
    missing = random.random(frames) < random.uniform(0.0, 0.05)
    if random.random() < 0.5:
        for start in random.integers(30, frames - 30, random.integers(1, 4)):
            missing[start : start + random.integers(6, 22)] = True
    missing[0] = False
    sequence.positions[missing] = np.nan
    return sequence


@functools.lru_cache(maxsize=8)
def training_set(count: int = 60) -> tuple[Sequence, ...]:
    """Return the sequences that every filter is tuned on."""
    return tuple(mixed_sequence(TRAINING_SEED + number) for number in range(count))


@functools.lru_cache(maxsize=8)
def unseen_set(count: int = 200) -> tuple[Sequence, ...]:
    """Return the unseen sequences of the mixed protocol."""
    return tuple(mixed_sequence(TEST_SEED + number) for number in range(count))


@functools.lru_cache(maxsize=8)
def paper_set(count: int = 100, first: int = TEST_SEED) -> tuple[Sequence, ...]:
    """Return the experiments of the paper's protocol."""
    return tuple(paper_sequence(first + number) for number in range(count))


def _draw_spectrum(random: np.random.Generator, calm: float, rough: float) -> WaveSpectrum:
    return WaveSpectrum(
        rms_height=float(np.exp(random.uniform(np.log(calm), np.log(rough)))),
        peak=random.uniform(1.8, 3.2),
        depth=0.6,
    )


def _draw_envelope(stamps: Array, random: np.random.Generator) -> Array:
    """Return the waves' relative height over time: steady, or a change by up to 5 times."""
    if random.random() < 0.4:
        return np.ones(stamps.size)
    middle, width = random.uniform(2.0, 8.0), random.uniform(0.5, 2.0)
    share = 1.0 / (1.0 + np.exp(-(stamps - middle) / (0.25 * width)))
    low = random.uniform(0.2, 0.6)
    return low + (1.0 - low) * (share if random.random() < 0.5 else 1.0 - share)


def _measure(
    kind: str,
    basin: Basin,
    path: Path,
    stamps: Array,
    spectrum: WaveSpectrum,
    envelope: Array,
    pixel_std: float,
    wrong_share: float,
    random: np.random.Generator,
) -> Sequence:
    count = stamps.size
    left, right = basin.pixels(path.position, stamps, spectrum.realise(random), envelope)
    wrong = random.random(count) < wrong_share
    wrong[0] = False
    # Half of the wrong detections are another thing in both images, such as a reflection; the
    # others are wrong in one image, along the epipolar line, where no residual gives them away.
    both = random.random(count) < 0.5
    shift = random.uniform(-1.0, 1.0, (count, 2)) * np.array([150.0, 100.0])
    one_sided = np.column_stack([random.uniform(5.0, 40.0, count), np.zeros(count)])
    one_sided *= random.choice([-1.0, 1.0], (count, 1))
    left = left + np.where((wrong & both)[:, None], shift, 0.0)
    right = right + np.where((wrong & both)[:, None], shift, 0.0)
    right = right + np.where((wrong & ~both)[:, None], one_sided, 0.0)
    left = left + random.normal(0.0, pixel_std, (count, 2))
    right = right + random.normal(0.0, pixel_std, (count, 2))
    positions = basin.triangulate(left, right)
    covariances = basin.covariance(left, right, pixel_std)
    return Sequence(
        kind,
        stamps,
        path,
        positions,
        covariances,
        basin.media(stamps, left, right, positions, covariances, pixel_std),
        wrong,
        basin,
        spectrum,
        envelope,
        pixel_std,
    )
