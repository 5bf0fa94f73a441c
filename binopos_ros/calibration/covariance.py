"""The calibration's own uncertainty: stored beside the calibration, carried on to positions.

The file names each parameter as `RigState.names` does, so `ordered(rig.parameter_names)` is what
`triangulate` takes as `parameter_covariance`. `calibration_covariances` adds the cameras' part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped]

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.projection import project
from binopos_ros.calibration.state import LEFT, RIGHT, RigState

HEADER = """\
# Covariance of the calibration's parameters: px, rad, m and their products, in the order of names.
# A rotation's three numbers turn about the rig's axes (x_right = exp(d) R x_left + t); a normal's
# two tilt it along two directions perpendicular to it. Written by `binopos calibrate`.
"""


@dataclass(frozen=True)
class ParameterCovariance:
    """names: of P parameters; matrix: (P, P) their covariance."""

    names: tuple[str, ...]
    matrix: np.ndarray

    def ordered(self, names: Sequence[str]) -> np.ndarray:
        """The covariance of `names`, zero where a name is not known here."""
        place = {name: i for i, name in enumerate(self.names)}
        wanted = np.zeros((len(names), len(names)))
        known = [i for i, name in enumerate(names) if name in place]
        own = [place[names[i]] for i in known]
        wanted[np.ix_(known, known)] = self.matrix[np.ix_(own, own)]
        return wanted

    def deviation(self, name: str) -> float:
        """The standard deviation of one parameter."""
        return float(np.sqrt(self.ordered([name])[0, 0]))


def write_covariance(path: Path, state: RigState, covariance: np.ndarray) -> None:
    """Write the covariance (P, P) of `state`'s parameters; numbers read back to the last bit."""
    lines = ['names:', *(f'- {name}' for name in state.names), 'covariance:']
    for row in covariance:
        lines.append(f'- [{", ".join(repr(float(value)) for value in row)}]')
    try:
        path.write_text(HEADER + '\n'.join(lines) + '\n', encoding='utf-8')
    except OSError as error:
        msg = f'cannot write {path}: {error.strerror}'
        raise CalibrationError(msg) from None


def read_covariance(path: Path) -> ParameterCovariance:
    """Read what `write_covariance` wrote.

    Raises:
        CalibrationError: it cannot be read, or is no covariance.
    """
    try:
        data: Any = yaml.load(
            path.read_text(encoding='utf-8'), getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
        )
    except OSError as error:
        msg = f'cannot read the covariance {path}: {error.strerror}'
        raise CalibrationError(msg) from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise CalibrationError(f'{path} is not valid YAML: calibrate again') from None
    try:
        names = tuple(str(name) for name in data['names'])
        matrix = np.array(
            [[float(value) for value in row] for row in data['covariance']], dtype=float
        )
    except (TypeError, KeyError, ValueError):
        raise CalibrationError(
            f'{path} holds no names and covariance of a calibration: calibrate again'
        ) from None
    if matrix.shape != (len(names), len(names)) or not np.isfinite(matrix).all():
        raise CalibrationError(
            f'{path}: {len(names)} names need a finite {len(names)}x{len(names)} covariance, not '
            f'one of shape {matrix.shape}: calibrate again'
        )
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0.0) or (np.diag(matrix) < 0).any():
        raise CalibrationError(f'{path}: the covariance is not symmetric: calibrate again')
    return ParameterCovariance(names, matrix)


def position_jacobians(
    state: RigState,
    points: np.ndarray,
    left_cov: np.ndarray | None = None,
    right_cov: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """How a triangulated position follows the pixels and the calibration.

    A position minimises the weighted reprojection error, so a change d of the parameters that
    moves the computed pixels by B d moves it by -(A^T W A)^-1 A^T W B d (A: pixels by position).

    Args:
        state: the rig.
        points: (N, 3) positions, rig frame (m).
        left_cov, right_cov: (N, 2, 2) or (2, 2), px^2; None means 1 px^2.

    Returns:
        (N, 3, 4) by left u, v and right u, v (m/px) and (N, 3, P) by the parameters; nan where a
        camera does not see the point.
    """
    seen = [project(state, side, points) for side in (LEFT, RIGHT)]
    by_point = np.concatenate([s.by_point for s in seen], axis=1)
    by_rig = np.concatenate([s.by_rig for s in seen], axis=1)
    weight = np.zeros((len(points), 4, 4))
    for i, cov in enumerate((left_cov, right_cov)):
        block = slice(2 * i, 2 * i + 2)
        weight[:, block, block] = np.eye(2) if cov is None else np.linalg.inv(cov)
    projected = np.swapaxes(by_point, 1, 2) @ weight
    normal = projected @ by_point
    good = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(by_rig).all(axis=(1, 2))
    by_pixels = np.full((len(points), 3, 4), np.nan)
    by_parameters = np.full((len(points), 3, by_rig.shape[2]), np.nan)
    by_pixels[good] = np.linalg.solve(normal[good], projected[good])
    by_parameters[good] = -by_pixels[good] @ by_rig[good]
    return by_pixels, by_parameters


def calibration_covariances(
    state: RigState, points: np.ndarray, covariance: ParameterCovariance
) -> np.ndarray:
    """(N, 3, 3) the positions' covariance that comes from the calibration alone (m^2)."""
    _, jacobian = position_jacobians(state, points)
    return jacobian @ covariance.ordered(state.names) @ np.swapaxes(jacobian, 1, 2)
