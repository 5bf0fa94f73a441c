"""Scenes with known truth, rendered by tracing light backwards.

Nothing here uses the projection of `optics`: the pictures test it.

>>> scene = washbowl(Choices(seed=3, path='still'))
>>> left, right = scene.measurements(scene.times(2))
>>> print(left.shape, bool((left[0] == left[1]).all()))
(2, 2) True
"""

from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.presets import PRESETS, Choices, ports, washbowl
from binopos_ros.simulation.render import Renderer
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import Sensor
from binopos_ros.simulation.target import Disc, harmonic_path
from binopos_ros.simulation.water import Water
from binopos_ros.simulation.waves import WaveField, WaveSpectrum

__all__ = [
    'PRESETS',
    'Choices',
    'Disc',
    'Renderer',
    'Scene',
    'Sensor',
    'SimulationError',
    'Water',
    'WaveField',
    'WaveSpectrum',
    'harmonic_path',
    'ports',
    'washbowl',
]
