"""The paper's experiments of Sec. 5.2 to 5.4, with the simulator's physics.

The washbowl preset: two cameras with the paper's lenses 230 mm apart, the surface 0.8 m away and
3.8 degrees askew, 0.49 m of water. Where the target appears is traced through the true medium,
pixel noise is added, and the positions are those of the suite's own triangulation with what it is
told of the medium.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.settings import Settings
from binopos_ros.evaluation.trials.basin import Basin
from binopos_ros.evaluation.trials.paths import Path
from binopos_ros.evaluation.trials.sequences import Sequence
from binopos_ros.optics import FlatInterface, StereoRig
from binopos_ros.optics.column import mean_index
from binopos_ros.simulation import Choices, Scene, WaveSpectrum, washbowl
from binopos_ros.simulation.backdrop import Basin as Bowl
from binopos_ros.simulation.presets import FRESH_WATER
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.index import IndexEstimator

Array = NDArray[np.float64]

METHODS = ('refractive', 'paper', 'straight')

#: The paper's range of indices ends at solid salt; saturated brine has 1.38.
SALTIEST = 1.38
LAYERS = 20
#: Time between two experiments, in which the target is moved and salt added, s.
PAUSE = 60.0
#: The estimator lets the index move between two experiments by so many of their mean steps.
STEPS = 3.0
#: Height of the waves, m: from a breath on the water to a basin that is pushed.
CALMEST, ROUGHEST = 2e-4, 8e-4
TRANSFORMING, SALTED, WAVY = range(3)


class Salted(NamedTuple):
    """Experiments in water with a salt gradient; E of them.

    Attributes:
        truth: (E,) mean index of the water column.
        estimate: (E,) index estimated at the end of each experiment.
        index_std: (E,) its stated standard deviation.
        observed: (E,) whether the estimate says that it was observed.
        errors: knowledge of the index -> (E, 3) error of the mean position, m.
        single: knowledge of the index -> (E, 3) error of the first pair's position, m.
    """

    truth: Array
    estimate: Array
    index_std: Array
    observed: Array
    errors: dict[str, Array]
    single: dict[str, Array]


def transforming(settings: Settings, number: int) -> dict[str, Array]:
    """One experiment of Sec. 5.2: method -> (frames, 3) errors in m at one place on the floor."""
    random = np.random.default_rng([settings.seed, TRANSFORMING, number])
    scene = washbowl(Choices())
    target = _place(scene, random)
    left, right = _measure(scene, target, settings, random)
    covariance = settings.pixel_std**2 * np.eye(2)
    return {
        method: triangulate(scene.rig, left, right, covariance, covariance, method).points - target
        for method in METHODS
    }


def salted(settings: Settings, tick: Callable[[], None]) -> Salted:
    """The experiments of Sec. 5.3: salt is added from one to the next, and never stirred.

    The index is accumulated over the frames, and kept from experiment to experiment; `tick` is
    called after each of them.
    """
    random = np.random.default_rng([settings.seed, SALTED])
    means = np.sort(random.uniform(FRESH_WATER, SALTIEST, settings.experiments))
    scene = washbowl(Choices())
    covariance = settings.pixel_std**2 * np.eye(2)
    middle = (FRESH_WATER + SALTIEST) / 2
    span = SALTIEST - FRESH_WATER
    drift = STEPS * span / settings.experiments / np.sqrt(PAUSE)
    estimator = IndexEstimator(middle, span / np.sqrt(12), drift=drift)
    prior_rig = _with_index(scene.rig, middle)
    kinds = ('true mean', 'estimated', f'{FRESH_WATER} assumed')
    errors: dict[str, list[Array]] = {kind: [] for kind in kinds}
    single: dict[str, list[Array]] = {kind: [] for kind in kinds}
    truth, found = [], []
    for number, wanted in enumerate(means):
        rig, mean = _gradient(scene, float(wanted), random)
        medium = washbowl_with(scene, rig)
        target = _place(scene, random)
        left, right = _measure(medium, target, settings, random)
        for frame in range(settings.frames):
            stamp = PAUSE * number + frame / scene.rate
            state = estimator.update(
                prior_rig, left[frame], right[frame], covariance, covariance, stamp
            )
        truth.append(mean)
        found.append((state.mean, state.std, state.observed))
        for kind, index in zip(kinds, (mean, state.mean, FRESH_WATER), strict=True):
            points = triangulate(_with_index(scene.rig, index), left, right).points
            errors[kind].append(points.mean(axis=0) - target)
            single[kind].append(points[0] - target)
        tick()
    index, index_std, observed = np.array(found, float).T
    return Salted(
        np.array(truth),
        index,
        index_std,
        observed,
        {kind: np.array(values) for kind, values in errors.items()},
        {kind: np.array(values) for kind, values in single.items()},
    )


def wavy(settings: Settings, number: int) -> Sequence:
    """One experiment of Sec. 5.4: a still target under waves, as the triangulator sees it."""
    random = np.random.default_rng([settings.seed, WAVY, number])
    scene = washbowl(Choices())
    height = float(np.exp(random.uniform(np.log(CALMEST), np.log(ROUGHEST))))
    spectrum = WaveSpectrum(height, peak=random.uniform(1.8, 3.2), depth=0.49)
    rough = Scene(
        rig=scene.rig,
        water=scene.water,
        backdrop=scene.backdrop,
        path=scene.path,
        waves=spectrum.realise(random),
    )
    target = _place(scene, random)
    left, right = _measure(rough, target, settings, random)
    covariance = settings.pixel_std**2 * np.eye(2)
    found = triangulate(scene.rig, left, right, covariance, covariance)
    frames = settings.frames
    still = np.zeros((frames, 3))
    return Sequence(
        kind='still',
        stamps=scene.times(frames),
        path=Path(np.tile(target, (frames, 1)), still, still),
        positions=found.points,
        covariances=found.covariances,
        media=np.zeros((frames, 3, 3)),
        wrong=np.zeros(frames, bool),
        basin=Basin(surface=0.8, baseline=0.23, focal_length=900.0, index=FRESH_WATER),
        spectrum=spectrum,
        envelope=np.ones(frames),
        pixel_std=settings.pixel_std,
    )


def washbowl_with(scene: Scene, rig: StereoRig) -> Scene:
    """The scene with another medium before its cameras."""
    return Scene(rig=rig, water=scene.water, backdrop=scene.backdrop, path=scene.path)


def _place(scene: Scene, random: np.random.Generator) -> Array:
    """A place on the bowl's floor, (3,) m."""
    bowl = scene.backdrop
    assert isinstance(bowl, Bowl)
    first, second = bowl.surface.axes()
    radius, angle = 0.22 * np.sqrt(random.random()), random.uniform(0, 2 * np.pi)
    place = bowl.centre + radius * np.array([np.cos(angle), np.sin(angle)])
    deep = bowl.surface.distance + bowl.depth - 0.002
    return place[0] * first + place[1] * second + deep * bowl.surface.normal


def _measure(
    scene: Scene, target: Array, settings: Settings, random: np.random.Generator
) -> tuple[Array, Array]:
    """Noisy pixels, (frames, 2) in each picture, of a still target."""
    times = scene.times(settings.frames)
    exact = scene.measurements(times, np.tile(target, (settings.frames, 1)))
    noise = settings.pixel_std * random.standard_normal((2, settings.frames, 2))
    return exact[0] + noise[0], exact[1] + noise[1]


def _gradient(scene: Scene, mean: float, random: np.random.Generator) -> tuple[StereoRig, float]:
    """The rig over layers that get saltier downwards, and their mean index."""
    surface = scene.rig.interface
    bowl = scene.backdrop
    assert surface is not None
    assert isinstance(bowl, Bowl)
    depth = (np.arange(LAYERS) + 0.5) / LAYERS
    shape = np.exp((depth - 1) / random.uniform(0.1, 1.0))
    shape -= shape.mean()
    steepest = min((SALTIEST - mean) / shape.max(), (FRESH_WATER - mean) / shape.min())
    indices = mean + random.uniform(0, steepest) * shape
    # The target is in the last layer, 2 mm above the floor.
    thicknesses = np.full(LAYERS, bowl.depth / LAYERS)
    layered = FlatInterface(surface.normal, surface.distance, (1.0, *indices), thicknesses[:-1])
    rig = StereoRig(
        scene.rig.left, scene.rig.right, scene.rig.rotation, scene.rig.translation, layered
    )
    thicknesses[-1] -= 0.002
    return rig, mean_index(indices.tolist(), thicknesses.tolist())


def _with_index(rig: StereoRig, index: float) -> StereoRig:
    """The rig over homogeneous water."""
    assert rig.interface is not None
    surface = FlatInterface(rig.interface.normal, rig.interface.distance, (1.0, index))
    return StereoRig(rig.left, rig.right, rig.rotation, rig.translation, surface)
