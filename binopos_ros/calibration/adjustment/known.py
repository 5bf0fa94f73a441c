"""A covariance from an earlier calibration as what is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from binopos_ros.optics.covariance_file import ParameterCovariance


def information_of(
    covariance: ParameterCovariance, names: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """What a covariance tells of parameters.

    Args:
        covariance: of any parameters.
        names: of P parameters; one that it does not hold, as '', is told nothing of.

    Returns:
        (P,) which of them are uncertain, and (P, P) the information on those.
    """
    known = covariance.ordered(names)
    uncertain = np.diag(known) > 0
    block = known[np.ix_(uncertain, uncertain)]
    scale = np.sqrt(np.diag(block))
    inverse = np.linalg.pinv(block / np.outer(scale, scale), hermitian=True)
    information = np.zeros((len(names), len(names)))
    information[np.ix_(uncertain, uncertain)] = inverse / np.outer(scale, scale)
    return uncertain, information
