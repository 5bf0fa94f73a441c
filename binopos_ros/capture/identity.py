"""The same camera again: in this run wherever it is plugged in, and after a reboot."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from binopos_ros.capture.usb import Camera
from binopos_ros.sides import SIDES


@dataclass(frozen=True)
class Identity:
    """What a camera is known by once it has been opened.

    :ivar serial: '' where it has none; cheap cameras of a model may all bear the same.
    """

    vendor_product: str
    serial: str
    port: str
    node: str

    @classmethod
    def of(cls, camera: Camera) -> Identity:
        """The identity of a camera."""
        return cls(camera.vendor_product, camera.serial, camera.port, camera.node)

    def alike(self, camera: Camera) -> bool:
        """Whether the camera is of this model and bears this serial, or neither bears one."""
        return (self.vendor_product, self.serial) == (camera.vendor_product, camera.serial)

    def claims(self, camera: Camera) -> bool:
        """Whether the camera is alike and in this one's place."""
        return self.alike(camera) and (self.port or self.node) == camera.device


def find_again(
    identity: Identity, cameras: Iterable[Camera], others: Iterable[Identity] = ()
) -> Camera | None:
    """Find the camera again, on whatever port and under whatever number.

    It is alike, serial number included. Where several are (they bear no serials, or the same one;
    or the kernel still lists a camera where it was unplugged beside where it is now), it is the
    one at the port where it was; failing that, the only one that nobody else claims. None where it
    is not there, or could be several.

    :param others: the identities of the cameras of other sides.
    """
    first_nodes = [camera for camera in cameras if camera.index == 0 or not camera.port]
    if not identity.vendor_product:
        return next((one for one in first_nodes if one.node == identity.node), None)
    alike = [one for one in first_nodes if identity.alike(one)]
    there = next((one for one in alike if identity.claims(one)), None)
    if there is not None:
        return there
    claimed = list(others)
    free = [one for one in alike if not any(other.claims(one) for other in claimed)]
    return free[0] if len(free) == 1 else None


def exchanged(before: Mapping[str, Identity], now: Mapping[str, Identity]) -> bool:
    """Whether left and right have changed places, as far as serial numbers can tell."""
    if not {'left', 'right'} <= before.keys() & now.keys():
        return False
    known = [_serials(identities) for identities in (before, now)]
    left, right = known[0]
    return left != right and all(serial for _, serial in known[0]) and known[1] == [right, left]


def _serials(identities: Mapping[str, Identity]) -> list[tuple[str, str]]:
    return [(identities[side].vendor_product, identities[side].serial) for side in SIDES]


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
