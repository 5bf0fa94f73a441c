"""Motions that the default filter was not designed on, seen by a rig behind two ports.

A trial is what two cameras saw: pixels with noise, of a target or of another thing, and the
covariance that the detector states. It goes through the real triangulation and the real filter:
one by one through `Tracker`, or many at once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from collections.abc import Sequence as Series
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.score import Track
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.tracker import Tracker
from binopos_ros.triangulation import triangulate

Array = NDArray[np.float64]
Motion = Callable[[Array, Array, np.random.Generator], Array]

#: Seconds at the start that no score counts.
SETTLING = 1.0
#: 95 % of the squared errors of three honest dimensions lie below (chi-squared).
INSIDE = 7.8147
#: A motion that leaves the pictures is shrunk by so much until it does not.
_SHRINK = 0.8


@dataclasses.dataclass(frozen=True)
class Conditions:
    """What a motion is seen under.

    Attributes
    ----------
    rate : float
        Frames per second (Hz).
    pixel_std : float
        Noise of the centres (px).
    distance : float
        Of the target (m).
    frames : int
        Length of the trial.
    likeness : float
        Correlation of the noise of one frame with that of the next, from 0 to 1.
    wrong_share : float
        Share of the frames in which another thing is taken for the target.
    burst : int
        Frames in a row in which it is.
    detected_share : float
        Share of the frames that give a pair at all.
    stated : float
        Factor on the pixels' variance that the detector states; 1: honest.

    """

    rate: float = 30.0
    pixel_std: float = 0.1
    distance: float = 1.0
    frames: int = 300
    likeness: float = 0.0
    wrong_share: float = 0.0
    burst: int = 5
    detected_share: float = 1.0
    stated: float = 1.0


@dataclasses.dataclass(frozen=True)
class Views:
    """What two cameras saw of a target in n frames.

    Attributes
    ----------
    stamps : (n,) array
        Of the frames (s).
    truth : (n, 3) array
        True positions in the rig frame (m).
    left, right : (n, 2) array
        Centres (px); nan where there was no pair.
    covariance : (2, 2) array
        That is stated of each centre (px^2).
    wrong : (n,) array of bool
        Where another thing was taken for the target.

    """

    stamps: Array
    truth: Array
    left: Array
    right: Array
    covariance: Array
    wrong: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class Measured:
    """Triangulated views: `positions` (n, 3) m, nan where there is none, and `covariances`.

    No medium waves behind ports, so `media` is None.
    """

    stamps: Array
    truth: Array
    positions: Array
    covariances: Array
    media: None = None


class Score(NamedTuple):
    """What a filter made of a trial, the first second left out.

    Attributes
    ----------
    raw, pose : float
        RMS errors (m) of the target's own positions, and of the poses where the frame gave a
        position, right or wrong.
    normalised : float
        Mean squared error of the poses by their own covariance, per dimension: 1 if honest.
    inside : float
        Share of the poses' errors that lie inside their 95 % region.

    """

    raw: float
    pose: float
    normalised: float
    inside: float

    @property
    def ratio(self) -> float:
        """The poses' RMS error, in the positions'."""
        return self.pose / self.raw


def ports_rig() -> StereoRig:
    """Return two parallel cameras, 0.12 m apart, each behind 10 mm of glass under water."""
    camera = PinholeCamera(
        [[800.0, 0.0, 640.0], [0.0, 800.0, 480.0], [0.0, 0.0, 1.0]], np.zeros(4), (1280, 960)
    )
    port = FlatInterface([0.0, 0.0, 1.0], 0.035, [1.0, 1.517, 1.335], [0.010])
    return StereoRig(camera, camera, np.eye(3), [-0.12, 0.0, 0.0], left_port=port, right_port=port)


def surface_rig(distance: float) -> StereoRig:
    """Return the same cameras, water from half of `distance` (m) on, 10 degrees askew."""
    camera = ports_rig().left
    slant = np.deg2rad(10.0)
    water = FlatInterface([0.0, np.sin(slant), np.cos(slant)], 0.5 * distance, [1.0, 1.333])
    return StereoRig(camera, camera, np.eye(3), [-0.12, 0.0, 0.0], water)


def draw_motion(kind: str, times: Array, place: Array, random: np.random.Generator) -> Array:
    """Return positions (n, 3), m, of a target about `place` (3,), m, at `times` (n,), s.

    `kind` is one of MOTIONS. The rig is at the origin of the frame.
    """
    return place + MOTIONS[kind](times, place, random)


def draw_views(kind: str, rig: StereoRig, conditions: Conditions, seed: int) -> Views:
    """Return what `rig` sees of a motion of that kind (one of MOTIONS); seeded."""
    random = np.random.default_rng([seed, list(MOTIONS).index(kind)])
    count = conditions.frames
    stamps = np.arange(count) / conditions.rate
    middle = 0.5 * (-rig.rotation.T @ rig.translation)
    place = middle + np.array([0.0, 0.0, conditions.distance])
    truth = draw_motion(kind, stamps, place, random)
    while not _in_view(rig, truth):
        truth = place + _SHRINK * (truth - place)
    wrong = _bursts(conditions, random)
    sideways = random.uniform(-0.2, 0.2, 3) * np.array([1.0, 1.0, 0.5])
    seen = np.where(wrong[:, None], place + conditions.distance * sideways, truth)
    noise = conditions.pixel_std * _noise(count, conditions.likeness, random)
    left, right = rig.project(seen)
    left, right = left + noise[:, :2], right + noise[:, 2:]
    lost = random.random(count) >= conditions.detected_share
    lost[0] = False
    left[lost] = right[lost] = np.nan
    covariance = conditions.stated * conditions.pixel_std**2 * np.eye(2)
    return Views(stamps, truth, left, right, covariance, wrong)


def track(rig: StereoRig, views: Views, **options: Any) -> tuple[Measured, Track]:
    """Return what `Tracker` makes of views, one after the other; `options` are the tracker's.

    Where it has no pose, errors are nan. The covariances are those of the poses, with the parts
    that no filter averages away.
    """
    tracker = Tracker(rig, **options)
    count = views.stamps.size
    points, spreads = np.full((2, count, 3), np.nan), np.full((2, count, 3, 3), np.nan)
    for number, stamp in enumerate(views.stamps.tolist()):
        if not np.isfinite(views.left[number, 0]):
            continue
        tracked = tracker.step(
            stamp, views.left[number], views.right[number], views.covariance, views.covariance
        )
        points[0, number], spreads[0, number] = tracked.position, tracked.covariance
        if tracked.pose is not None:
            points[1, number] = tracked.pose.position
            spreads[1, number] = tracked.pose.covariance[:3, :3]
    measured = Measured(views.stamps, views.truth, points[0], spreads[0])
    return measured, Track(points[1] - views.truth, spreads[1], 0.0)


def measure(rig: StereoRig, trials: Series[Views]) -> list[Measured]:
    """Triangulate many views (of n frames each) at once, as `Tracker` does one by one."""
    left = np.concatenate([views.left for views in trials])
    right = np.concatenate([views.right for views in trials])
    covariances = np.concatenate(
        [np.tile(views.covariance, (views.stamps.size, 1, 1)) for views in trials]
    )
    found = triangulate(rig, left, right, covariances, covariances)
    ends = np.cumsum([views.stamps.size for views in trials])[:-1]
    points, spreads = np.split(found.points, ends), np.split(found.covariances, ends)
    return [
        Measured(views.stamps, views.truth, positions, covariance)
        for views, positions, covariance in zip(trials, points, spreads, strict=True)
    ]


def score(views: Views, measured: Measured, tracked: Track) -> Score:
    """Return how good the poses are beside the positions that they are made of."""
    given = np.isfinite(measured.positions[:, 0]) & (views.stamps >= SETTLING)
    raw = (measured.positions - views.truth)[given & ~views.wrong]
    error = tracked.errors[given]
    solved = np.linalg.solve(tracked.covariances[given], error[..., None])[..., 0]
    squares = np.sum(error * solved, axis=1)
    return Score(
        _rms(raw), _rms(error), float(squares.mean()) / 3.0, float(np.mean(squares < INSIDE))
    )


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def _in_view(rig: StereoRig, points: Array) -> bool:
    """Tell whether both cameras have all points in their pictures."""
    if points[:, 2].min() <= 0.0:
        return False
    for pixels, view in zip(rig.project(points), rig.views, strict=True):
        inside = (pixels >= 0.0) & (pixels <= np.array(view.camera.size))
        if not inside.all():
            return False
    return True


def _bursts(conditions: Conditions, random: np.random.Generator) -> NDArray[np.bool_]:
    count, burst = conditions.frames, conditions.burst
    begins = random.random(count) < conditions.wrong_share / burst
    begins[0] = False
    return np.asarray(np.convolve(begins, np.ones(burst))[:count] > 0.0)


def _noise(count: int, likeness: float, random: np.random.Generator) -> Array:
    """Return noise (count, 4) of deviation 1, each frame's like the one's before it."""
    fresh = random.standard_normal((count, 4))
    noise = fresh.copy()
    for number in range(1, count):
        noise[number] = likeness * noise[number - 1] + np.sqrt(1.0 - likeness**2) * fresh[number]
    return noise


def _direction(random: np.random.Generator) -> Array:
    vector = random.standard_normal(3)
    return vector / np.linalg.norm(vector)


def _still(times: Array, place: Array, random: np.random.Generator) -> Array:
    return np.zeros((times.size, 3))


def _drifting(times: Array, place: Array, random: np.random.Generator) -> Array:
    """Straight on at 1 to 10 mm/s."""
    speed = np.exp(random.uniform(np.log(1e-3), np.log(1e-2)))
    return np.outer(times, speed * _direction(random))


def _hovering(times: Array, place: Array, random: np.random.Generator) -> Array:
    """To and fro by 1 to 5 cm at 0.1 to 0.5 Hz, three tones along each axis."""
    size = random.uniform(0.01, 0.05, (3, 3))
    frequency, phase = random.uniform(0.1, 0.5, (3, 3)), random.uniform(0.0, 2.0 * np.pi, (3, 3))
    turns = 2.0 * np.pi * frequency * times[:, None, None] + phase
    return np.asarray((size * np.sin(turns)).sum(axis=2))


def _reaching(times: Array, place: Array, random: np.random.Generator) -> Array:
    """By 0.3 m in 0.6 to 1.5 s, then a rest: minimum jerk (Flash & Hogan 1985)."""
    moved, begin = np.zeros((times.size, 3)), times[0] + random.uniform(0.0, 0.3)
    while begin < times[-1]:
        duration = random.uniform(0.6, 1.5)
        share = np.clip((times - begin) / duration, 0.0, 1.0)
        course = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        moved += np.outer(course, 0.3 * _direction(random))
        begin += duration + random.uniform(0.3, 1.5)
    return moved


def _sinusoid(frequency: float, size: float) -> Motion:
    def motion(times: Array, place: Array, random: np.random.Generator) -> Array:
        phase = random.uniform(0.0, 2.0 * np.pi)
        swing = size * np.sin(2.0 * np.pi * frequency * times + phase)
        return np.outer(swing, _direction(random))

    return motion


def _pendulum(times: Array, place: Array, random: np.random.Generator) -> Array:
    """On a rope of 1 m, by 0.5 rad, at 0.5 Hz."""
    phase, heading = random.uniform(0.0, 2.0 * np.pi, 2)
    angle = 0.5 * np.sin(np.pi * times + phase)
    aside = np.array([np.cos(heading), 0.0, np.sin(heading)])
    up = np.array([0.0, -1.0, 0.0])
    return np.outer(np.sin(angle), aside) + np.outer(1.0 - np.cos(angle), up)


def _swimming(times: Array, place: Array, random: np.random.Generator) -> Array:
    """At 1 m/s, turning this way and that."""
    phase, turning = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.3, 1.0)
    heading = turning * times + 0.7 * np.sin(2.0 * np.pi * 0.3 * times + phase)
    dive = 0.3 * np.sin(2.0 * np.pi * 0.2 * times)
    level = np.sqrt(1.0 - dive**2)
    velocity = np.column_stack([level * np.cos(heading), dive, level * np.sin(heading)])
    return _integrated(times, velocity)


def _circling(times: Array, place: Array, random: np.random.Generator) -> Array:
    """A round of 0.1 m radius each second, square to the line of sight."""
    angle = 2.0 * np.pi * times + random.uniform(0.0, 2.0 * np.pi)
    return 0.1 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])


def _turning_rig(degrees: float, frequency: float) -> Motion:
    """A target at rest, seen from a rig that turns to and fro about an axis of its own."""

    def motion(times: Array, place: Array, random: np.random.Generator) -> Array:
        heading, phase = random.uniform(0.0, 2.0 * np.pi, 2)
        axis = np.array([np.cos(heading), np.sin(heading), 0.0])
        angle = np.deg2rad(degrees) * np.sin(2.0 * np.pi * frequency * times + phase)
        across = np.cross(axis, place)
        return np.outer(np.sin(angle), across) + np.outer(
            1.0 - np.cos(angle), np.cross(axis, across)
        )

    return motion


def _stop_and_go(times: Array, place: Array, random: np.random.Generator) -> Array:
    """For 1 to 3 s at 0.03 to 0.2 m/s, then as long a rest; 0.2 s to start and to stop."""
    velocity, begin = np.zeros((times.size, 3)), times[0] + random.uniform(0.0, 1.0)
    while begin < times[-1]:
        duration = random.uniform(1.0, 3.0)
        going = np.clip((times - begin) / 0.2, 0.0, 1.0)
        going = going - np.clip((times - begin - duration) / 0.2, 0.0, 1.0)
        velocity += np.outer(going, random.uniform(0.03, 0.2) * _direction(random))
        begin += duration + random.uniform(1.0, 3.0)
    return _integrated(times, velocity)


def _integrated(times: Array, velocity: Array) -> Array:
    middles = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(times)[:, None]
    return np.vstack([np.zeros(3), np.cumsum(middles, axis=0)])


#: The motions by name: displacements (n, 3), m, at times (n,), s, of a target at a place (3,), m.
MOTIONS: dict[str, Motion] = {
    'still': _still,
    'drifting': _drifting,
    'hovering': _hovering,
    'reaching': _reaching,
    '1 Hz, 0.1 m': _sinusoid(1.0, 0.1),
    '0.7 Hz, 0.2 m': _sinusoid(0.7, 0.2),
    '0.5 Hz, 0.3 m': _sinusoid(0.5, 0.3),
    '1.5 Hz, 0.02 m': _sinusoid(1.5, 0.02),
    'pendulum': _pendulum,
    'swimming': _swimming,
    'circling': _circling,
    'shaken rig': _turning_rig(1.0, 2.0),
    'swinging rig': _turning_rig(5.0, 1.5),
    'stop-and-go': _stop_and_go,
}
#: Those that a filter has something to gain on.
GENTLE = ('still', 'drifting', 'hovering', 'reaching')
