"""A calibrator commits to the camera node, as ROS's own does."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from sensor_msgs.srv import SetCameraInfo

from binopos_ros.nodes import transforms
from binopos_ros.nodes.camera import CameraNode
from binopos_ros.optics import read_camera_info
from binopos_ros.optics.camera_info_message import camera_info_fields


def request(path: str, **changes: object) -> SetCameraInfo.Request:
    fields = camera_info_fields(read_camera_info(path), RegionOfInterest) | changes
    return SetCameraInfo.Request(camera_info=CameraInfo(**fields))


def test_a_calibration_is_written_and_used_at_once(rig, peer, call, calibration, tmp_path):
    """It goes to the file that is named, or to camera_info_manager's."""
    named = tmp_path / 'mine' / 'left.yaml'
    made = calibration('left')
    named.parent.mkdir()
    named.write_text(Path(made).read_text())
    rig.start(**{'left.camera_info_url': str(named)})
    infos = {side: peer.listen(CameraInfo, f'{side}/camera_info') for side in ('left', 'right')}
    wanted = request(made, d=[0.25, 0.0, 0.0, 0.0, 0.0])
    answer = call(SetCameraInfo, 'left/set_camera_info', wanted)
    assert answer.success, answer.status_message
    assert read_camera_info(named).d[0] == 0.25
    answer = call(SetCameraInfo, 'right/set_camera_info', request(calibration('right')))
    assert answer.success
    assert 'right.camera_info_url' in answer.status_message
    default = tmp_path / 'ros_home' / 'camera_info' / 'right.yaml'
    assert read_camera_info(default).p[3] == pytest.approx(-50.0 * 0.23)
    peer.wait_for(lambda: infos['left'] and infos['left'][-1].d[0] == 0.25, 'the new calibration')
    peer.wait_for(lambda: infos['right'], 'the calibration of the right camera')


def test_the_frames_follow_a_new_calibration_at_once(rig, call, calibration, monkeypatch):
    """/tf_static is sent again, with the new baseline; its message package need not be there."""
    sent = []
    create = CameraNode.create_publisher

    def create_publisher(node, kind, topic, *arguments, **options):
        if topic == transforms.TF_STATIC:
            return SimpleNamespace(publish=sent.append)
        return create(node, kind, topic, *arguments, **options)

    monkeypatch.setattr(transforms, 'tf_message', lambda wanted_by: SimpleNamespace)
    monkeypatch.setattr(CameraNode, 'create_publisher', create_publisher)
    urls = {f'{side}.camera_info_url': calibration(side) for side in ('left', 'right')}
    rig.start(publish_tf=True, **urls)

    def baselines():
        (each,) = zip(*(message.transforms for message in sent), strict=True)
        return [one.transform.translation.x for one in each]

    assert baselines() == [pytest.approx(0.23)]
    wider = list(read_camera_info(calibration('right')).p)
    wider[3] = -50.0 * 0.3
    answer = call(SetCameraInfo, 'right/set_camera_info', request(calibration('right'), p=wider))
    assert answer.success, answer.status_message
    assert baselines() == [pytest.approx(0.23), pytest.approx(0.3)]
    # A left one that makes no rig with it is told in the diagnostics, and moves no frame.
    answer = call(SetCameraInfo, 'left/set_camera_info', request(calibration('left'), p=wider))
    assert answer.success, answer.status_message
    assert len(sent) == 2


def test_a_calibration_that_cannot_be_is_refused(rig, call, calibration, tmp_path):
    rig.start(**{'left.camera_info_url': calibration('left')})
    kept = read_camera_info(calibration('left'))
    for changes, words in (
        ({'width': 640, 'height': 480}, '640x480'),
        ({'k': [-50.0, *kept.k[1:]]}, 'focal lengths must be positive'),
        ({'k': [0.0] * 9}, 'uncalibrated'),
    ):
        answer = call(
            SetCameraInfo, 'left/set_camera_info', request(calibration('left'), **changes)
        )
        assert not answer.success
        assert words in answer.status_message
    assert read_camera_info(calibration('left')) == kept
