"""Still pairs: both cameras' pictures of one instant, with the calibration that held then."""

from __future__ import annotations

from pathlib import Path

from sensor_msgs.msg import CameraInfo

from binopos_ros.optics.camera_info_files import write_camera_info
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES
from binopos_ros.view.wire import Picture


class Stills:
    """Keeps the newest pair of the pictures that are looked at, and writes it when it is asked to.

    It lies in the folder as `binopos calibrate` reads pictures: `left/STAMP.jpg`,
    `right/STAMP.jpg`, and beside them `left.yaml` and `right.yaml`.

    Args:
        folder: made where it is not there.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._matcher: PairMatcher[Picture] = PairMatcher()
        self._pair: Pair[Picture] | None = None
        self._infos: dict[str, CameraInfo] = {}

    def picture(self, picture: Picture) -> None:
        """Take a picture in."""
        for decided in self._matcher.add(picture.side, picture.stamp, picture):
            if isinstance(decided, Pair):
                self._pair = decided

    def camera_info(self, side: str, message: CameraInfo) -> None:
        """Take a camera's calibration in."""
        self._infos[side] = message

    def save(self) -> tuple[bool, str]:
        """Write the newest pair; whether that was done, and where or why not."""
        if self._pair is None:
            return False, 'no pair has come: show the pictures on the page, then press again'
        pair, self._pair = self._pair, None
        try:
            for picture in (pair.left, pair.right):
                path = self._folder / picture.side / f'{pair.left.stamp}.jpg'
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(picture.jpeg)
            for side, message in self._infos.items():
                info = read_camera_info_message(message, side)
                write_camera_info(self._folder / f'{side}.yaml', info)
        except (OSError, ValueError) as error:
            return False, ' '.join(str(error).split())
        missing = [side for side in SIDES if side not in self._infos]
        without = f'; no calibration of the {" and ".join(missing)}' if missing else ''
        return True, f'{self._folder}/left|right/{pair.left.stamp}.jpg{without}'
