"""The same camera again: in this run wherever it is plugged in, and after a reboot."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from binopos_ros.capture.usb import Camera


@dataclass(frozen=True)
class Identity:
    """What a camera is known by once it has been opened.

    :ivar serial: '' where it has none, or shares it with another that is plugged in: cheap
        cameras all bear the same.
    """

    vendor_product: str
    serial: str
    port: str
    node: str

    @classmethod
    def of(cls, camera: Camera, cameras: Iterable[Camera]) -> Identity:
        """The identity of a camera among those that are plugged in."""
        sharing = {
            other.device
            for other in cameras
            if (other.vendor_product, other.serial) == (camera.vendor_product, camera.serial)
        }
        serial = camera.serial if len(sharing) < 2 else ''
        return cls(camera.vendor_product, serial, camera.port, camera.node)

    def same_device(self, other: Identity) -> bool:
        """Whether both are one device for certain, by their serial numbers."""
        return bool(self.serial) and (self.vendor_product, self.serial) == (
            other.vendor_product,
            other.serial,
        )


def find_again(
    identity: Identity, cameras: Iterable[Camera], taken: Iterable[str] = ()
) -> Camera | None:
    """Find the camera again, on whatever port and under whatever number.

    By its serial number; without one by its port; failing that, the only one of its model that
    nobody else holds. None where it is not there, or could be several.

    :param taken: nodes that others hold.
    """
    first_nodes = [camera for camera in cameras if camera.index == 0 or not camera.port]
    if not identity.vendor_product:
        return next((one for one in first_nodes if one.node == identity.node), None)
    alike = [one for one in first_nodes if one.vendor_product == identity.vendor_product]
    if identity.serial:
        return next((one for one in alike if one.serial == identity.serial), None)
    there = next((one for one in alike if one.port == identity.port), None)
    if there is not None:
        return there
    free = [one for one in alike if one.node not in set(taken)]
    return free[0] if len(free) == 1 else None


def exchanged(before: Mapping[str, Identity], now: Mapping[str, Identity]) -> bool:
    """Whether left and right have changed places, as far as serial numbers can tell."""
    if not {'left', 'right'} <= before.keys() & now.keys():
        return False
    return before['left'].same_device(now['right']) and before['right'].same_device(now['left'])


def memory_file() -> Path:
    """Where the identities of the last run are kept: below $ROS_HOME, by default ~/.ros."""
    return Path(os.environ.get('ROS_HOME') or Path.home() / '.ros') / 'binopos_cameras.json'


def recall(path: Path) -> dict[str, Identity]:
    """The identities of the last run by side; none where there was none, or it is unreadable."""
    try:
        known = json.loads(path.read_text())
        return {side: Identity(**traits) for side, traits in known.items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def remember(path: Path, identities: Mapping[str, Identity]) -> None:
    """Keep the identities for the next run.

    :raises OSError: where the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix('.new')
    fresh.write_text(json.dumps({side: asdict(one) for side, one in identities.items()}, indent=1))
    fresh.replace(path)
