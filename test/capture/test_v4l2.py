"""What a device offers and how it is set up, against a kernel that refuses as V4L2 refuses."""

from __future__ import annotations

import errno

import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.capture import errors
from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.v4l2 import Device, from_fourcc, to_fourcc

PATH = '/dev/video0'


def test_a_camera_tells_its_modes(kernel):
    with Device(PATH, kernel) as device:
        assert device.capabilities.card == 'Fake camera'
        assert [str(mode) for mode in device.modes()] == [
            'MJPG 640x480 at 30, 15 /s',
            'MJPG 1280x720 at 30 /s',
            'YUYV 640x480 at 10, 5 /s',
        ]


def test_a_range_of_sizes_is_one_mode(kernel, camera):
    camera.span['GREY'] = (16, 1920, 8, 16, 1080, 4)
    with Device(PATH, kernel) as device:
        mode = device.modes()[-1]
    assert str(mode) == 'GREY 16x16 to 1920x1080'
    assert mode.offers(640, 480)
    assert not mode.offers(641, 480)
    assert not mode.offers(2000, 480)


def test_a_format_is_set_with_the_nearest_rate(kernel):
    with Device(PATH, kernel) as device:
        chosen = device.set_format('YUYV', 640, 480, frame_rate=9.0)
        assert (chosen.pixel_format, chosen.width, chosen.height) == ('YUYV', 640, 480)
        assert chosen.frame_rate == 10.0
        assert device.get_format() == chosen


def test_a_rate_is_optional(kernel, camera):
    with Device(PATH, kernel) as device:
        assert device.set_format('MJPG', 640, 480).frame_rate == 30.0
        camera.errors[v4l2.VIDIOC_G_PARM] = errno.ENOTTY
        camera.errors[v4l2.VIDIOC_S_PARM] = errno.ENOTTY
        assert device.set_format('MJPG', 640, 480).frame_rate == 0.0
        assert device.set_format('MJPG', 640, 480, 30.0).frame_rate == 0.0


@pytest.mark.parametrize('wanted', [('H264', 640, 480), ('MJPG', 800, 600), ('YUYV', 1280, 720)])
def test_a_format_that_is_not_there_is_refused_with_those_that_are(kernel, wanted):
    with Device(PATH, kernel) as device, pytest.raises(CaptureError) as caught:
        device.set_format(*wanted)
    assert 'no {} {}x{}'.format(*wanted) in str(caught.value)
    assert ('YUYV 640x480' if wanted[0] == 'YUYV' else 'MJPG 1280x720') in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_camera_of_very_many_modes_lists_its_formats(kernel, camera):
    for letter in 'ABCDEFG':
        camera.modes[f'Y{letter}10'] = {(16 * k, 16): () for k in range(1, 10)}
    with Device(PATH, kernel) as device, pytest.raises(CaptureError) as caught:
        device.set_format('H264', 640, 480)
    assert 'it offers the formats MJPG, YA10, YB10' in str(caught.value)
    assert len(str(caught.value)) < 200


def test_a_pixel_format_is_four_letters(kernel):
    with Device(PATH, kernel) as device, pytest.raises(CaptureError, match='four letters'):
        device.set_format('MJPEG', 640, 480)


@pytest.mark.parametrize(
    ('code', 'cause', 'words'),
    [
        (errno.ENOENT, errors.GONE, 'plug it in'),
        (errno.ENODEV, errors.GONE, 'plug it in'),
        (errno.EACCES, errors.DENIED, 'udev rule'),
        (errno.EBUSY, errors.BUSY, 'fuser -v /dev/video0'),
        (errno.EIO, errors.FAILED, 'driver failed'),
        (errno.EINVAL, errors.INVALID, 'binopos doctor'),
    ],
)
def test_a_device_that_does_not_open_says_why(kernel, camera, code, cause, words):
    camera.open_error = code
    with pytest.raises(CaptureError, match=words) as caught:
        Device(PATH, kernel)
    assert caught.value.cause == cause


@pytest.mark.parametrize('code', [errno.ENOTTY, errno.EINVAL])
def test_a_device_that_is_no_camera_is_refused(kernel, camera, code):
    camera.errors[v4l2.VIDIOC_QUERYCAP] = code
    with pytest.raises(CaptureError, match='/dev/video0: not a camera'):
        Device(PATH, kernel)


@pytest.mark.parametrize(
    ('able', 'words'),
    [
        (v4l2.CAP_META_CAPTURE | v4l2.CAP_STREAMING, 'sends no images on this node'),
        (v4l2.CAP_VIDEO_CAPTURE, 'sends no images on this node'),
        (v4l2.CAP_VIDEO_CAPTURE_MPLANE | v4l2.CAP_STREAMING, 'multi-planar'),
    ],
)
def test_a_node_without_images_is_refused(kernel, camera, able, words):
    camera.capabilities = able
    with pytest.raises(CaptureError, match=words):
        Device(PATH, kernel)


def test_a_real_file_is_no_camera(tmp_path):
    plain = tmp_path / 'plain'
    plain.write_bytes(b'')
    with pytest.raises(CaptureError, match='not a camera'):
        Device(str(plain))
    with pytest.raises(CaptureError, match='cannot open it'):
        Device(str(tmp_path))


def test_setting_up_a_camera_in_use_is_refused(kernel, camera):
    with Device(PATH, kernel) as device:
        camera.errors[v4l2.VIDIOC_S_FMT] = errno.EBUSY
        with pytest.raises(CaptureError, match='another program') as caught:
            device.set_format('MJPG', 640, 480)
    assert caught.value.cause == errors.BUSY


def test_a_camera_pulled_out_during_any_request_says_so(kernel, camera):
    with Device(PATH, kernel) as device:
        camera.gone = True
        for act in (
            device.modes,
            device.get_format,
            lambda: device.set_format('MJPG', 640, 480),
            lambda: device.get('gain'),
            lambda: device.set('gain', 5),
            device.stream,
        ):
            with pytest.raises(CaptureError, match='not plugged in') as caught:
                act()
            assert caught.value.cause == errors.GONE


def test_a_closed_device_answers_no_more_and_closes_twice(kernel):
    device = Device(PATH, kernel)
    device.close()
    device.close()
    with pytest.raises(CaptureError, match='not plugged in'):
        device.get_format()


@given(st.text('ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789', min_size=4, max_size=4), st.booleans())
def test_names_of_pixel_formats_make_the_round_trip(name, big_endian):
    name += '-BE' if big_endian else ''
    assert to_fourcc(from_fourcc(name)) == name


def test_short_names_of_pixel_formats_are_padded():
    assert from_fourcc('Y16') == int.from_bytes(b'Y16 ', 'little')
    assert to_fourcc(from_fourcc('Y16')) == 'Y16'
