"""A scene's calibration and its interface, as the files that nodes and offline verbs take."""

from __future__ import annotations

import math
from pathlib import Path

from binopos_ros.optics import CameraInfo, DomePort, write_camera_info
from binopos_ros.optics.rig_files import interface_block, yaml_numbers
from binopos_ros.sides import SIDES
from binopos_ros.simulation.rig_motion import FIXED_FRAME, SeenFromRobot, mounting
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.target import Disc

#: Basins have no slower waves (rad/s).
_BASIN = 2.0 * math.pi * 1.5


def write_calibration(
    scene: Scene, infos: tuple[CameraInfo, CameraInfo], bag: Path, more: str = ''
) -> None:
    """Write the parameter file and the camera_info files into a bag's folder, or beside it.

    `more` are further blocks of the parameter file.
    """
    single = bag.suffix == '.mcap'
    folder, prefix = (bag.parent, f'{bag.stem}.') if single else (bag, '')
    for side, info in zip(SIDES, infos, strict=True):
        write_camera_info(folder / f'{prefix}{side}.yaml', info)
    (folder / f'{prefix}binopos.yaml').write_text(parameter_file(scene) + more, encoding='utf-8')


def parameter_file(scene: Scene) -> str:
    """The nodes' parameters for a scene, as ROS 2 parameter file."""
    rig = scene.rig
    lines = [
        '# What the cameras of this bag look through, and at. Made by `binopos simulate`.',
        '/**/triangulator:',
        '  ros__parameters:',
    ]
    blocks = {
        'interface': (rig.interface, 'rig frame'),
        'left_port': (rig.left_port, "left camera's frame"),
        'right_port': (rig.right_port, "right camera's frame"),
    }
    exact = ['# It was rendered: nothing of it is uncertain.', '/**:', '  ros__parameters:']
    exact.append('    baseline_std: 0.0')
    for name, (interface, frame) in blocks.items():
        if interface is not None:
            remarks = {'normal': frame, 'centre': f'{frame}, m'}
            remarks |= dict.fromkeys(('distance', 'radius', 'thicknesses'), 'm')
            lines += interface_block(name, interface, remarks)
            is_dome = isinstance(interface, DomePort)
            stds = ('centre_std',) if is_dome else ('normal_std', 'distance_std')
            exact += [f'    {name}.{std}: 0.0' for std in stds]
    if rig.interface is not None and not rig.interface.thicknesses and not _swells(scene):
        lines.append('    medium: basin  # no room for swell; auto: there may be')
    if not any(interface for interface, _ in blocks.values()):
        lines.append("    method: 'straight'")
    if isinstance(scene.target, Disc):
        normal = scene.path.poses(0.0)[1][0]
        lines += [
            '    target:',
            f'      diameter: {scene.target.diameter!r}  # m',
            f'      normal: {yaml_numbers(normal)}  # rig frame, at the start',
        ]
    if isinstance(scene.path, SeenFromRobot):
        lines += [
            '# The robot that carries the cameras; without these, poses are in the rig frame.',
            '/**/smoother:',
            '  ros__parameters:',
            f'    fixed_frame: {FIXED_FRAME}',
            '    platform:',
            '      source: odometry  # or tf: the bag has both',
            f'      mounting: {yaml_numbers(mounting())}  # x, y, z in m, qx, qy, qz, qw',
        ]
    return '\n'.join([*lines, *exact]) + '\n'


def _swells(scene: Scene) -> bool:
    """Whether there are waves that need more room than a basin has."""
    return scene.waves is not None and scene.waves.angular_frequencies.min() < _BASIN
