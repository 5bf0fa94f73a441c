"""What nav2's docking server makes of the dock's pose that a detector tells it.

Written from its contract (`getRefinedPose` of opennav_docking's simple docks): the pose must be
younger than a limit by its stamp, in the server's fixed frame or one that TF leads to; it is
averaged with a coefficient; a rotation from the detector's axes to the dock's is put behind it, of
which only the heading counts; the goal lies beside it by a translation in the dock's axes, at a
height of 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation, Slerp


@dataclass
class Dock:
    """A plugin's instance, by its parameters; those that are not given are nav2's own defaults.

    Attributes:
        fixed_frame: the server's.
        parameters: of the plugin.
        lookups: frames that TF was asked for.
    """

    fixed_frame: str
    parameters: dict
    lookups: list[str] = field(default_factory=list)

    def __post_init__(self):
        self.last = None
        unknown = self.parameters.keys() - DEFAULTS.keys()
        assert not unknown, unknown
        self.values = DEFAULTS | self.parameters

    def refined(self, now, stamp, frame, position, quaternion):
        """Place (3,) and heading of the goal, or None where the pose is refused; stamps in s."""
        if now - stamp > self.values[_TIMEOUT]:
            return None
        if frame != self.fixed_frame:
            self.lookups.append(frame)
            return None
        position, turn = self._averaged(
            stamp, np.asarray(position), Rotation.from_quat(quaternion)
        )
        # tf2's Euler angles: about y, x and z, each about the axes that the one before has turned.
        angles = [self.values[f'external_detection_rotation_{each}'] for each in _ANGLES]
        dock = turn * Rotation.from_euler('YXZ', angles)
        forward = dock.apply([1.0, 0.0, 0.0])
        heading = np.arctan2(forward[1], forward[0])
        x, y = (self.values[f'external_detection_translation_{axis}'] for axis in 'xy')
        aside = Rotation.from_euler('z', heading).apply([x, y, 0.0])
        return (position + aside) * [1, 1, 0], heading

    def _averaged(self, stamp, position, turn):
        share = self.values['filter_coef']
        if self.last is not None and stamp - self.last[0] <= self.values[_TIMEOUT] and share > 0:
            _, before, turned = self.last
            position = (1 - share) * before + share * position
            turn = Slerp([0, 1], Rotation.concatenate([turned, turn]))(share)
        self.last = stamp, position, turn
        return position, turn


_TIMEOUT = 'external_detection_timeout'
_ANGLES = ('pitch', 'roll', 'yaw')
DEFAULTS = {
    'plugin': 'opennav_docking::SimpleNonChargingDock',
    'use_external_detection_pose': False,
    _TIMEOUT: 1.0,
    'external_detection_translation_x': -0.20,
    'external_detection_translation_y': 0.0,
    'external_detection_rotation_yaw': 0.0,
    'external_detection_rotation_pitch': 1.57,
    'external_detection_rotation_roll': -1.57,
    'filter_coef': 0.1,
    'docking_threshold': 0.05,
    'staging_x_offset': -0.7,
    'staging_yaw_offset': 0.0,
}
