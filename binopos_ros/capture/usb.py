"""Which cameras are plugged in, and who they are: from sysfs, udev's links and pyusb."""

from __future__ import annotations

import errno
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from binopos_ros.capture.errors import DENIED, FAILED, GONE, CaptureError

UDEV_RULE = 'config/99-binopos-cameras.rules'


@dataclass(frozen=True)
class Camera:
    """A V4L2 device node and, where it is on USB, the device behind it.

    :ivar node: '/dev/video0'.
    :ivar name: what its driver calls it.
    :ivar index: counts the nodes of one device; its images come from the first.
    :ivar vendor_product: '1209:0001', or '' where it is not on USB.
    :ivar serial: its serial number, or ''.
    :ivar port: the path of USB ports that it is plugged into, '3-1.2', or ''.
    :ivar by_id: udev's link below /dev/v4l/by-id, or ''.
    :ivar by_path: udev's link below /dev/v4l/by-path, or ''.
    :ivar bus: number of the USB bus; 0 where it is not on USB.
    :ivar address: of the device on the bus.
    """

    node: str
    name: str
    index: int = 0
    vendor_product: str = ''
    serial: str = ''
    port: str = ''
    by_id: str = ''
    by_path: str = ''
    bus: int = 0
    address: int = 0

    @property
    def device(self) -> str:
        """What the nodes of one device have in common."""
        return self.port or self.node

    def __str__(self) -> str:
        traits = [self.name]
        if self.serial:
            traits.append(f'serial {self.serial}')
        if self.vendor_product:
            traits.append(f'{self.vendor_product} at port {self.port}')
        return f'{self.node} ({", ".join(traits)})'


def find_cameras(root: str = '/') -> list[Camera]:
    """List the video nodes of the machine, by number.

    :param root: where /sys and /dev are found.
    """
    by_id = _links(Path(root, 'dev/v4l/by-id'))
    by_path = _links(Path(root, 'dev/v4l/by-path'))
    folder = Path(root, 'sys/class/video4linux')
    entries = [entry for entry in _entries(folder) if re.fullmatch(r'video\d+', entry.name)]
    cameras = []
    for entry in sorted(entries, key=lambda entry: int(entry.name[len('video') :])):
        name = _read(entry / 'name')
        if not name:
            continue  # unplugged while we looked
        usb = _usb_device(entry / 'device')
        cameras.append(
            Camera(
                node=f'/dev/{entry.name}',
                name=name,
                index=int(_read(entry / 'index') or 0),
                by_id=by_id.get(entry.name, ''),
                by_path=by_path.get(entry.name, ''),
                **(_usb_traits(usb) if usb else {}),
            )
        )
    return cameras


def choose(name: str, cameras: list[Camera]) -> Camera:
    """Find the camera that bears a name.

    :param name: a node ('/dev/video0', '0'), a link of udev ('/dev/v4l/by-id/...' or its last
        part), a serial number ('serial:' before it where it could be taken for a number), a
        model ('1209:0001'), or a path of USB ports ('3-1.2').
    :raises CaptureError: where no camera bears it, or several do; those that are there are listed.
    """
    found: dict[str, Camera] = {}
    for camera in cameras:
        if _bears(camera, name):
            first = found.get(camera.device, camera)
            found[camera.device] = min(first, camera, key=lambda one: one.index)
    if not found:
        present = '; '.join(str(camera) for camera in cameras if camera.index == 0)
        message = f'camera {name!r} is not plugged in; there are: {present or "none"}'
        raise CaptureError(message, GONE)
    if len(found) > 1:
        candidates = '; '.join(str(camera) for camera in found.values())
        message = f'camera {name!r} could be any of: {candidates}; name it by its serial or port'
        raise CaptureError(message)
    return next(iter(found.values()))


def reset(camera: Camera) -> None:
    """Have the USB hub reset the device, as if it were unplugged and plugged in again.

    :raises CaptureError: where it is not on USB, forbidden, or fails.
    """
    import usb.core

    if not camera.bus:
        message = f'{camera.node}: not on USB, so it cannot be reset; replug or power-cycle it'
        raise CaptureError(message)
    try:
        device = usb.core.find(bus=camera.bus, address=camera.address)
        if device is None:
            message = f'{camera}: left the USB bus before it could be reset'
            raise CaptureError(message, GONE)
        device.reset()
    except usb.core.NoBackendError as error:
        message = f'{camera}: cannot be reset without libusb; install the package libusb-1.0-0'
        raise CaptureError(message) from error
    except usb.core.USBError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            message = (
                f'{camera}: this user may not reset it; install the udev rule {UDEV_RULE} '
                'and plug the camera in again'
            )
            raise CaptureError(message, DENIED) from error
        message = f'{camera}: the reset failed ({error}); replug it'
        raise CaptureError(message, FAILED) from error


def _bears(camera: Camera, name: str) -> bool:
    if name.startswith('serial:'):
        return camera.serial == name.removeprefix('serial:')
    links = {link for link in (camera.by_id, camera.by_path) if link}
    names = {camera.node, *links, *(os.path.basename(link) for link in links)}
    names |= {os.path.basename(camera.node), camera.node.removeprefix('/dev/video')}
    names |= {camera.serial, camera.port, camera.vendor_product}
    if name in names - {''} or name.lower() == camera.vendor_product != '':
        return True
    # A link of the user's own ('/dev/left_camera').
    return name.startswith('/') and os.path.realpath(name) == camera.node


def _links(folder: Path) -> dict[str, str]:
    links = {}
    for link in _entries(folder):
        with suppress(OSError):  # gone while we looked, or no link
            links[os.path.basename(os.readlink(link))] = f'/dev/v4l/{folder.name}/{link.name}'
    return links


def _entries(folder: Path) -> list[Path]:
    """What is in a folder that udev or the kernel may take away while we look."""
    with suppress(OSError):
        return sorted(folder.iterdir())
    return []


def _usb_device(link: Path) -> Path | None:
    if not link.exists():
        return None
    device = link.resolve()
    return next(
        (folder for folder in (device, *device.parents) if (folder / 'idVendor').exists()), None
    )


def _usb_traits(usb: Path) -> dict[str, Any]:
    return {
        'vendor_product': f'{_read(usb / "idVendor")}:{_read(usb / "idProduct")}'.lower(),
        'serial': _read(usb / 'serial'),
        'port': usb.name,
        'bus': int(_read(usb / 'busnum') or 0),
        'address': int(_read(usb / 'devnum') or 0),
    }


def _read(path: Path) -> str:
    try:
        return path.read_text(errors='replace').strip()
    except OSError:
        return ''
