"""The calibration's own uncertainty: stored beside the calibration.

The file names each parameter as `RigState.names` does, so `ordered(rig.parameter_names)` is what
`triangulate` takes as `parameter_covariance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from binopos_ros import plain_yaml
from binopos_ros.optics.calibration_text import write_lines
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.rig_state import RigState

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
    lines = [*HEADER.splitlines(), 'names:', *(f'- {name}' for name in state.names), 'covariance:']
    # Rounding leaves the two halves a little apart, where one deviation is far below another.
    for row in 0.5 * (covariance + covariance.T):
        lines.append(f'- [{", ".join(repr(float(value)) for value in row)}]')
    write_lines(path, lines)


def read_covariance(path: Path) -> ParameterCovariance:
    """Read what `write_covariance` wrote.

    Raises:
        OpticsError: it cannot be read, or is no covariance.
    """
    if path.exists() and not path.is_file():
        raise OpticsError(f'cannot read the covariance {path}: it is no file')
    try:
        data = plain_yaml.load(path.read_text(encoding='utf-8'))
    except OSError as error:
        msg = f'cannot read the covariance {path}: {error.strerror}'
        raise OpticsError(msg) from None
    except (plain_yaml.PlainYamlError, UnicodeDecodeError):
        raise OpticsError(f'{path} is not valid YAML: calibrate again') from None
    try:
        names = tuple(str(name) for name in data['names'])
        matrix = np.array(
            [[float(value) for value in row] for row in data['covariance']], dtype=float
        )
    except (TypeError, KeyError, ValueError):
        raise OpticsError(
            f'{path} holds no names and covariance of a calibration: calibrate again'
        ) from None
    if matrix.shape != (len(names), len(names)) or not np.isfinite(matrix).all():
        raise OpticsError(
            f'{path}: {len(names)} names need a finite {len(names)}x{len(names)} covariance, not '
            f'one of shape {matrix.shape}: calibrate again'
        )
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0.0) or (np.diag(matrix) < 0).any():
        raise OpticsError(f'{path}: the covariance is not symmetric: calibrate again')
    return ParameterCovariance(names, matrix)
