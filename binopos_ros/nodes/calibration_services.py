"""The services by which a calibrator, ROS's own among them, commits to the camera node."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial

from sensor_msgs.srv import SetCameraInfo

from binopos_ros.nodes.shell import StageNode
from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.camera_info_files import write_camera_info
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.optics.camera_info_url import calibration_path, check_size

#: As camera_info_manager's.
DEFAULT_URL = 'file://${ROS_HOME}/camera_info/${NAME}.yaml'


def offer_calibration_services(
    node: StageNode,
    urls: Mapping[str, str],
    view_size: tuple[int, int],
    known: Mapping[str, CameraInfo],
    take: Callable[[str, CameraInfo], None],
) -> None:
    """Offer SIDE/set_camera_info: it writes the side's file, and the calibration is used at once.

    Args:
        node: gets the services.
        urls: the files by side; where one is '', that of camera_info_manager.
        view_size: of the images, px.
        known: the calibrations so far, by side, whose names stay.
        take: gets the new calibration of a side.
    """

    def on_call(
        side: str, request: SetCameraInfo.Request, response: SetCameraInfo.Response
    ) -> SetCameraInfo.Response:
        try:
            response.status_message = commit(side, request)
            response.success = True
        except (ValueError, OSError) as error:
            response.success, response.status_message = False, ' '.join(str(error).split())
        return response

    def commit(side: str, request: SetCameraInfo.Request) -> str:
        name = known[side].name if side in known else side
        info = read_camera_info_message(request.camera_info, name)
        check_size(info, view_size)
        path = calibration_path(urls[side] or DEFAULT_URL, side)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f'.{path.name}.part')
        write_camera_info(part, info)
        os.replace(part, path)
        take(side, info)
        if urls[side]:
            return f'written: {path}'
        return f'written: {path}; set {side}.camera_info_url to it for the next start'

    for side in urls:
        node.create_service(SetCameraInfo, f'{side}/set_camera_info', partial(on_call, side))
