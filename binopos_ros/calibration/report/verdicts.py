"""What an interface calibration knows, parameter by parameter, in plain words.

A parameter is *determined* when its standard deviation is small enough for positions, *weakly
determined* when the pictures improve on what was known but not enough, and *not determined* when
it rests on the prior. The advice looks at the geometry: the index shows where the rays' angles of
incidence and the depths vary, which a flat-on board does not offer (on simulated rigs: sigma 0.11
from a flat board, 0.006 tilted by 45 degrees, 0.0023 from ten mixed tilts).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.interface.calibrate import InterfaceCalibration
from binopos_ros.calibration.interface.guesses import GAS
from binopos_ros.calibration.report.domes import dome_verdict
from binopos_ros.calibration.views.pairs import coverage
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import TARGET_INDEX

DETERMINED, WEAK, PRIOR = 'determined', 'weakly determined', 'not determined'
NOT_WORTH = 'not worth estimating'
IRRELEVANT = 'does not matter'
IMPROVED = 0.7  # times the prior's deviation: above it the pictures added next to nothing
WANTED = {TARGET_INDEX: 0.005, 'normal': np.radians(0.2), 'distance': 0.006, 'centre': 0.0005}
LAYER_WANTED = {'thicknesses': 0.02, 'indices': 0.02, 'radius': 0.02}  # parts of the value
FEW_VIEWS = 8
LITTLE_TILT = 25.0  # degrees
EMPTY = 0.5  # of the pictures' parts
SHALLOW = 0.15  # of the nearest board's distance
#: A target of known size gives its place and its size, four numbers each time and three of them
#: for its place; the bound of 20 places at 0.1 px is 0.03 for the index, of 60 places 0.014.
BALL_REMEDIES = {
    '': 'a target of known size hardly shows it, however many places; give what the temperature '
    'and the salinity of the water make it (--prior target_index=1.333,0.0005), or show a board',
    'distance': 'measure the distance with a ruler and give it as a prior, or show a board',
    'normal': 'show the target at more places, farther apart, or show a board',
    'centre': 'show a board',
}


@dataclass(frozen=True)
class Verdict:
    """One parameter.

    Attributes:
        name: as in `RigState.names`.
        value, deviation: in SI units; a normal's value is its tilt from the optical axis (rad).
        grade: `DETERMINED`, `WEAK`, `PRIOR`, `NOT_WORTH` or `IRRELEVANT`.
        text: a sentence for people.
    """

    name: str
    value: float
    deviation: float
    grade: str
    text: str

    @property
    def value_in_words(self) -> str:
        """The value with its unit."""
        if '.normal.' in self.name:
            return f'{np.degrees(self.value):.2f} degrees off the optical axis'
        if _is_length(self.name):
            return f'{1000 * self.value:.2f} mm'
        return f'{self.value:.5f}'

    @property
    def spread_in_words(self) -> str:
        """The standard deviation with its unit."""
        return _spread_in_words(self.name, self.deviation)


def verdicts(calibration: InterfaceCalibration) -> list[Verdict]:
    """Judge every parameter of the interfaces."""
    found = []
    domes = {
        place: verdict
        for place in calibration.state.interfaces
        if (verdict := dome_verdict(calibration, place))
    }
    for name in calibration.interface_names:
        deviation = calibration.deviation(name)
        prior = calibration.prior[name]
        value = _value(calibration, name)
        wanted = _wanted(name, value)
        pictures = deviation < IMPROVED * prior
        if name.endswith('.distance') and _is_of_a_plate(calibration, name):
            grade = IRRELEVANT
        elif deviation <= wanted and (pictures or prior <= wanted):
            grade = DETERMINED
        elif pictures:
            grade = WEAK
        else:
            grade = PRIOR
        text = _sentence(calibration, name, deviation, grade, pictures)
        place, _, parameter = name.partition('.')
        if parameter.startswith('centre') and place in domes:
            grade, text = NOT_WORTH, domes[place]
        found.append(Verdict(name, value, deviation, grade, text))
    return found


def advice(calibration: InterfaceCalibration) -> str:
    """The next thing to do, or that nothing needs doing."""
    worst = [verdict for verdict in verdicts(calibration) if verdict.grade in (WEAK, PRIOR)]
    worst = [v for v in worst if v.name.split('.')[-2:-1] not in (['thicknesses'], ['indices'])]
    worst = [v for v in worst if not _is_of_a_plate(calibration, v.name)]
    if not worst:
        return 'Nothing must be done: every parameter that positions depend on is determined.' + (
            _still_better(calibration)
        )
    return worst[0].text


def _still_better(calibration: InterfaceCalibration) -> str:
    """Whether more of the pictures should be filled: it helps more than anything else."""
    fit = calibration.adjustment
    boards = [view for view in calibration.views if view.turns]
    if fit is None or not boards:
        return ''
    empty = []
    for side, camera in enumerate(fit.state.cameras):
        seen = np.concatenate([view.pixels[side] for view in boards])
        empty.append(float(np.mean(coverage(seen, camera.size) == 0)))
    if min(empty) < EMPTY:
        return ''
    return (
        f' Better still: hold the board in the outer parts of the pictures as well '
        f'({100 * min(empty):.0f} % of their parts hold no point).'
    )


def _value(calibration: InterfaceCalibration, name: str) -> float:
    place, _, parameter = name.partition('.')
    if name == TARGET_INDEX:
        return calibration.state.target_index
    interface = calibration.state.interfaces[place]
    kind, _, number = parameter.partition('.')
    if kind == 'normal':
        return float(np.arccos(np.clip(interface.axis[2], -1.0, 1.0)))
    return float(np.ravel(interface.written[kind])[int(number or 0)])


def _wanted(name: str, value: float) -> float:
    parts = name.split('.')
    if parts[-1] in WANTED:
        return WANTED[parts[-1]]
    if parts[1] in WANTED:
        return WANTED[parts[1]]
    return LAYER_WANTED[parts[1]] * abs(value)


def _sentence(
    calibration: InterfaceCalibration, name: str, deviation: float, grade: str, pictures: bool
) -> str:
    what = _name_in_words(name)
    spread = _spread_in_words(name, deviation)
    if grade == DETERMINED:
        source = 'by these pictures' if pictures else 'by what you measured'
        return f'{what} is determined {source} to {spread}.'
    if grade == IRRELEVANT:
        return (
            f'{what} does not matter: a plate with one medium on both sides only shifts the rays, '
            'alike wherever it stands.'
        )
    if not calibration.views:
        return f'{what} rests on what you measured, {spread}: take pictures to do better.'
    lead = (
        f'{what} is not determined by these pictures and rests on what was assumed, {spread}'
        if grade == PRIOR
        else f'{what} is determined only to {spread}'
    )
    return f'{lead}: {_remedy(calibration, name)}.'


def _remedy(calibration: InterfaceCalibration, name: str) -> str:
    parameter = name.partition('.')[2]
    if parameter.startswith(('thicknesses', 'indices')):
        return (
            'what lies around it makes up for it, so positions hardly suffer; measure it with a '
            'caliper'
        )
    if _is_of_a_plate(calibration, name):
        return (
            'a plate with one medium on both sides only shifts the rays by parts of a millimetre, '
            'so positions hardly suffer'
        )
    views = calibration.views
    poses = calibration.adjustment.poses if calibration.adjustment else ()
    boards = [(v, p) for v, p in zip(views, poses, strict=True) if v.turns]
    interface = calibration.state.interfaces[calibration.state.last_places[0]]
    if boards:
        tilts = tilt_angles([pose for _, pose in boards], interface.axis)
        if tilts.max() < LITTLE_TILT:
            return (
                f'tilt the board by 30-45 degrees against the surface (here {tilts.min():.0f} to '
                f'{tilts.max():.0f} degrees)'
            )
    depths = depth_range(views, poses, interface.axis)
    if depths[1] - depths[0] < SHALLOW * depths[0]:
        return (
            f'show the target at other depths as well (here {1000 * depths[0]:.0f} to '
            f'{1000 * depths[1]:.0f} mm from the camera)'
        )
    if not boards:
        return BALL_REMEDIES[parameter.partition('.')[0]]
    if len(views) < FEW_VIEWS:
        return f'take more views, {len(views)} are few: ten with mixed tilts are good'
    if parameter == 'distance':
        return 'measure the distance with a ruler and give it as a prior, or take more views'
    return 'fill more of both pictures with the board, nearer and towards the corners'


def _is_of_a_plate(calibration: InterfaceCalibration, name: str) -> bool:
    """Whether a parameter belongs to a port with the same medium on both sides."""
    interface = calibration.state.interfaces.get(name.partition('.')[0])
    return interface is not None and abs(interface.indices[0] - interface.indices[-1]) < GAS - 1.0


def tilt_angles(poses: Sequence[Pose], normal: np.ndarray) -> np.ndarray:
    """(V,) angles between the boards and the interface (degrees)."""
    cosine = np.array([abs(float(pose.rotation[:, 2] @ normal)) for pose in poses])
    return np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))


def depth_range(
    views: Sequence[View], poses: Sequence[Pose], normal: np.ndarray
) -> tuple[float, float]:
    """The nearest and the farthest point seen, along the normal (m)."""
    depth = [pose.apply(view.points) @ normal for view, pose in zip(views, poses, strict=True)]
    return float(min(d.min() for d in depth)), float(max(d.max() for d in depth))


def _name_in_words(name: str) -> str:
    if name == TARGET_INDEX:
        return "The refractive index of the target's medium"
    place, parameter = name.split('.', 1)
    where = {
        'interface': 'the surface',
        'left_port': 'the left port',
        'right_port': 'the right port',
    }[place]
    if parameter in ('distance', 'radius'):
        return f'The {parameter} of {where}'
    kind, number = parameter.split('.')
    if kind == 'normal':
        axis = ('first', 'second')[int(number)]
        return f'The normal of {where} (about its {axis} axis)'
    if kind == 'centre':
        return f"The centre of {where}'s dome (along {'xyz'[int(number)]})"
    layer = {'thicknesses': int(number) + 1, 'indices': int(number)}[kind]
    words = {'thicknesses': 'thickness', 'indices': 'refractive index'}[kind]
    return f'The {words} of layer {layer} of {where}'


def _spread_in_words(name: str, deviation: float) -> str:
    if 'normal' in name:
        return f'{np.degrees(deviation):.2f} degrees'
    if _is_length(name):
        return f'{1000 * deviation:.2g} mm'
    return f'{deviation:.2g}'


def _is_length(name: str) -> bool:
    return any(kind in name for kind in ('distance', 'thicknesses', 'centre', 'radius'))
