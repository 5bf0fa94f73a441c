"""The bent ray through planes that are not parallel, by Fermat's principle.

With the crossing points on the planes as unknowns, the optical path length sum_i n_i |x_i+1 - x_i|
is a sum of norms of affine functions, so it is convex: there is one ray, and a descent finds it
from anywhere. A step solves a block-tridiagonal system, one 2x2 block per plane, whose legs have
the stiffness n / length across the ray and `damping` times that along it. Without damping it is
Newton's step; with full damping it is iteratively reweighted least squares, which always shortens
the path. The damping of each ray follows Levenberg and Marquardt.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MAX_ITERATIONS = 100
ROUNDING = 4e-16  # of the largest index: Snell's law is a difference of index * (unit vector)
SNELL_TOLERANCE = 1e-12  # of the largest index; a ray that is farther off is not kept


def crossings(
    normals: FloatArray,
    offsets: FloatArray,
    bases: FloatArray,
    indices: FloatArray,
    points: FloatArray,
) -> FloatArray:
    """Return where the rays from the origin to `points` cross the planes.

    Args:
        normals: (M, 3) unit normals of the planes in order, M at least 1.
        offsets: (M,) m; plane j is normals[j] . x = offsets[j].
        bases: (M, 2, 3) two unit vectors in each plane.
        indices: (M + 1,) of the media, the origin's first.
        points: (N, 3) m.

    Returns:
        (N, M, 3) m; nan where no ray obeys Snell's law, as where planes cut one another. Whether
        the crossings lie in the order of the planes is for the caller to judge.

    """
    scale = float(indices.max())
    x = _start(normals, offsets, points)
    now = _state(x, points, indices, bases)
    damping = np.zeros(len(points))
    active = np.arange(len(points))
    for _ in range(MAX_ITERATIONS):
        active = active[now.violation[active] > ROUNDING * scale]
        if not len(active):
            break
        held = now.take(active)
        step = _step(held, indices, bases, damping[active])
        trial = x[active] + np.einsum('nma,mai->nmi', step, bases)
        further = _state(trial, points[active], indices, bases)
        # Where the path's length is at its last digit, Snell's law still tells better from worse.
        better = (further.length < held.length * (1.0 - 1e-15)) | (
            further.violation <= 0.5 * held.violation
        )
        taken = active[better]
        x[taken] = trial[better]
        now.put(taken, further.take(better))
        at_rest = ~better & (held.violation <= SNELL_TOLERANCE * scale)
        damping[active] = np.where(
            better, 0.1 * damping[active], np.clip(10.0 * damping[active], 1e-4, 1.0)
        )
        active = active[~at_rest]
    x[~(now.violation <= SNELL_TOLERANCE * scale)] = np.nan
    return x


class _State(NamedTuple):
    """Paths of N points: their legs, and how far they are from the shortest."""

    length: FloatArray  # (N,) optical, m
    violation: FloatArray  # (N,) of Snell's law
    gradient: FloatArray  # (N, M, 2) of the length by the crossings' plane coordinates
    legs: FloatArray  # (N, M + 1, 3) unit vectors
    lengths: FloatArray  # (N, M + 1) m

    def take(self, which: NDArray[np.generic]) -> _State:
        """Return the states of some points."""
        return _State(*(part[which] for part in self))

    def put(self, which: NDArray[np.generic], other: _State) -> None:
        """Replace the states of some points."""
        for part, new in zip(self, other, strict=True):
            part[which] = new


def _start(normals: FloatArray, offsets: FloatArray, points: FloatArray) -> FloatArray:
    """Return the straight line's crossings, kept finite where it runs along a plane."""
    along = points @ normals.T  # (N, M)
    share = np.clip(offsets / np.where(along > offsets, along, offsets), 0.0, 1.0)
    x = share[..., None] * points[:, None, :]
    lift = offsets - np.einsum('nmi,mi->nm', x, normals)
    return x + lift[..., None] * normals


def _state(x: FloatArray, points: FloatArray, indices: FloatArray, bases: FloatArray) -> _State:
    ends = np.concatenate([np.zeros_like(points)[:, None], x, points[:, None]], axis=1)
    legs = np.diff(ends, axis=1)
    lengths = np.linalg.norm(legs, axis=2)
    legs /= np.maximum(lengths, 1e-300)[..., None]
    momenta = indices[:, None] * legs
    gradient = np.einsum('nmi,mai->nma', momenta[:, :-1] - momenta[:, 1:], bases)
    return _State(lengths @ indices, np.abs(gradient).max(axis=(1, 2)), gradient, legs, lengths)


def _step(
    state: _State, indices: FloatArray, bases: FloatArray, damping: FloatArray
) -> FloatArray:
    """Solve the block-tridiagonal system H step = -gradient (block elimination)."""
    gradient, legs, lengths = state.gradient, state.legs, state.lengths
    along = (1.0 - damping)[:, None, None, None] * legs[..., :, None] * legs[..., None, :]
    stiffness = (indices / np.maximum(lengths, 1e-12))[..., None, None] * (np.eye(3) - along)
    planes = len(bases)
    eliminated: list[FloatArray] = []
    reduced: list[FloatArray] = []
    for j in range(planes):
        basis = bases[j]
        block = basis @ (stiffness[:, j] + stiffness[:, j + 1]) @ basis.T
        right = -gradient[:, j]
        if j:
            coupling = -basis @ stiffness[:, j] @ bases[j - 1].T
            factor = coupling @ eliminated[-1]
            block = block - factor @ np.swapaxes(coupling, 1, 2)
            right = right - (factor @ reduced[-1][..., None])[..., 0]
        eliminated.append(np.linalg.inv(block))
        reduced.append(right)
    steps = [(eliminated[-1] @ reduced[-1][..., None])[..., 0]]
    for j in range(planes - 2, -1, -1):
        coupling = -bases[j] @ stiffness[:, j + 1] @ bases[j + 1].T
        right = reduced[j] - (coupling @ steps[0][..., None])[..., 0]
        steps.insert(0, (eliminated[j] @ right[..., None])[..., 0])
    return np.stack(steps, axis=1)
