"""What the camera node publishes: the cameras' own bytes, halves, stamps; each copied once."""

from __future__ import annotations

import time
import tracemalloc

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from binopos_ros.capture.v4l2 import Format
from binopos_ros.nodes.camera import image_messages, split_messages


def test_jpegs_go_through_untouched_with_the_time_of_their_taking(rig, peer, calibration):
    images = {
        side: peer.listen(CompressedImage, f'{side}/image_raw/compressed')
        for side in ('left', 'right')
    }
    infos = peer.listen(CameraInfo, 'left/camera_info')
    began = time.time()
    rig.start(
        **{
            'left.camera_info_url': 'file://' + calibration('left'),
            'right.camera_info_url': calibration('right'),
        }
    )
    peer.wait_for(lambda: all(len(got) >= 5 for got in images.values()) and infos, 'images')
    ended = time.time()
    for side, camera in (('left', rig.left), ('right', rig.right)):
        for message in images[side]:
            assert bytes(message.data) == rig.cameras[camera].picture
            assert message.format == 'jpeg'
            assert message.header.frame_id == f'{side}_camera_optical_frame'
            assert began <= message.header.stamp.sec + message.header.stamp.nanosec * 1e-9 <= ended
    assert list(infos[0].k)[:3] == [50.0, 0.0, rig.width / 2]
    stamps = {(one.header.stamp.sec, one.header.stamp.nanosec) for one in images['left']}
    assert stamps & {(one.header.stamp.sec, one.header.stamp.nanosec) for one in infos}


def test_raw_images_keep_their_bytes(rig, peer):
    pixels = bytes(np.random.default_rng(0).integers(0, 256, 2 * rig.width * rig.height, np.uint8))
    for camera in rig.cameras.values():
        camera.picture = pixels
    images = peer.listen(Image, 'left/image_raw')
    rig.start(pixel_format='YUYV')
    peer.wait_for(lambda: images, 'an image')
    message = images[0]
    assert (message.width, message.height, message.step) == (rig.width, rig.height, 2 * rig.width)
    assert message.encoding == 'yuv422_yuy2'
    assert bytes(message.data) == pixels


def test_a_side_by_side_stream_is_split(rig, peer):
    whole = np.hstack([rig.picture('left'), rig.picture('right')])
    rig.cameras[rig.left].picture = rig.jpeg(whole)
    images = {side: peer.listen(Image, f'{side}/image_raw') for side in ('left', 'right')}
    rig.start(side_by_side=True, width=2 * rig.width)
    peer.wait_for(lambda: all(images.values()), 'both halves')
    for side, got in images.items():
        message = got[0]
        assert (message.width, message.height, message.encoding) == (rig.width, rig.height, 'bgr8')
        shown = np.frombuffer(message.data, np.uint8).reshape(rig.height, rig.width, 3)
        difference = cv2.absdiff(shown, rig.picture(side))
        assert np.median(difference) <= 2
    stamps = [images[side][0].header.stamp for side in images]
    assert stamps[0] == stamps[1]


def test_the_stamp_offset_changes_at_run_time(rig, peer, set_parameter):
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rig.start()
    assert set_parameter('timestamp_offset', -5.0).successful
    peer.wait_for(lambda: lefts and time.time() - lefts[-1].header.stamp.sec > 4.0, 'the offset')
    assert not set_parameter('width', 32).successful


@pytest.mark.parametrize('pixel_format', ['MJPG', 'YUYV'])
def test_from_the_drivers_buffer_to_the_message_there_is_one_copy(pixel_format):
    form = Format(pixel_format, 1280, 960, 2560 if pixel_format == 'YUYV' else 0, 0, 30.0)
    buffer = memoryview(bytearray(1280 * 960 * 2))
    image_messages(buffer, form)
    tracemalloc.start()
    try:
        (message,) = image_messages(buffer, form)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(message.data) == len(buffer)
    assert len(buffer) <= most < 1.1 * len(buffer)


def test_each_half_of_a_raw_side_by_side_image_is_copied_once():
    form = Format('YUYV', 2560, 960, 5120 + 64, 0, 30.0)
    buffer = memoryview(bytearray(form.step * form.height))
    tracemalloc.start()
    try:
        left, right = split_messages(buffer, form)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert (left.width, left.step, len(right.data)) == (1280, 2560, 2560 * 960)
    assert 2 * len(left.data) <= most < 2.1 * len(left.data)
