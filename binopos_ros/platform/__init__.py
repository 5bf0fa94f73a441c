"""Where the rig is in a fixed frame: transforms and odometry, interpolated, with covariance.

>>> import numpy as np
>>> mounting = (0.3, 0.0, 0.1, -0.5, 0.5, -0.5, 0.5)
>>> options = PlatformOptions(source='odometry', mounting=mounting)
>>> platform = Platform(FixedFrameOptions('odom', options))
>>> for stamp in (0, 20_000_000):
...     refused = platform.odometry.add(
...         stamp, 'odom', 'base_link', (1.0, 2.0, -3.0), (0, 0, 0, 1), 1e-6 * np.eye(6)
...     )
>>> rig = platform.rig_pose(10_000_000, 'left_camera_optical_frame')
>>> print(rig.carry(np.array([0.0, 0.0, 1.5]), 1e-6 * np.eye(3)).point.round(3))
[ 2.8  2.  -2.9]
"""

from binopos_ros.platform.errors import PlatformError
from binopos_ros.platform.history import Limits, Missing
from binopos_ros.platform.options import FixedFrameOptions, PlatformOptions
from binopos_ros.platform.rig_pose import FixedPosition, RigPose
from binopos_ros.platform.stage import Platform
from binopos_ros.platform.transforms import Transform
from binopos_ros.platform.tree import TransformTree
from binopos_ros.platform.waiting import WaitingRoom

__all__ = [
    'FixedFrameOptions',
    'FixedPosition',
    'Limits',
    'Missing',
    'Platform',
    'PlatformError',
    'PlatformOptions',
    'RigPose',
    'Transform',
    'TransformTree',
    'WaitingRoom',
]
