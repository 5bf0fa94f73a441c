"""One formula, two speeds: the kernels' arithmetic on arrays, and on plain floats for one point.

NumPy is fast on thousands of points and slow on one, where each call costs more than the sum it
does. The kernels of this room are written on components (x, y, z apart) and take their few
functions from here, so that the very same lines also run on floats. There a ray that does not
exist raises `NoRayError` with the reason; in an array it becomes nan.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Component = Any  # a float, or an array of floats: one coordinate of one or of many points


class NoRayError(Exception):
    """No ray joins this point and this camera; says why."""


class Arithmetic(NamedTuple):
    """What the kernels need beyond operators.

    Attributes:
        sqrt: square root.
        maximum: larger of two.
        minimum: smaller of two.
        arctan: arc tangent.
        tan: tangent.
        where: where(condition, a, b) is a where the condition holds, elsewhere b.
        any: whether a condition holds anywhere.
        keep: keep(value, condition, reason) is the value where the condition holds; elsewhere nan
            (arrays) or NoRayError(reason) (floats).

    """

    sqrt: Callable[[Component], Component]
    maximum: Callable[[Component, Component], Component]
    minimum: Callable[[Component, Component], Component]
    arctan: Callable[[Component], Component]
    tan: Callable[[Component], Component]
    where: Callable[[Component, Component, Component], Component]
    any: Callable[[Component], bool]
    keep: Callable[[Component, Component, str], Component]


def _keep_elements(value: Component, condition: Component, _: str) -> Component:
    if np.all(condition):
        return value
    return np.where(condition, value, np.nan)


def _keep_float(value: float, condition: bool, reason: str) -> float:
    if not condition:
        raise NoRayError(reason)
    return value


def _where_float(condition: bool, value: float, otherwise: float) -> float:
    return value if condition else otherwise


ARRAYS = Arithmetic(
    np.sqrt, np.maximum, np.minimum, np.arctan, np.tan, np.where, np.any, _keep_elements
)
FLOATS = Arithmetic(math.sqrt, max, min, math.atan, math.tan, _where_float, bool, _keep_float)
