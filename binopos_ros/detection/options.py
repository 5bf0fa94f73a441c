"""The detector's options; the nodes declare their ROS parameters from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from binopos_ros.parameters import check_options, option

from .errors import DetectionError

METHODS = ('subpixel', 'paper')
SHAPES = ('any', 'disc', 'ball')


@dataclass(frozen=True)
class TargetOptions:
    """What the target is. Raises DetectionError for a shape that is not known."""

    shape: Literal['any', 'disc', 'ball'] = option(
        'any',
        'Ball: refuse outlines that are not round; disc: rank a tilted one like one that is not; '
        'any: neither',
        choices=SHAPES,
    )

    def __post_init__(self) -> None:
        check_options(self, DetectionError)


@dataclass(frozen=True)
class DetectorOptions:
    """How to find the target. Raises DetectionError where a value is out of its range."""

    method: Literal['subpixel', 'paper'] = option(
        'subpixel',
        'subpixel: red against its surroundings, centre to hundredths of a pixel; paper: R and G '
        'against fixed levels, middle of the four extremes',
        choices=METHODS,
    )
    min_diameter: float = option(
        6.0, 'Smallest major axis of the outline of a target', 'px', (3.0, 4000.0)
    )
    max_diameter: float = option(
        1000.0, 'Largest major axis of the outline of a target', 'px', (3.0, 4000.0)
    )
    min_axis_ratio: float = option(
        0.2,
        'Smallest ratio of minor to major axis: a disc tilted by t shows about cos(t)',
        '',
        (0.05, 1.0),
    )
    min_fit: float = option(
        0.8,
        'Smallest share in which the patch and the ellipse of its moments agree',
        '',
        (0.0, 1.0),
    )
    min_seen: float = option(
        0.4,
        'Smallest share of a round outline that is seen where something hides the rest',
        '',
        (0.2, 1.0),
    )
    min_redness: float = option(
        -0.12,
        'Smallest redness (R - G) / (R + G + B) of a target; below 0 it may look orange or grey',
        '',
        (-1.0, 1.0),
    )
    max_yellow: float = option(
        0.9,
        'Largest yellowness (G - B) / (R + G + B), carried on to a full red, less the share of it '
        'that is left: more is a yellow or an orange thing',
        '',
        (0.0, 10.0),
    )
    max_blue: float = option(
        0.25,
        'Largest such yellowness below 0: more is a pink or a violet thing',
        '',
        (0.0, 10.0),
    )
    min_contrast: float = option(
        0.12,
        'Smallest difference of redness between a target and its surroundings',
        '',
        (0.0, 2.0),
    )
    noise_factor: float = option(
        6.0,
        'Smallest such difference as a multiple of the noise of redness in the image',
        '',
        (0.0, 100.0),
    )
    mirror_above: bool = option(
        True,
        'Refuse the upper of two like patches, one above the other: seen from under water it is '
        "the target's mirror image in the surface",
    )
    track: bool = option(
        True, 'Search a window about the predicted place first; all of the image only when lost'
    )
    target: TargetOptions = field(default_factory=TargetOptions)
    paper_red: int = option(
        168, 'method paper: a red pixel has R above this', 'grey levels', (0, 255)
    )
    paper_green: int = option(
        50, 'method paper: a red pixel has G below this', 'grey levels', (0, 255)
    )

    def __post_init__(self) -> None:
        check_options(self, DetectionError)
        if self.min_diameter > self.max_diameter:
            msg = (
                f'min_diameter is {self.min_diameter} and max_diameter {self.max_diameter}: '
                f'the smallest must not exceed the largest'
            )
            raise DetectionError(msg)
