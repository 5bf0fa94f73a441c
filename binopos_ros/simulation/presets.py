"""Ready-made scenes: the paper's washbowl, and a robot's pair of flat ports or of domes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.lens import BROWN, EQUIDISTANT
from binopos_ros.simulation.backdrop import Basin, OpenWater, mottled, strew
from binopos_ros.simulation.boards import Board, scatter
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.medium import Boundary, plane_axes
from binopos_ros.simulation.rig_motion import Odometer, SeenFromRobot, rig_motion
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Sensor
from binopos_ros.simulation.target import Disc, HarmonicPath, Path, SwungPath, harmonic_path
from binopos_ros.simulation.water import Water
from binopos_ros.simulation.waves import waves_of_peak

Array = NDArray[np.float64]
T = TypeVar('T')

#: Table 1 of the paper: k1, k2, k3, k4, which are k1, k2, p1, p2 in OpenCV's order.
TABLE_1 = ((-0.307, 0.729, 0.048, 0.013), (-0.298, 0.715, 0.049, 0.014))
#: Table 2: the principal points, px.
TABLE_2 = ((626.222, 494.304), (628.112, 486.102))
#: Table 2's ratio of fv to fu; its fu itself cannot be meant.
ASPECT = (2.99419 / 2.97944, 2.99325 / 2.97926)

FRESH_WATER = 1.333
#: What salt water can reach: saturated brine.
DENSEST_BRINE = 1.38


@dataclasses.dataclass(frozen=True)
class Choices:
    """What a user may change about a preset; None leaves it as the preset has it.

    Attributes:
        seed: of everything random: textures, waves, noise.
        waves: standard deviation of the water's height, m.
        wave_peak: frequency of the highest waves, Hz.
        salt: refractive index at the bottom, rising steadily from fresh water at the surface.
        path: one of `target.PATHS`.
        period: of one round of the path, s.
        swing: amplitude of the rig's own swing about its vertical axis, rad; not before a surface,
            which would swing with it.
        swing_period: of that swing, s.
        motion: of a robot that carries the rig, one of `rig_motion.MOTIONS`; not before a surface.
        odometer: what that robot knows of its pose.
        diameter: of the disc, m.
        distractors: number of coloured things that are no target.
        noise, quality, blur, encoding: of the sensor.
        rate: pairs per second.
    """

    seed: int = 0
    waves: float | None = None
    wave_peak: float | None = None
    salt: float | None = None
    path: str | None = None
    period: float | None = None
    swing: float | None = None
    swing_period: float = 1.0
    motion: str | None = None
    odometer: Odometer = dataclasses.field(default_factory=Odometer)
    diameter: float | None = None
    distractors: int | None = None
    noise: float | None = None
    quality: int | None = None
    blur: float | None = None
    encoding: str | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.seed < 0:
            msg = f'the seed is {self.seed}: give 0 or more'
            raise SimulationError(msg)
        if self.salt is not None and not FRESH_WATER <= self.salt <= DENSEST_BRINE:
            msg = (
                f'salt water of index {self.salt!r} does not exist: give {FRESH_WATER} (fresh) to '
                f'{DENSEST_BRINE} (saturated brine)'
            )
            raise SimulationError(msg)
        if self.distractors is not None and not 0 <= self.distractors <= 50:
            msg = f'{self.distractors} distractors: give 0 to 50'
            raise SimulationError(msg)

    def rng(self, purpose: int) -> np.random.Generator:
        """A stream of random numbers for one purpose."""
        return np.random.default_rng([self.seed, purpose])


def _chosen(value: T | None, preset: T) -> T:
    return preset if value is None else value


TEXTURES, WAVES, BOARDS, MOTION = range(4)
SALT_LAYERS = 20


def salt_gradient(
    top: float, bottom: float, depth: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Indices and thicknesses (m) of thin layers for an index that rises linearly with depth."""
    middles = (np.arange(SALT_LAYERS) + 0.5) / SALT_LAYERS
    indices = tuple(float(value) for value in top + (bottom - top) * middles)
    # The last layer goes on below the floor: it needs no thickness.
    return indices, (depth / SALT_LAYERS,) * (SALT_LAYERS - 1)


def washbowl(choices: Choices = Choices(), half_size: bool = False) -> Scene:  # noqa: B008
    """The paper's rig (Sec. 5): two cameras 230 mm apart over a bowl, a red disc on its bottom.

    The water's surface lies 0.8 m below the left camera and the water is 0.49 m deep. The rig
    hangs a little askew, as rigs do: the surface's normal is 4 degrees off the optical axis.

    Args:
        choices: what to change.
        half_size: pictures of 640x480 with a shorter focal length, instead of 1280x960.
    """
    if choices.swing is not None:
        msg = 'a rig that swings over water moves the surface before it: swing one behind ports'
        raise SimulationError(msg)
    if choices.motion is not None:
        msg = 'a robot takes the rig along, and leaves the surface: let it carry one behind ports'
        raise SimulationError(msg)
    focal, size, shrink = (600.0, (640, 480), 0.5) if half_size else (900.0, (1280, 960), 1.0)
    cameras = [
        _camera(focal, focal * aspect, shrink * u, shrink * v, terms, size)
        for terms, (u, v), aspect in zip(TABLE_1, TABLE_2, ASPECT, strict=True)
    ]
    normal = np.array([0.03, 0.06, 1.0])
    normal /= np.sqrt(normal @ normal)
    distance, depth = 0.8, 0.49
    indices: tuple[float, ...] = (FRESH_WATER,)
    thicknesses: tuple[float, ...] = ()
    if choices.salt is not None:
        indices, thicknesses = salt_gradient(FRESH_WATER, choices.salt, depth)
    interface = FlatInterface(normal, distance, (1.0, *indices), thicknesses)
    rig = StereoRig(cameras[0], cameras[1], np.eye(3), [-0.23, 0, 0], interface)

    first, second = plane_axes(normal)
    # The bowl stands where the two cameras look.
    aim = np.array([0.115, 0.0, 0.0]) + (distance - 0.115 * normal[0]) / normal[2] * np.eye(3)[2]
    centre = np.array([aim @ first, aim @ second])
    radius = 0.30
    rng = choices.rng(TEXTURES)
    # Small pictures go without the finest patches, which would make up most of their JPEG.
    patches = (6, 14, 40) if half_size else (6, 14, 40, 110)
    floor = mottled(rng, 1024, (0.55, 0.58, 0.56), 0.05, patches)
    strew(floor, rng, _chosen(choices.distractors, 4), 0.62, 0.85, 0.07)
    table = mottled(rng, 1024, (0.34, 0.30, 0.27), 0.03 if half_size else 0.12, patches)
    water = Water()
    basin = Basin(
        Boundary(normal, distance, 1.0, indices[0]), depth, centre, radius, floor, table, water
    )
    # A disc 2 mm thick on the floor.
    bottom = centre[0] * first + centre[1] * second + (distance + depth - 0.002) * normal
    path = harmonic_path(
        _chosen(choices.path, 'figure-eight'),
        bottom,
        -normal,
        np.array([0.10 * first, 0.06 * second]),
        _chosen(choices.period, 10.0),
    )
    waves = None
    if choices.waves:
        spectrum = waves_of_peak(choices.waves, _chosen(choices.wave_peak, 2.5), depth)
        waves = spectrum.realise(choices.rng(WAVES))
    return Scene(
        rig=rig,
        water=water,
        backdrop=basin,
        path=path,
        target=Disc(_chosen(choices.diameter, 0.06 if half_size else 0.05)),
        sensor=_sensor(choices, Sensor(noise=1.0, quality=70) if half_size else Sensor()),
        waves=waves,
        rate=_chosen(choices.rate, 30.0),
    )


def _camera(
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    terms: tuple[float, ...],
    size: tuple[int, int],
    model: str = BROWN,
) -> PinholeCamera:
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return PinholeCamera(matrix, terms, size, model)


def _seen(path: HarmonicPath, choices: Choices) -> Path:
    """The path as the rig sees it that swings, or that a robot carries."""
    if choices.motion is not None:
        if choices.swing is not None:
            msg = 'a rig that swings and one that a robot carries: leave one of the two out'
            raise SimulationError(msg)
        return SeenFromRobot(path, rig_motion(choices.motion, choices.rng(MOTION)))
    if choices.swing is None:
        return path
    return SwungPath(path, choices.swing, choices.swing_period)


def _sensor(choices: Choices, preset: Sensor) -> Sensor:
    return dataclasses.replace(
        preset,
        noise=_chosen(choices.noise, preset.noise),
        quality=_chosen(choices.quality, preset.quality),
        blur=_chosen(choices.blur, preset.blur),
        encoding=_chosen(choices.encoding, preset.encoding),
    )


def ports(choices: Choices = Choices()) -> Scene:  # noqa: B008
    """An inspection robot's two cameras, each behind its own flat glass port, in coastal water.

    10 mm of glass 35 mm before each camera, no two tilted alike; a disc swims about a metre ahead.
    """
    left = _camera(810.0, 811.2, 642.3, 476.8, (-0.11, 0.07, 0.0006, -0.0004), (1280, 960))
    right = _camera(806.5, 807.4, 633.1, 483.9, (-0.108, 0.066, -0.0005, 0.0007), (1280, 960))
    indices, thickness = (1.0, 1.517, 1.335), (0.010,)
    return _robot(
        choices,
        (left, right),
        FlatInterface([0.012, -0.008, 1.0], 0.035, indices, thickness),
        FlatInterface([-0.009, 0.011, 1.0], 0.036, indices, thickness),
    )


def domes(choices: Choices = Choices()) -> Scene:  # noqa: B008
    """The same robot with wide lenses behind domes of acrylic, no two centred alike."""
    terms = ((0.012, -0.006, 0.002, -0.0003), (0.010, -0.005, 0.0017, -0.0002))
    size = (1280, 960)
    left = _camera(620.0, 620.9, 642.3, 476.8, terms[0], size, EQUIDISTANT)
    right = _camera(618.5, 619.2, 633.1, 483.9, terms[1], size, EQUIDISTANT)
    indices = (1.0, 1.49, 1.335)
    return _robot(
        choices,
        (left, right),
        DomePort([0.0012, -0.0008, 0.0031], 0.050, 0.005, indices),
        DomePort([-0.0015, 0.0006, 0.0018], 0.050, 0.005, indices),
    )


def _robot(
    choices: Choices,
    cameras: tuple[PinholeCamera, PinholeCamera],
    left_port: Interface,
    right_port: Interface,
) -> Scene:
    if choices.waves or choices.salt is not None:
        msg = 'waves and a salt gradient belong to a water surface: the ports have none'
        raise SimulationError(msg)
    yaw, roll = np.deg2rad(2.0), np.deg2rad(0.4)
    rotation = np.array(
        [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    ) @ np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    translation = -rotation @ np.array([0.12, 0.001, -0.0015])
    rig = StereoRig(*cameras, rotation, translation, left_port=left_port, right_port=right_port)
    rng = choices.rng(TEXTURES)
    bed = mottled(rng, 2048, (0.26, 0.30, 0.29), 0.15)
    strew(bed, rng, _chosen(choices.distractors, 8), 0.18, 0.45, 0.02)
    water = Water(absorption=(0.06, 0.05, 0.33), scattering=0.12, veil=(62.0, 58.0, 22.0))
    down = np.array([0.0, 1.0, 0.15])
    down /= np.sqrt(down @ down)
    path = harmonic_path(
        _chosen(choices.path, 'figure-eight'),
        np.array([0.06, 0.0, 1.05]),
        np.array([0.0, 0.0, -1.0]),
        np.array([[0.20, 0.05, 0.10], [0.0, 0.08, 0.22]]),
        _chosen(choices.period, 8.0),
        nod=0.25,
    )
    return Scene(
        rig=rig,
        water=water,
        backdrop=OpenWater(down, 0.75, bed, water),
        path=_seen(path, choices),
        target=Disc(_chosen(choices.diameter, 0.08)),
        sensor=_sensor(choices, Sensor(exposure=2.3, blur=0.7)),
        rate=_chosen(choices.rate, 30.0),
        odometer=choices.odometer,
    )


def demo(choices: Choices = Choices()) -> Scene:  # noqa: B008
    """The washbowl in small pictures."""
    return washbowl(choices, half_size=True)


def in_air(scene: Scene, seed: int) -> Scene:
    """The same cameras before a wall two metres away, with nothing in between."""
    rig = StereoRig(scene.rig.left, scene.rig.right, scene.rig.rotation, scene.rig.translation)
    clear = Water(absorption=(0.0, 0.0, 0.0), scattering=0.0, veil=(0.0, 0.0, 0.0))
    wall = mottled(np.random.default_rng([seed, TEXTURES]), 1024, (0.40, 0.42, 0.44), 0.10)
    return dataclasses.replace(
        scene,
        rig=rig,
        water=clear,
        backdrop=OpenWater(np.array([0.0, 0.0, 1.0]), 2.0, wall, clear),
        waves=None,
    )


def with_board(scene: Scene, board: Board, count: int, seed: int, hold: float = 0.0) -> Scene:
    """The scene with a calibration board in `count` pairs.

    It is at another place and tilt in each of them, or stays at each for `hold` seconds.

    Raises:
        SimulationError: the board does not fit into both pictures.
    """
    if isinstance(scene.backdrop, Basin):
        top = scene.backdrop.surface.distance
        reach = (top + 0.05, top + scene.backdrop.depth - 0.05)
    else:
        reach = (0.4, 1.0)
    rng = np.random.default_rng([seed, BOARDS])
    held = max(round(hold * scene.rate), 1)
    places = -(-count // held)
    shown = scatter(board, scene.views, scene.backdrop, places, reach, scene.rate, rng, held)
    return dataclasses.replace(scene, path=shown, target=shown)


@dataclasses.dataclass(frozen=True)
class Preset:
    """A function that makes a scene from a user's choices, and how many pairs it has by itself."""

    make: Callable[[Choices], Scene]
    pairs: int


PRESETS = {
    'washbowl': Preset(washbowl, 300),
    'ports': Preset(ports, 300),
    'domes': Preset(domes, 300),
    'demo': Preset(demo, 150),
}
