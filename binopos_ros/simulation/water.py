"""What water does to colours: red goes first, and a veil of scattered light comes in its place."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.errors import SimulationError

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Water:
    """Absorption (Beer and Lambert) and scattering, in blue, green, red.

    Attributes:
        absorption: per metre; pure water has about 0.3 at 620-650 nm, 0.06 at 550 nm, 0.01 at
            450 nm (Pope and Fry, Applied Optics 36, 1997, table 3).
        scattering: per metre, of the veil.
        veil: grey levels that endless water shows.
    """

    absorption: tuple[float, float, float] = (0.012, 0.06, 0.30)
    scattering: float = 0.02
    veil: tuple[float, float, float] = (110.0, 100.0, 55.0)

    def __post_init__(self) -> None:
        values = (*self.absorption, self.scattering, *self.veil)
        if not all(np.isfinite(value) and value >= 0 for value in values):
            msg = 'the water absorbs or scatters a negative or infinite share: give values >= 0'
            raise SimulationError(msg)

    def transmission(self, lengths: Array, light_lengths: Array) -> tuple[Array, Array]:
        """Factor on a thing's colour and veil added to it, each (N, 3).

        Args:
            lengths: (N,) path of sight through water, m.
            light_lengths: (N,) path of the light to the thing, m.
        """
        whole = lengths + light_lengths
        factor = np.exp(-(np.array(self.absorption) + self.scattering) * whole[:, None])
        share = 1 - np.exp(-self.scattering * lengths)
        return factor, np.array(self.veil) * share[:, None]
