"""Cameras, flat interfaces, domes and stereo rigs: points to pixels along bent rays, and back.

>>> import numpy as np
>>> camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
>>> rig = StereoRig(camera, camera, np.eye(3), (-0.23, 0, 0))
>>> wet = StereoRig(
...     camera, camera, np.eye(3), (-0.23, 0, 0), FlatInterface((0, 0, 1), 0.8, (1.0, 1.333))
... )
>>> for each in (rig, wet):
...     left, right = each.project((0.1, 0.0, 1.2))
...     print(left.round(1), right.round(1))
[715. 480.] [542.5 480. ]
[721.9 480. ] [533.6 480. ]
"""

from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.camera_info import (
    CameraInfo,
    CameraInfoWarning,
    Roi,
    stereo_contradictions,
    stereo_from_camera_infos,
)
from binopos_ros.optics.camera_info_files import read_camera_info, write_camera_info
from binopos_ros.optics.column import graded_interface, mean_index
from binopos_ros.optics.dome import DomePort
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import FlatInterface
from binopos_ros.optics.rig import StereoRig

__all__ = [
    'CameraInfo',
    'CameraInfoWarning',
    'DomePort',
    'FlatInterface',
    'OpticsError',
    'PinholeCamera',
    'Roi',
    'StereoRig',
    'graded_interface',
    'mean_index',
    'read_camera_info',
    'stereo_contradictions',
    'stereo_from_camera_infos',
    'write_camera_info',
]
