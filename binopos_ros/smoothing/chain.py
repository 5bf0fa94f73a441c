"""Markov chains in continuous time, whose transitions over any time are a product."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def eigenbasis(generator: Array) -> tuple[Array, Array]:
    """Return eigenvalues (k,) and projections (k, k, k): exp(G t) = sum of exp(e t) projection.

    `generator` (k, k) is that of a reversible chain, so that its eigenvalues are real.
    """
    rates, right = np.linalg.eig(generator)
    left = np.linalg.inv(right)
    return rates.real, (right.T[:, :, None] * left[:, None, :]).real
