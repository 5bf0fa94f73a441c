"""What there is to see of a dive: numbers, curves of two minutes, nodes, a timeline.

It takes the suite's messages, rclpy's or those of a bag, which have the same fields. It has no
clock of its own: whoever hands it a message says when it came. Not for several threads at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.sides import SIDES
from binopos_ros.view.nodes_seen import NodesSeen
from binopos_ros.view.pace import Pace
from binopos_ros.view.remedies import SWITCHED_OFF, remedy_for
from binopos_ros.view.ring import Ring
from binopos_ros.view.timeline import Timeline
from binopos_ros.view.wire import KINDS

POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
DIAGNOSTICS = '/diagnostics'
#: Topics that the page is made of, beside the pictures, and their types.
TOPICS = {
    'target/pose': POSE,
    'target/position': POSE,
    'target/odometry': 'nav_msgs/msg/Odometry',
    'target/health': 'diagnostic_msgs/msg/DiagnosticStatus',
    'target/refractive_index': 'geometry_msgs/msg/Vector3Stamped',
    **{f'{side}/centroid': POSE for side in SIDES},
    **{f'{side}/camera_info': 'sensor_msgs/msg/CameraInfo' for side in SIDES},
    DIAGNOSTICS: 'diagnostic_msgs/msg/DiagnosticArray',
}
#: s between points of the curves, and how much of the past they show.
CURVE_PERIOD, CURVE_LENGTH = 0.1, 120.0
#: s after which a distance or a mark is of the past.
STALE = 1.0
#: s; less than any picture takes.
INSTANTLY = 1e-5
#: s; the smoother tells the target's health twice per second.
UNTOLD = 1.5


class Instant(NamedTuple):
    """When a message came."""

    now: float  #: s of a clock that never jumps
    wall: float  #: s since the epoch, by the clock that the stamps are of


class Mark(NamedTuple):
    """Where the target was seen in a picture, px: centre, diameter, covariance (uu, uv, vv)."""

    side: str
    stamp: int
    u: float
    v: float
    diameter: float
    covariance: tuple[float, float, float]


class Screen:
    """What the viewers see.

    Args:
        on_mark: gets each mark as it comes.

    Attributes:
        timeline: what happened.
        curves: points of the last two minutes: stamp (s), x, y, z, their deviations (m),
            latency (s; nan where not known), rate (Hz).
        epoch: changes whenever the curves begin anew.
    """

    def __init__(self, on_mark: Callable[[Mark], None] = lambda _: None) -> None:
        self.timeline = Timeline()
        self.curves: Ring[tuple[float, ...]] = Ring(round(CURVE_LENGTH / CURVE_PERIOD))
        self._nodes = NodesSeen(self.timeline)
        self._on_mark = on_mark
        self._pace = Pace()
        self._pictures = {kind: Pace() for kind in KINDS}
        self._pose: _Pose | None = None
        self._distance = (-math.inf, math.nan)
        self._speed = (-math.inf, math.nan, math.nan)
        self._health = ('', '')
        self._health_at = -math.inf
        self._index: tuple[float, float, bool] | None = None
        self._cameras: dict[str, dict[str, Any]] = {}
        self._next_point = -math.inf
        self.epoch = 0
        self._takers: dict[str, Callable[[Instant, Any], None]] = {
            'target/pose': self._take_pose,
            'target/position': self._take_position,
            'target/odometry': self._take_odometry,
            'target/health': self._take_health,
            'target/refractive_index': self._take_index,
            DIAGNOSTICS: self._take_diagnostics,
        }

    def take(self, topic: str, message: Any, instant: Instant) -> None:
        """Take a message of one of `TOPICS`, named relative to the suite's namespace."""
        side, _, name = topic.partition('/')
        if name == 'centroid':
            self._take_centroid(side, message)
        elif name == 'camera_info':
            self._take_camera(side, message)
        else:
            self._takers[topic](instant, message)

    def picture(self, kind: str, now: float) -> None:
        """A picture of one of `wire.KINDS` came."""
        self._pictures[kind].add(now)

    def numbers(self, instant: Instant) -> dict[str, Any]:
        """All figures at an instant: lengths in m, times in s, rates in Hz; nan for not known."""
        now = instant.now
        self._nodes.look(instant.wall, now)
        median, p99 = self._pace.latency(now)
        word, reason = self._health
        if now - self._health_at > UNTOLD:
            word, reason = ('silent', 'the smoother says nothing any more') if word else ('', '')
        speed_at, speed, speed_std = self._speed
        distance_at, distance = self._distance
        pose = self._pose
        return {
            'wall': instant.wall,
            'pose': None if pose is None else pose.told(),
            'age': math.nan if pose is None else now - pose.came,
            'distance': distance if now - distance_at < STALE else math.nan,
            'speed': speed if now - speed_at < STALE else math.nan,
            'speed_std': speed_std if now - speed_at < STALE else math.nan,
            'health': {'word': word, 'reason': reason, 'remedy': self._remedy(word, reason)},
            'rate': self._pace.rate(now),
            'latency': {'median': median, 'p99': p99},
            'pictures': {kind: pace.rate(now) for kind, pace in self._pictures.items()},
            'refused': {side: self._nodes.refused(side) for side in SIDES},
            'epoch': self.epoch,
            'index': self._index_told(),
            'waves': self._nodes.waves,
            'drops': self._nodes.drops(),
            'lost': self._nodes.pairs_lost(),
            'nodes': self._nodes.told(now),
            'recorder': self._nodes.recorder(now),
            'cameras': self._cameras,
        }

    def reset(self) -> None:
        """Forget the target and the curves, as when another part of a bag is shown."""
        self._pose = None
        self._pace = Pace()
        self._next_point = -math.inf
        self.epoch += 1
        self.curves.clear()

    def _take_pose(self, instant: Instant, message: Any) -> None:
        stamp = stamp_of(message)
        position, covariance = position_of(message), covariance_of(message)[:3, :3]
        if not (np.isfinite(position).all() and np.isfinite(covariance).all()):
            self._nodes.drop('page', 'pose is not finite')
            return
        if self.timeline.stamp(instant.wall, stamp):
            self.reset()
        self._pose = _Pose(instant.now, stamp, str(message.header.frame_id), position, covariance)
        late = instant.wall - stamp * 1e-9
        # What was processed afterwards is written at its own stamps: it took no time.
        self._pace.add(instant.now, late if abs(late) > INSTANTLY else math.nan)
        if instant.now >= self._next_point:
            self._next_point = instant.now + CURVE_PERIOD
            latency = self._pace.latency(instant.now)[0]
            rate = self._pace.rate(instant.now)
            deviations = self._pose.deviations
            self.curves.add((stamp * 1e-9, *position, *deviations, latency, rate))

    def _take_position(self, instant: Instant, message: Any) -> None:
        distance = float(np.linalg.norm(position_of(message)))
        self._distance = (instant.now, distance)

    def _take_odometry(self, instant: Instant, message: Any) -> None:
        linear = message.twist.twist.linear
        velocity = np.array([linear.x, linear.y, linear.z])
        speed = float(np.linalg.norm(velocity))
        covariance = np.asarray(message.twist.covariance, dtype=float).reshape(6, 6)[:3, :3]
        # Along the motion; of a target at rest, in any direction.
        along = velocity / speed if speed > 0 else np.ones(3) / math.sqrt(3)
        self._speed = (instant.now, speed, float(np.sqrt(max(along @ covariance @ along, 0.0))))

    def _take_health(self, instant: Instant, message: Any) -> None:
        values = {each.key: each.value for each in message.values}
        self._health = (str(message.message), values.get('Reason', ''))
        self._health_at = instant.now
        self.timeline.health(instant.wall, *self._health)

    def _take_index(self, _: Instant, message: Any) -> None:
        vector = message.vector
        self._index = (float(vector.x), float(vector.y), vector.z > 0.5)

    def _remedy(self, word: str, reason: str) -> str:
        if self._nodes.detector_is_off and word not in ('tracking', ''):
            return SWITCHED_OFF
        return remedy_for(reason, word)

    def _index_told(self) -> dict[str, Any] | None:
        if self._index is None:
            return None
        mean, std, observed = self._index
        verdict = 'seen in the pictures' if observed else 'rests on the prior alone'
        if std == 0.0:
            verdict = 'given, not estimated'
        return {'mean': mean, 'std': std, 'observed': observed, 'verdict': verdict}

    def _take_centroid(self, side: str, message: Any) -> None:
        u, v, diameter = map(float, position_of(message))
        covariance = covariance_of(message)
        mark = Mark(
            side,
            stamp_of(message),
            u,
            v,
            diameter,
            (float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])),
        )
        if math.isfinite(u) and math.isfinite(v):
            self._on_mark(mark)

    def _take_camera(self, side: str, message: Any) -> None:
        focal, shift = float(message.p[0]), float(message.p[3])
        self._cameras[side] = {
            'width': int(message.width),
            'height': int(message.height),
            'baseline': abs(shift / focal) if focal else 0.0,
        }

    def _take_diagnostics(self, instant: Instant, message: Any) -> None:
        for status in message.status:
            self._nodes.take(instant, status)


class _Pose(NamedTuple):
    """The newest pose of the target."""

    came: float
    stamp: int
    frame: str
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def deviations(self) -> list[float]:
        """Of x, y and z, m."""
        return [float(x) for x in np.sqrt(np.clip(np.diag(self.covariance), 0.0, None))]

    def told(self) -> dict[str, Any]:
        return {
            'stamp': str(self.stamp),
            'frame': self.frame,
            'position': self.position.tolist(),
            'deviation': self.deviations,
            'covariance': self.covariance.ravel().tolist(),
        }
