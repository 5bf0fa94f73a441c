"""How well the target is known, in one word, so that who steers need not read covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from binopos_ros.parameters import option

#: Each word's level in a diagnostic_msgs/DiagnosticStatus: 0 well, 1 a warning, 2 an error.
LEVELS = {'starting': 1, 'tracking': 0, 'coasting': 1, 'degraded': 1, 'lost': 2}
#: Seconds between two words where nothing changes.
PERIOD = 0.5


@dataclass(frozen=True)
class HealthOptions:
    """Limits of `target/health`."""

    coasting_after: float = option(
        0.15, 'after so long without a used position the pose only coasts', 's', (0.0, 60.0)
    )
    max_std: float = option(
        0.05,
        'the target is degraded where the standard deviation of its pose, along the worst known '
        'direction, is larger',
        'm',
        (0.0, 1000.0),
    )


@dataclass(frozen=True)
class Health:
    """A judgement.

    Attributes
    ----------
    word : str
        One of `LEVELS`; `starting` before the first pose.
    reason : str
        Why it is not `tracking`; '' where it is.
    age : float
        Seconds since the last used position came; nan where none has.
    deviation : float
        Largest standard deviation of the newest pose (m); nan where there is none.

    """

    word: str
    reason: str
    age: float
    deviation: float

    def values(self, frame_id: str) -> dict[str, str]:
        """What a message says beside the word; `frame_id` is the pose's."""
        return {
            'Age of the last position (s)': f'{self.age:.3f}',
            'Standard deviation (m)': f'{self.deviation:.5f}',
            'Reason': self.reason,
            'Frame': frame_id,
        }


class HealthMonitor:
    """Judges the target by what was used, refused and published; instants in seconds."""

    def __init__(self) -> None:
        self._word = ''
        self._told = float('-inf')
        self.reset()

    def reset(self) -> None:
        """Begin anew, as the smoother does."""
        self._used = float('nan')
        self._deviation = float('nan')
        self._refusal = ''

    def use(self, instant: float) -> None:
        """A position was used."""
        self._used = instant
        self._refusal = ''

    def refuse(self, reason: str) -> None:
        """A position was not used."""
        self._refusal = reason

    def pose(self, covariance: NDArray[np.float64]) -> None:
        """A pose was published, with that covariance of its position, (3, 3) m^2."""
        self._deviation = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))

    def news(self, instant: float, options: HealthOptions, sensor_timeout: float) -> Health | None:
        """The judgement where the word has changed, and every `PERIOD`; else None."""
        health = self._judge(instant, options, sensor_timeout)
        if health.word == self._word and instant - self._told < PERIOD:
            return None
        self._word, self._told = health.word, instant
        return health

    def _judge(self, instant: float, options: HealthOptions, sensor_timeout: float) -> Health:
        """The word for this instant; the target is lost after `sensor_timeout`, s."""
        age = instant - self._used

        def health(word: str, reason: str = '') -> Health:
            return Health(word, reason, age, self._deviation)

        last = f': {self._refusal}' if self._refusal else ''
        if np.isnan(age):
            return health('starting', f'no position was used yet{last}')
        if age > sensor_timeout:
            return health('lost', f'no position was used for {age:.1f} s{last}')
        if age > options.coasting_after:
            return health('coasting', f'no position was used for {age:.2f} s{last}')
        if self._deviation > options.max_std:
            return health(
                'degraded',
                f"the standard deviation is {self._deviation:.3f} m, more than 'health.max_std'",
            )
        return health('tracking')
