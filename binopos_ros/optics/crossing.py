"""The bent ray through planes that are not parallel, by Fermat's principle.

With the crossing points on the planes as unknowns, the optical path length sum_i n_i |x_i+1 - x_i|
is a sum of norms of affine functions, so it is convex: there is one ray, and a descent finds it
from anywhere. Newton's step is taken where it halves the gradient (Snell's law's violation);
elsewhere a step of iteratively reweighted least squares, which always shortens the path. Both
solve the same block-tridiagonal system of 2x2 blocks, one block per plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.interface import tangents

FloatArray = NDArray[np.float64]

MAX_ITERATIONS = 200
SETTLED = 4e-16  # of the largest index: the gradient is a difference of n * (unit vector)


def crossings(
    normals: FloatArray, offsets: FloatArray, indices: FloatArray, points: FloatArray
) -> FloatArray:
    """Return where the rays from the origin to `points` cross the planes.

    Args:
        normals: (M, 3) unit normals of the planes in order, M at least 1.
        offsets: (M,) m; plane j is normals[j] . x = offsets[j].
        indices: (M + 1,) of the media, the origin's first.
        points: (N, 3) m.

    Returns:
        (N, M, 3) m. Whether they lie in the order of the planes is for the caller to judge.

    """
    bases = np.stack([tangents(normal) for normal in normals])  # (M, 2, 3)
    x = _start(normals, offsets, points)
    best = np.full(len(points), np.inf)
    active = np.arange(len(points))
    for _ in range(MAX_ITERATIONS):
        gradient, legs, lengths = _gradient(x[active], points[active], indices, bases)
        size = np.abs(gradient).max(axis=(1, 2))
        newton = size <= 0.5 * best[active]
        stalled = (size < 1e-12 * indices.max()) & ~newton  # rounding has been reached
        best[active] = np.minimum(best[active], size)
        going = ~stalled & (size > SETTLED * indices.max())
        active = active[going]
        if not len(active):
            break
        step = _step(gradient[going], legs[going], lengths[going], indices, bases, newton[going])
        x[active] += np.einsum('nma,mai->nmi', step, bases)
    return x


def _start(normals: FloatArray, offsets: FloatArray, points: FloatArray) -> FloatArray:
    """Return the straight line's crossings, kept finite where it runs along a plane."""
    along = points @ normals.T  # (N, M)
    share = np.clip(offsets / np.where(along > offsets, along, offsets), 0.0, 1.0)
    x = share[..., None] * points[:, None, :]
    lift = offsets - np.einsum('nmi,mi->nm', x, normals)
    return x + lift[..., None] * normals


def _gradient(
    x: FloatArray, points: FloatArray, indices: FloatArray, bases: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the violation of Snell's law at each plane, the unit legs and their lengths."""
    ends = np.concatenate([np.zeros_like(points)[:, None], x, points[:, None]], axis=1)
    legs = np.diff(ends, axis=1)
    lengths = np.linalg.norm(legs, axis=2)
    legs = legs / np.maximum(lengths, 1e-300)[..., None]
    momenta = indices[:, None] * legs
    gradient = np.einsum('nmi,mai->nma', momenta[:, :-1] - momenta[:, 1:], bases)
    return gradient, legs, lengths


def _step(
    gradient: FloatArray,
    legs: FloatArray,
    lengths: FloatArray,
    indices: FloatArray,
    bases: FloatArray,
    newton: NDArray[np.bool_],
) -> FloatArray:
    """Solve the block-tridiagonal system H step = -gradient (block elimination)."""
    planes = len(bases)
    stiffness = (indices / np.maximum(lengths, 1e-300))[..., None, None] * (
        np.eye(3) - newton[:, None, None, None] * legs[..., :, None] * legs[..., None, :]
    )
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
