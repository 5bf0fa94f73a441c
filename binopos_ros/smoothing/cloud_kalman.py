"""The default smoother: Kalman filters steered by the certainty of a cloud.

Where nothing waves, the ladder of :mod:`binopos_ros.smoothing.ladder` does it all: how freely the
target moves is a cloud's uncertain width, and the certainty that a position belongs to the cloud
is the weight that it is taken with.

Where a part of a position's covariance is the medium's, which swings rather than scatters, the
filter of :mod:`binopos_ros.smoothing.waves` runs beside the ladder. One rule passes from one to
the other: the waves' filter is believed the more the medium outweighs the pixels' noise.
"""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing import ladder, waves
from binopos_ros.smoothing.axes import Axes, along, first_axes, following
from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.ladder import Ladder
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option
from binopos_ros.smoothing.rungs import switching
from binopos_ros.smoothing.scalars import (
    Number,
    anywhere,
    applied,
    beside,
    components,
    larger,
    product,
    smaller,
)
from binopos_ros.smoothing.waves import Waves

Array = NDArray[np.float64]

#: Positions with less certainty than this count as not used, and the state says so.
_LEAST_CERTAINTY = 0.1
#: The medium's variance, in the pixels', up to which positions are taken as they come, and from
#: which the waves' filter is believed alone: below the first waves cost less than a motion that is
#: taken for one, and what calm residuals show by chance stays below it.
_CALM, _ROUGH = 1.0, 2.0
# Where the numbers of a (6, 6) covariance are among those of its (3, 3) blocks: position's, the
# two's, velocity's.
_WHOLE = np.block(
    [[np.arange(9).reshape(3, 3) + 9 * block for block in row] for row in ((0, 1), (1, 2))]
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CloudKalmanOptions(Options):
    """Options of the cloud-Kalman filter."""

    max_jump: float = option(
        5.0, 'a position further than this from the prediction is refused', 'm', (1e-3, 1e3)
    )
    max_acceleration: float = option(
        20.0,
        'a position that only a larger acceleration would explain may be that of another thing',
        'm/s^2',
        (1e-3, 1e6),
    )
    max_turning: float = option(
        10.0,
        "angular acceleration of the rig, times the target's distance added to max_acceleration; "
        '0 in a frame that does not turn with the rig',
        'rad/s^2',
        (0.0, 1e3),
    )
    resting_frames: float = option(
        20.0,
        'frames for which a target stays at rest in the mean; 10000 for one that is fixed in the '
        'frame of the positions',
        '',
        (1.0, 1e9),
    )
    wrong_share: float = option(
        0.02, 'share of the positions that may be those of another thing', '', (1e-9, 0.5)
    )


class _Memory(NamedTuple):
    """Both filters along the axes.

    `rough` (...) is the share that the waves' filter has in what is said, `certainty` (...) the
    weight of the last position.
    """

    axes: Axes
    free: Ladder
    waves: Waves | None
    rough: Number
    certainty: Number


class CloudKalmanFilter(Filter[_Memory]):
    """Cloud-Kalman filter: the default smoother."""

    name: ClassVar[str] = 'cloud-kalman'
    options_class: ClassVar[type[Options]] = CloudKalmanOptions
    options: CloudKalmanOptions

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._chain = switching(self.options.resting_frames)

    def spread(self, covariance: Array, medium: Array | None = None) -> Array:
        """Return the noise's part (..., 1, 3, 3), or that and the medium's (..., 2, 3, 3)."""
        if medium is None:
            return covariance[..., None, :, :]
        parts = np.empty((*covariance.shape[:-2], 2, 3, 3))
        np.subtract(covariance, medium, out=parts[..., 0, :, :])
        parts[..., 1, :, :] = medium
        return parts

    def _start(self, position: Array, covariance: Array) -> _Memory:
        axes = first_axes(covariance[..., 0, :, :])
        measured = applied(axes.rows, position)
        noise, medium = _variances(along(axes, covariance))
        wavy = None if medium is None else waves.start(measured, noise, medium)
        free = ladder.start(measured, _sum(noise, medium))
        return _Memory(axes, free, wavy, _roughness(noise, medium), 1.0 + free.since)

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        if memory.waves is None:
            return memory._replace(free=ladder.advance(memory.free, self._chain, elapsed))
        wavy = waves.advance(memory.waves, elapsed)
        if _everywhere(memory.rough):
            free = ladder.waited(memory.free, elapsed)
        else:
            free = ladder.advance(memory.free, self._chain, elapsed)
        return memory._replace(free=free, waves=wavy)

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        seen = along(memory.axes, covariance)
        axes = following(memory.axes, seen[..., 0, 2:])
        if axes is not None:
            memory = _turned(memory, axes)
            seen = along(axes, covariance)
        measured = applied(memory.axes.rows, position)
        noise, medium = _variances(seen)
        rough: Number = 0.0 * memory.rough
        wavy = None
        if medium is not None and memory.waves is not None:
            wavy = waves.correct(memory.waves, measured, noise, medium)
            alone = 1.0 * (memory.rough == 1.0)
            rough = _roughness(noise, medium)
            rough = rough * waves.believable(wavy, noise, medium, alone)
            if _everywhere(rough):
                free = ladder.in_pace(memory.free)
                return _Memory(memory.axes, free, wavy.waves, rough, wavy.certainty)
        x, y, z = components(position)
        distance = (x * x + y * y + z * z) ** 0.5
        free = ladder.correct(
            _free(memory),
            measured,
            _sum(noise, medium),
            self.options.wrong_share,
            self.options.max_acceleration + self.options.max_turning * distance,
        )
        if wavy is not None:
            certainty = free.certainty + rough * (wavy.certainty - free.certainty)
            return _Memory(memory.axes, free, wavy.waves, rough, certainty)
        begun = memory.waves if medium is None else waves.start(measured, noise, medium)
        return _Memory(memory.axes, free, begun, rough, free.certainty)

    def _place(self, memory: _Memory) -> Array:
        if memory.waves is None:
            place = ladder.mean_position(memory.free)
        elif _everywhere(memory.rough):
            place = waves.mean_position(memory.waves)
        else:
            place = ladder.mean_position(memory.free)
            apart = waves.mean_position(memory.waves) - place
            place = place + beside(memory.rough, 1) * apart
        return applied(memory.axes.rows.swapaxes(-1, -2), place)

    def _estimate(self, memory: _Memory) -> Estimate:
        if memory.waves is None or not anywhere(memory.rough > 0.0):
            state, covariance = _calm(memory)
        elif _everywhere(memory.rough):
            state, covariance = _rough(memory, memory.waves)
        else:
            state, covariance = _blended(memory, memory.waves)
        enough: Any = memory.certainty > _LEAST_CERTAINTY
        used: Number = memory.certainty * enough
        return Estimate(state[..., 0, :], state[..., 1, :], covariance, used)


def _everywhere(rough: Number) -> bool:
    """Tell whether only the waves' filter is believed, of all sequences."""
    return rough == 1.0 if isinstance(rough, float) else bool((rough == 1.0).all())


def _free(memory: _Memory) -> Ladder:
    """Return the ladder, which begins with what the waves' filter says where that was alone."""
    free, wavy = memory.free, memory.waves
    alone = np.equal(memory.rough, 1.0)
    if wavy is None or not alone.any():
        return free
    begun = ladder.begun(free, *waves.moments(wavy))
    if alone.all():
        return begun
    return free._replace(
        origin=np.where(beside(alone, 1), begun.origin, free.origin),
        moments=np.where(beside(alone, 3), begun.moments, free.moments),
        certainty=np.where(alone, begun.certainty, free.certainty),
    )


def _sum(noise: Array, medium: Array | None) -> Array:
    return noise if medium is None else noise + medium


def _variances(seen: Array) -> tuple[Array, Array | None]:
    """Return the noise's and, where it is told, the medium's variances (..., 3) along the axes."""
    return seen[..., 0, :3], seen[..., 1, :3] if seen.shape[-2] == 2 else None


def _calm(memory: _Memory) -> tuple[Array, Array]:
    """Return what the ladder says: states (..., 2, 3), covariances (..., 6, 6)."""
    mean, parts = ladder.moments(memory.free)
    # Each axis' share in the covariances is a multiple of its direction's square.
    blocks = product(parts, memory.axes.products[..., :3, :])
    covariance = blocks.reshape(*blocks.shape[:-2], 27).take(_WHOLE, axis=-1)
    return product(mean, memory.axes.rows), covariance


def _rough(memory: _Memory, wavy: Waves) -> tuple[Array, Array]:
    """Return what the waves' filter says: states (..., 2, 3), covariances (..., 6, 6)."""
    mean, spread = waves.moments(wavy)
    turn = memory.axes.both
    state = product(mean.reshape(*mean.shape[:-1], 2, 3), memory.axes.rows)
    return state, product(product(turn.swapaxes(-1, -2), spread), turn)


def _blended(memory: _Memory, wavy: Waves) -> tuple[Array, Array]:
    """Return what both filters say together: states (..., 2, 3), covariances (..., 6, 6)."""
    state, covariance = _calm(memory)
    other, spread = _rough(memory, wavy)
    share = beside(memory.rough, 2)
    apart = other - state
    flat = apart.reshape(*covariance.shape[:-1])
    between = flat[..., :, None] * flat[..., None, :]
    between *= 1.0 - share
    spread += between
    spread -= covariance
    spread *= share
    spread += covariance
    apart *= share
    apart += state
    return apart, spread


def _roughness(noise: Array, medium: Array | None) -> Number:
    """Return from 0 to 1 how far the medium outweighs the noise."""
    if medium is None:
        return np.zeros(noise.shape[:-1]) if noise.ndim > 1 else 0.0
    x, y, z = components(medium / noise)
    share = ((x + y + z) / 3.0 - _CALM) / (_ROUGH - _CALM)
    return smaller(larger(share, 0.0), 1.0)


def _turned(memory: _Memory, axes: Axes) -> _Memory:
    """Return the memory along other axes."""
    turn = axes.rows @ memory.axes.rows.swapaxes(-1, -2)
    return memory._replace(
        axes=axes,
        free=ladder.turned(memory.free, turn),
        waves=None if memory.waves is None else waves.turned(memory.waves, turn),
    )
