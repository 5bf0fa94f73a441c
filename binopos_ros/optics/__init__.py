"""Cameras, flat interfaces, domes and stereo rigs: points to pixels along bent rays, and back."""

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
