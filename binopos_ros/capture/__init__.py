"""Cameras: V4L2 streaming, USB identity, pairing of left and right, recovery."""

from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.stream import Frame, Stream
from binopos_ros.capture.v4l2 import Device, Format, Mode

__all__ = ['CaptureError', 'Device', 'Format', 'Frame', 'Mode', 'Stream']
