"""What `binopos doctor` finds out about the machine: ROS, transport, clock, rights."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from binopos_ros.capture.transport import (
    DEFAULT_SEGMENT,
    PROFILE_SEGMENT,
    profile_variable,
    user_profile,
    uses_fast_dds,
)
from binopos_ros.capture.usb import Camera
from binopos_ros.cli.findings import FAULT, NOTE, OK, WARNING, Finding
from binopos_ros.cli.installation import UDEV_RULES
from binopos_ros.detection import decoders
from binopos_ros.nodes.ros import REMEDY, is_installed

UDEV_REMEDY = (
    f'binopos doctor --print udev | sudo tee /etc/udev/rules.d/{UDEV_RULES.name} && '
    'sudo udevadm control --reload && sudo udevadm trigger; sudo usermod -aG video $USER and log '
    'in again'
)
LAST_DOMAIN = 101
"""Higher ROS domains collide with the ports that Linux hands out by itself."""

SHARED_MEMORY = '/dev/shm'
PROCESSES = 4
_STATE_UNSYNCHRONISED = 5
_TIMEX_BYTES = 208
_MAXIMUM_ERROR_OFFSET = 24


def ros(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Whether ROS can be used."""
    if not is_installed('rclpy'):
        yield Finding(FAULT, 'ROS', 'rclpy is not there for this Python', REMEDY)
        return
    domain = environment.get('ROS_DOMAIN_ID') or '0'
    middleware = environment.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp (default)'
    distribution = environment.get('ROS_DISTRO') or 'unset'
    told = f'domain {domain}, {middleware}, ROS_DISTRO {distribution}'
    if not domain.isdigit() or int(domain) > LAST_DOMAIN:
        yield Finding(FAULT, 'ROS', told, f'set ROS_DOMAIN_ID to a number up to {LAST_DOMAIN}')
    elif not environment.get('AMENT_PREFIX_PATH'):
        yield Finding(
            NOTE,
            'ROS',
            f'{told}; AMENT_PREFIX_PATH is empty, so package:// URLs and ros2 run find nothing',
            'source the setup file of ROS or of the workspace',
        )
    else:
        yield Finding(OK, 'ROS', told)


def transport(
    environment: Mapping[str, str], image_bytes: int, folder: str = SHARED_MEMORY
) -> Iterator[Finding]:
    """Whether images of this size get from one process to the next.

    :param image_bytes: of the raw images; 0 where JPEGs are passed on.
    """
    profile = user_profile(environment)
    if profile and not Path(profile).is_file():
        yield Finding(
            FAULT, 'DDS profile', f'{profile} does not exist', 'correct or unset the variable'
        )
    if not uses_fast_dds(environment):
        yield Finding(OK, 'DDS profile', 'not needed: the middleware is not Fast DDS')
        return
    if image_bytes > DEFAULT_SEGMENT and not profile:
        yield Finding(
            NOTE,
            'DDS profile',
            f'raw images of {image_bytes / 1e6:.1f} MB do not fit the default shared memory of '
            'Fast DDS, which loses them without a word',
            '"binopos run" sets config/fastdds.xml; for nodes started otherwise, '
            f'export {profile_variable(environment)}=.../share/binopos_ros/config/fastdds.xml, '
            'or use MJPG',
        )
    else:
        yield Finding(OK, 'DDS profile', profile or 'not needed: the images fit')
    try:
        free = os.statvfs(folder)
    except OSError as error:
        yield Finding(FAULT, 'shared memory', f'{folder}: {error.strerror}', 'mount a tmpfs there')
        return
    available = free.f_bavail * free.f_frsize
    segment = PROFILE_SEGMENT if image_bytes > DEFAULT_SEGMENT else DEFAULT_SEGMENT
    told = f'{available / 1e6:.0f} MB free in {folder}'
    if available < PROCESSES * segment:
        yield Finding(
            WARNING,
            'shared memory',
            f'{told}, {PROCESSES} nodes want {PROCESSES * segment / 1e6:.0f} MB',
            f'remove stale {folder}/fastrtps_*, or enlarge it: mount -o remount,size=1G {folder} '
            '(in a container: --shm-size=1g)',
        )
    else:
        yield Finding(OK, 'shared memory', told)


def decoding(width: int, height: int) -> Iterator[Finding]:
    """What decodes the cameras' JPEGs, and how long a frame of that size takes."""
    level = WARNING if decoders.REMEDY else OK
    yield Finding(level, 'JPEG decoder', decoders.told(width, height), decoders.REMEDY)


def clock(
    adjtimex: Callable[[ctypes.Array[ctypes.c_char]], int] | None = None,
) -> Iterator[Finding]:
    """Whether this machine's time agrees with that of others."""
    answer = ctypes.create_string_buffer(_TIMEX_BYTES)
    state = (adjtimex or ctypes.CDLL(None, use_errno=True).adjtimex)(answer)
    error = ctypes.c_long.from_buffer(answer, _MAXIMUM_ERROR_OFFSET).value * 1e-6
    if state == _STATE_UNSYNCHRONISED:
        yield Finding(
            WARNING,
            'time',
            'the clock is not synchronised',
            'start systemd-timesyncd or chrony, where other machines use the stamps',
        )
    elif state < 0:
        yield Finding(NOTE, 'time', 'the kernel does not tell whether the clock is synchronised')
    else:
        yield Finding(OK, 'time', f'synchronised, to {1e3 * error:.0f} ms at worst')


def reset(camera: Camera, root: str = '/') -> Iterator[Finding]:
    """Whether the camera could be reset over USB."""
    if not camera.bus:
        yield Finding(NOTE, 'reset', f'{camera} is not on USB: usb_reset does nothing')
        return
    device = Path(root, f'dev/bus/usb/{camera.bus:03d}/{camera.address:03d}')
    if not os.access(device, os.W_OK):
        yield Finding(
            WARNING, 'reset', f'this user may not reset {camera} ({device})', UDEV_REMEDY
        )
        return
    import usb.backend.libusb1

    if usb.backend.libusb1.get_backend() is None:
        yield Finding(WARNING, 'reset', 'libusb is missing', 'sudo apt install libusb-1.0-0')
    else:
        yield Finding(OK, 'reset', f'{camera} can be reset')
