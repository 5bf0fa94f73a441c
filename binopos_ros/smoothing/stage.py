"""The smoothing stage: positions in, filtered poses out; when to foretell and when to be silent.

It is the same object in the live node and in `binopos process`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from binopos_ros.parameters import build, option, refuse_unknown, specs_of
from binopos_ros.smoothing.factory import FILTERS, make_filter
from binopos_ros.smoothing.health import HealthOptions
from binopos_ros.smoothing.options import Options
from binopos_ros.smoothing.state import FilterState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SmootherOptions:
    """Options of the smoothing stage; the filter's own options stand beside them."""

    method: str = option('cloud-kalman', 'the filter', choices=tuple(FILTERS), read_only=True)
    sensor_timeout: float = option(
        0.5,
        'for this long after the last used position the pose is foretold, with a growing '
        'covariance; then it stops',
        's',
        (0.0, 60.0),
    )
    output_rate: float = option(
        0.0,
        'poses per second at a fixed rate; 0: one per position, at its stamp',
        'Hz',
        (0.0, 500.0),
    )
    target_diameter: float = option(
        0.0,
        "of the markers' ball; 0: that of the triangulator's target, or 20 mm",
        'm',
        (0.0, 10.0),
    )
    child_frame: str = option(
        'target',
        "the target's frame: child_frame_id of target/odometry and on /tf",
        read_only=True,
    )
    publish_tf: bool = option(
        False, "the target's frame under that of its pose on /tf, with each pose", read_only=True
    )
    health: HealthOptions = field(default_factory=HealthOptions)


def filter_options_type(method: str) -> type[Options]:
    """The options of the filter that `method` names."""
    return FILTERS[method].options_class


#: Of a position that gives no pose though it was used: it mends the state that newer ones gave.
LATE = 'late: the pose of a newer one is out already'


@dataclass(frozen=True)
class Pose:
    """A filtered target: `stamp` in nanoseconds, the filter's state at that stamp."""

    stamp: int
    state: FilterState


class Smoother:
    """A filter with the rules about what is published."""

    def __init__(self, options: SmootherOptions, filter_options: Options) -> None:
        self.options = options
        self._filter = make_filter(options.method, **dataclasses.asdict(filter_options))
        self.reset()

    def reset(self) -> None:
        """Forget the target."""
        self._filter.reset()
        self._last_used: int | None = None
        self._systematic: Array | None = None

    def add(
        self,
        stamp: int,
        point: Array,
        covariance: Array,
        systematic: Array | None = None,
        medium: Array | None = None,
    ) -> tuple[Pose | None, str]:
        """Take one position in.

        Args:
            stamp: nanoseconds.
            point: (3,) m.
            covariance: (3, 3) m^2, the sum of all parts.
            systematic: (3, 3) m^2, the part that no filter averages away: the gain does not see
                it, and the pose has it again.
            medium: (3, 3) m^2, the part that a waving surface makes.

        Returns:
            The pose at that stamp, or None where nothing can be said of it; and why the position
            was not used, or ''.
        """
        self._systematic = systematic
        noise = covariance if systematic is None else covariance - systematic
        state = self._filter.step(stamp * 1e-9, point, noise, medium)
        if state.reason:
            return self._foretold(stamp, state), state.reason
        # Where the clock went back the filter has begun afresh, so its stamp is the one to go by.
        is_late = stamp * 1e-9 < state.stamp
        self._last_used = round(state.stamp * 1e9) if is_late else stamp
        # A late position mends the state, whose newest pose has been published already.
        return (None if is_late else Pose(stamp, self._whole(state))), ''

    def predict(self, stamp: int) -> Pose | None:
        """The pose foretold for a stamp (nanoseconds).

        None until two positions have told a velocity, and once `sensor_timeout` has passed.
        """
        return self._foretold(stamp, self._filter.predict(stamp * 1e-9))

    def _foretold(self, stamp: int, state: FilterState) -> Pose | None:
        if self._last_used is None or not self._filter.has_velocity:
            return None
        elapsed = (stamp - self._last_used) * 1e-9
        if not 0.0 < elapsed <= self.options.sensor_timeout:
            return None
        return Pose(stamp, self._whole(state))

    def _whole(self, state: FilterState) -> FilterState:
        """Return a state whose covariance has the part that the filter did not see."""
        if self._systematic is None:
            return state
        covariance = state.covariance.copy()
        covariance[:3, :3] += self._systematic
        return state._replace(covariance=covariance)


def make_smoother(values: Mapping[str, Any]) -> Smoother:
    """The smoothing stage from flat parameter values: its own, and beside them its filter's.

    Raises:
        ParameterError, SmoothingError: the values cannot be used.
    """
    own = specs_of(SmootherOptions)
    options = build(SmootherOptions, {k: v for k, v in values.items() if k in own})
    filter_type = filter_options_type(options.method)
    refuse_unknown(values, [*own, *specs_of(filter_type)])
    return Smoother(options, build(filter_type, {k: v for k, v in values.items() if k not in own}))
