"""The suite's messages, built and read without ROS.

Built messages are of `rosbags`' classes and go to a `BagWriter`; what is written for every pair is
packed in `results.py`. What reads takes rclpy's messages as well: both have the same fields.
Stamps are integer nanoseconds since the epoch.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.bag.definitions import jazzy
from binopos_ros.bag.errors import BagError
from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.camera_info_message import camera_info_fields

COMPRESSED_IMAGE = 'sensor_msgs/msg/CompressedImage'
IMAGE = 'sensor_msgs/msg/Image'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
POSE_WITH_COVARIANCE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
POSE = 'geometry_msgs/msg/PoseStamped'
VECTOR3 = 'geometry_msgs/msg/Vector3Stamped'
ODOMETRY = 'nav_msgs/msg/Odometry'
TF = 'tf2_msgs/msg/TFMessage'
STATUS = 'diagnostic_msgs/msg/DiagnosticStatus'

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

#: Bytes of the encapsulation and of the stamp in a serialised header.
STAMP_END = 12

_SECOND = 10**9


def stamp_of(message: Any) -> int:
    """Nanoseconds of a message's header stamp."""
    stamp = message.header.stamp
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def serialized_stamp(data: bytes) -> int:
    """Nanoseconds of the header stamp that a serialised message (CDR) begins with.

    Raises:
        BagError: too short for a header.
    """
    if len(data) < STAMP_END:
        message = f'message of {len(data)} bytes is too short for a header'
        raise BagError(message)
    order = '<' if data[1] & 1 else '>'
    seconds, nanoseconds = struct.unpack_from(f'{order}iI', data, STAMP_END - 8)
    return int(seconds * _SECOND + nanoseconds)


def serialized_transform_stamp(data: bytes) -> int:
    """Nanoseconds of the first stamp in a serialised TFMessage.

    Raises:
        BagError: it holds no transform.
    """
    # The sequence's length stands where a header has its stamp, and the first header after it.
    if len(data) < 2 * STAMP_END - 8 or data[4:8] == bytes(4):
        message = 'message without a transform'
        raise BagError(message)
    return serialized_stamp(data[:4] + data[8:])


def compressed_image(stamp_ns: int, frame_id: str, data: bytes, format: str = 'jpeg') -> Any:
    """An image in its compressed form, the camera's own bytes."""
    return _make(
        COMPRESSED_IMAGE,
        header=_header(stamp_ns, frame_id),
        format=format,
        data=np.frombuffer(data, dtype=np.uint8),
    )


def image(
    stamp_ns: int,
    frame_id: str,
    data: bytes | NDArray[np.uint8],
    size: tuple[int, int],
    encoding: str,
    step: int,
) -> Any:
    """A raw image of `size` (width, height) pixels, `step` bytes per row."""
    width, height = size
    pixels = np.frombuffer(data, dtype=np.uint8)
    if pixels.size < step * height:
        message = f'image of {width}x{height}, step {step}, has only {pixels.size} bytes'
        raise BagError(message)
    return _make(
        IMAGE,
        header=_header(stamp_ns, frame_id),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=step,
        data=pixels,
    )


def camera_info(stamp_ns: int, frame_id: str, info: CameraInfo) -> Any:
    """A camera's calibration as a message; its name is not part of it."""
    fields = camera_info_fields(info, jazzy().types['sensor_msgs/msg/RegionOfInterest'])
    return _make(CAMERA_INFO, header=_header(stamp_ns, frame_id), **fields)


def status(name: str, subject: str, level: int, word: str, values: Mapping[str, str]) -> Any:
    """A word on something: who says it, of what, level 0 to 2, and what stands beside."""
    return _make(
        STATUS,
        level=level,
        name=name,
        message=word,
        hardware_id=subject,
        values=[
            _make('diagnostic_msgs/msg/KeyValue', key=key, value=value)
            for key, value in values.items()
        ],
    )


def transforms(stamp_ns: int, *each: tuple[str, str, ArrayLike, ArrayLike]) -> Any:
    """Transforms of one stamp: parent and child frame, translation (m), quaternion."""
    made = [
        _make(
            'geometry_msgs/msg/TransformStamped',
            header=_header(stamp_ns, parent),
            child_frame_id=child,
            transform=_make(
                'geometry_msgs/msg/Transform',
                translation=_vector(translation),
                rotation=_quaternion(rotation),
            ),
        )
        for parent, child, translation, rotation in each
    ]
    return _make(TF, transforms=made)


def transforms_of(message: Any) -> list[tuple[int, str, str, Vector, Quaternion]]:
    """Stamp (ns), parent, child, translation (m) and quaternion of each in a TFMessage."""
    told = []
    for each in message.transforms:
        place, turn = each.transform.translation, each.transform.rotation
        told.append(
            (
                stamp_of(each),
                str(each.header.frame_id),
                str(each.child_frame_id),
                (place.x, place.y, place.z),
                (turn.x, turn.y, turn.z, turn.w),
            )
        )
    return told


def odometry_of(
    message: Any,
) -> tuple[int, str, str, list[float], Quaternion, NDArray[np.float64]]:
    """Stamp (ns), frame, child frame, position (m), quaternion and covariance of an Odometry."""
    return (
        stamp_of(message),
        str(message.header.frame_id),
        str(message.child_frame_id),
        position_of(message).tolist(),
        orientation_of(message),
        covariance_of(message),
    )


def orientation_of(message: Any) -> Quaternion:
    """Quaternion x, y, z, w of a PoseWithCovarianceStamped or an Odometry."""
    turn = message.pose.pose.orientation
    return turn.x, turn.y, turn.z, turn.w


def position_of(message: Any) -> NDArray[np.float64]:
    """Position (3,) of a PoseStamped, a PoseWithCovarianceStamped or an Odometry."""
    inner = message.pose.pose if hasattr(message.pose, 'pose') else message.pose
    return np.array([inner.position.x, inner.position.y, inner.position.z], dtype=float)


def covariance_of(message: Any) -> NDArray[np.float64]:
    """Covariance (6, 6) of a PoseWithCovarianceStamped's or Odometry's pose."""
    return np.asarray(message.pose.covariance, dtype=float).reshape(6, 6)


def _make(type_name: str, **fields: Any) -> Any:
    return jazzy().types[type_name](**fields)


def _header(stamp_ns: int, frame_id: str) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, _SECOND)
    stamp = _make('builtin_interfaces/msg/Time', sec=seconds, nanosec=nanoseconds)
    return _make('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)


def _quaternion(rotation: ArrayLike) -> Any:
    x, y, z, w = (float(value) for value in np.asarray(rotation, dtype=float))
    return _make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)


def _vector(vector: ArrayLike) -> Any:
    x, y, z = np.asarray(vector, dtype=float)
    return _make('geometry_msgs/msg/Vector3', x=x, y=y, z=z)
