"""Numbers that are floats for one sequence, and (N,) arrays for a batch of N in lock-step.

What is done to three or four numbers at a time is ten times quicker in floats than in arrays, and
the same lines serve both, since operators do.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Number = float | Array


def components(vector: Array) -> list[Any]:
    """Return the numbers of a vector (k,) or (N, k)."""
    return vector.tolist() if vector.ndim == 1 else list(vector.T)


def rows(matrix: Array) -> list[list[Any]]:
    """Return the numbers of a matrix (k, l) or (N, k, l), by rows."""
    return (
        matrix.tolist() if matrix.ndim == 2 else [list(row) for row in np.moveaxis(matrix, 0, 2)]
    )


def vector(numbers: Iterable[Number]) -> Array:
    """Return the vector (k,) or (N, k) of those numbers."""
    return np.array(list(numbers)).T


def larger(one: Number, other: Number) -> Number:
    """Return the larger of two numbers."""
    if isinstance(one, float) and isinstance(other, float):
        return one if one > other else other
    return np.maximum(one, other)


def smaller(one: Number, other: Number) -> Number:
    """Return the smaller of two numbers."""
    if isinstance(one, float) and isinstance(other, float):
        return one if one < other else other
    return np.minimum(one, other)


def exponential(exponent: Number) -> Number:
    """Return e to the exponent."""
    return math.exp(exponent) if isinstance(exponent, float) else np.exp(exponent)


def smallest(values: Array) -> Number:
    """Return the smallest of the values (k,) or (N, k)."""
    return min(values.tolist()) if values.ndim == 1 else values.min(axis=-1)


def beside(number: Number, dimensions: int) -> Number:
    """Return a number with that many dimensions of 1 behind those of the batch."""
    if isinstance(number, float):
        return number
    return number.reshape(*number.shape, *(1,) * dimensions)


def product(left: Array, right: Array) -> Array:
    """Return the product of matrices; dot() is the quicker one where there is no batch."""
    return left.dot(right) if right.ndim == 2 else left @ right


def applied(matrix: Array, vector: Array) -> Array:
    """Return what a matrix (..., k, l) makes of a vector (..., l)."""
    return matrix.dot(vector) if vector.ndim == 1 else (matrix @ vector[..., None])[..., 0]


def anywhere(condition: bool | NDArray[np.bool_]) -> bool:
    """Tell whether a condition holds, of one sequence or of any of a batch."""
    return condition if isinstance(condition, bool) else bool(condition.any())
