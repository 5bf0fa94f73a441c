"""What is known of a rig's errors: calibrated, stated by its owner, or a default.

A rig that was measured by hand is not exact: a port that is off by a degree moves positions by
centimetres, and nothing in the pictures shows it. So there are defaults, of what a ruler, a
protractor and a printed board do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.triangulation.options import TriangulatorOptions

Array = NDArray[np.float64]

#: The parameters of an interface that an option's deviation is of.
AXES = {
    'normal_std': ('normal.0', 'normal.1'),
    'distance_std': ('distance',),
    'centre_std': ('centre.0', 'centre.1', 'centre.2'),
}


class Stated(NamedTuple):
    """(K, K) covariance of a rig's parameters; the options whose defaults it rests on."""

    covariance: Array
    defaults: tuple[str, ...]


def stated_errors(
    options: TriangulatorOptions, rig: StereoRig, calibration: ParameterCovariance | None
) -> Stated:
    """What is known of a rig's errors: from its calibration, else from what the options state.

    Args:
        options: with the interfaces of the rig.
        rig: whose `parameter_names` give the order; an `UncertainRig`.
        calibration: the covariance that was calibrated, of some or all of the parameters.

    """
    names = list(rig.parameter_names)
    calibrated = calibration.names if calibration else ()
    covariance = calibration.ordered(names) if calibration else np.zeros((len(names),) * 2)
    defaults = []
    for place, given in options.places.items():
        if any(name.startswith(f'{place}.') for name in calibrated):
            continue
        for option, std in given.deviations.items():
            for axis in AXES[option]:
                at = names.index(f'{place}.{axis}')
                covariance[at, at] = std.value**2
            if not std.stated:
                defaults.append(f'{place}.{option}')
    if 'translation.x' not in calibrated:
        along = [names.index(f'translation.{axis}') for axis in 'xyz']
        std = options.baseline_deviation
        error = std.value * rig.translation
        covariance[np.ix_(along, along)] += np.outer(error, error)
        if not std.stated:
            defaults.append('baseline_std')
    return Stated(covariance, tuple(defaults))
