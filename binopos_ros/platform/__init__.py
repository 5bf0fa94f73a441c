"""Where the rig is in a fixed frame: transforms and odometry, interpolated, with covariance.

>>> platform = Platform(FixedFrameOptions('odom', PlatformOptions(source='odometry')))
>>> platform.odometry.add(stamp, 'odom', 'base_link', position, quaternion, covariance)
>>> platform.rig_pose(stamp, 'left_camera_optical_frame').carry(point, covariance)
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
