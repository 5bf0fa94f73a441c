"""What the camera node refuses at its start, in one line."""

from __future__ import annotations

import pytest
import rclpy

from binopos_ros.optics import OpticsError


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'right.device': 'S1'}, "are both 'S1': name two cameras"),
        ({'right.device': '/dev/video0'}, 'which the other side has: name two'),
        ({'width': 320}, 'no MJPG 320x48; it offers MJPG 64x48'),
        ({'pixel_format': 'H264'}, "pixel_format 'H264' cannot be passed on; choose one of MJPG"),
        ({'left.controls.gain': 96}, 'gain = 96 is out of range: it takes 0 to 95'),
        ({'left.controls.zoom': 3}, "no control 'zoom'; its controls are gain"),
        ({'frame_timeout': 0.0}, 'frame_timeout'),
        ({'left.camera_info_url': '/absent.yaml'}, '/absent.yaml'),
        ({'left.camera_info_url': 'package://no_such_package/a.yaml'}, 'no_such_package'),
        ({'left.camera_info_url': 'http://somewhere/a.yaml'}, 'give file://PATH'),
        ({'lefft.device': 'S1'}, "did you mean 'left.device'"),
    ],
)
def test_bad_input_is_refused_in_one_line(rig, parameters, words):
    with pytest.raises(ValueError, match=r'\w') as caught:
        rig.start(**parameters)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_calibration_of_another_camera_is_refused(rig, calibration):
    left = calibration('left')
    right = calibration('right')
    for urls, words in (
        (
            (calibration('left', (640, 480)), right),
            'is for images of 640x480',
        ),
        ((right, left), 'exchange the two files'),
        ((left, left), 'hold no baseline'),
        ((right, right), 'calibration of a right camera'),
    ):
        with pytest.raises(OpticsError, match=words):
            rig.start(**{'left.camera_info_url': urls[0], 'right.camera_info_url': urls[1]})
        rclpy.try_shutdown()
