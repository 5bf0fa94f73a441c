"""The stages behind detection as one call: two centres in, position and filtered pose out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.parameters import build, refuse_unknown, specs_of
from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.factory import FILTERS
from binopos_ros.smoothing.stage import SmootherOptions, filter_options_type, make_smoother
from binopos_ros.smoothing.state import FilterState
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.locate import Index, Locator
from binopos_ros.triangulation.options import LocatorOptions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tracked:
    """What one pair of centres gave.

    Attributes
    ----------
    position : (3,) array
        Raw position in the rig frame (m); nan where the pair gave none.
    covariance : (3, 3) array
        Of it, all parts together (m^2); nan where there is none.
    pose : FilterState or None
        The filtered target, whose covariance holds the shared parts too; None where nothing can
        be said of it.
    reason : str
        Why the pair gave no position, or why the filter did not use it; '' where all is well.
    index : Index or None
        The refractive index that the position rests on.

    """

    position: Array
    covariance: Array
    pose: FilterState | None
    reason: str
    index: Index | None = None


class Tracker:
    """Triangulates and smooths pairs of centres: the same objects that the nodes run.

    >>> from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
    >>> camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
    >>> water = FlatInterface((0, 0, 1), 0.8, (1.0, 1.333))
    >>> rig = StereoRig(camera, camera, np.eye(3), (-0.23, 0, 0), water)
    >>> tracker = Tracker(rig)
    >>> left_px, right_px = rig.project((0.1, 0.0, 1.2))
    >>> tracked = tracker.step(0.0, left_px, right_px, 0.01 * np.eye(2), 0.01 * np.eye(2))
    >>> print(tracked.position.round(3), tracked.pose.position.round(3))
    [0.1 0.  1.2] [0.1 0.  1.2]

    Args:
        rig: cameras and surfaces.
        parameter_covariance: (K, K) of the rig's parameters, in the order of
            `rig.parameter_names`.
        options: those of the triangulator and the smoother, by the names that they have as
            parameters of the nodes (``method`` is the triangulator's; ``filter`` the smoother's;
            a dotted name such as ``index.std`` is written ``index_std``).

    Raises:
        ParameterError, TriangulationError, SmoothingError: options that cannot be.
    """

    def __init__(
        self, rig: StereoRig, parameter_covariance: ArrayLike | None = None, **options: Any
    ) -> None:
        names = {name.replace('.', '_'): name for name in specs_of(LocatorOptions)}
        smoothing = {*specs_of(SmootherOptions), *specs_of(filter_options_type(_filter(options)))}
        refuse_unknown(options, {*names, *smoothing, 'filter'})
        own = {names[key]: value for key, value in options.items() if key in names}
        rest = {key: value for key, value in options.items() if key not in names}
        if 'filter' in rest:
            rest['method'] = rest.pop('filter')
        if rig.target_index is None:
            own.setdefault('method', 'straight')
        covariance = None
        if parameter_covariance is not None:
            covariance = np.asarray(parameter_covariance, dtype=np.float64)
        self._locator = Locator(rig, build(LocatorOptions, own), covariance)
        self._smoother = make_smoother(rest)

    def step(
        self,
        stamp: float,
        left_px: ArrayLike,
        right_px: ArrayLike,
        left_cov: ArrayLike | None = None,
        right_cov: ArrayLike | None = None,
    ) -> Tracked:
        """Take one pair of centres in.

        Parameters
        ----------
        stamp : float
            Of the pair (s).
        left_px, right_px : (2,) array
            The target's centre in both images (px).
        left_cov, right_cov : (2, 2) array, optional
            Their covariances (px^2); the identity where they are not given.

        Raises
        ------
        TriangulationError
            Arrays whose shapes do not fit.

        """
        pixels = [
            _shaped(each, (2,), name)
            for each, name in ((left_px, 'left_px'), (right_px, 'right_px'))
        ]
        covs = [
            _shaped(np.eye(2) if each is None else each, (2, 2), name)
            for each, name in ((left_cov, 'left_cov'), (right_cov, 'right_cov'))
        ]
        place = self._locator.locate(stamp, (pixels[0], pixels[1], covs[0], covs[1]))
        if isinstance(place, str):
            nothing = np.full((3, 3), np.nan)
            return Tracked(nothing[0], nothing, None, place)
        covariance = place.covariance
        pose, reason = self._smoother.add(
            round(stamp * 1e9), place.point, covariance, place.systematic, place.medium
        )
        state = None if pose is None else pose.state
        return Tracked(place.point, covariance, state, reason, place.index)

    def reset(self) -> None:
        """Forget the target; what is known of the index and the medium stays."""
        self._smoother.reset()


def _filter(options: Mapping[str, Any]) -> str:
    name = options.get('filter', SmootherOptions().method)
    if name not in FILTERS:
        msg = f'no filter is named {name!r}; known are {", ".join(FILTERS)}'
        raise SmoothingError(msg)
    return str(name)


def _shaped(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        msg = f'{name} must have the shape {shape}, not {array.shape}'
        raise TriangulationError(msg)
    return array
