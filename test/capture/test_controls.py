"""Controls by name: every kind read back as set, every refusal in words."""

from __future__ import annotations

import errno

import pytest

from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.controls import in_order_of_setting
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.v4l2 import Device

PATH = '/dev/video0'


@pytest.fixture
def device(kernel):
    with Device(PATH, kernel) as device:
        yield device


def test_controls_are_named_as_v4l2_ctl_names_them(device):
    assert set(device.controls) == {
        'brightness',
        'gain',
        'white_balance_automatic',
        'auto_exposure',
        'exposure_time_absolute',
        'shutter',
        'reset',
        'big',
        'name',
        'bits',
        'temperature',
    }


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('brightness', -64),
        ('gain', 95),
        ('white_balance_automatic', 0),
        ('auto_exposure', 1),
        ('shutter', 1),
        ('big', -(1 << 40)),
        ('name', 'right'),
        ('bits', 0x8000000A),
    ],
)
def test_what_is_set_is_read_back(device, name, value):
    assert device.get(name) != value
    device.set(name, value)
    assert device.get(name) == value


@pytest.mark.parametrize(
    ('name', 'value', 'words'),
    [
        ('gain', 96, 'gain = 96 is out of range: it takes 0 to 95 in steps of 5'),
        ('gain', 7, 'in steps of 5'),
        ('brightness', -65, '-64 to 64'),
        ('white_balance_automatic', 2, '0: off, 1: on'),
        ('auto_exposure', 2, '1: Manual Mode, 3: Aperture Priority Mode'),
        ('shutter', 2, '0: 8, 1: 16'),
        ('bits', 0x10, 'bits of 0x8000000f'),
        ('name', 'far too long', 'not 12'),
        ('name', 3, 'text'),
        ('gain', 'much', "gain = 'much'"),
        ('temperature', 3, 'can only be read'),
        ('zoom', 3, "no control 'zoom'; its controls are brightness"),
    ],
)
def test_what_the_driver_would_refuse_is_refused_with_what_it_takes(device, name, value, words):
    with pytest.raises(CaptureError) as caught:
        device.set(name, value)
    assert words in str(caught.value)


def test_a_button_is_pressed_and_not_read(device):
    device.set('reset', 1)
    with pytest.raises(CaptureError, match='only be set'):
        device.get('reset')


def test_a_value_held_by_an_automatic_is_refused_in_words(device):
    with pytest.raises(CaptureError, match='switch the automatic off first'):
        device.set('exposure_time_absolute', 100)


def test_automatics_are_set_before_what_they_hold(device):
    names = ['exposure_time_absolute', 'auto_exposure', 'gain', 'white_balance_automatic']
    ordered = in_order_of_setting(device.controls, names)
    assert set(ordered[:2]) == {'auto_exposure', 'white_balance_automatic'}
    assert sorted(ordered) == sorted(names)


def test_two_controls_of_one_name_are_told_apart(fake, kernel, camera):
    camera.controls.append(fake.FakeControl(0x980930, 'Gain'))
    with Device(PATH, kernel) as device:
        assert {'gain', 'gain_00980930'} <= set(device.controls)


def test_a_camera_without_controls_has_none(kernel, camera):
    camera.errors[v4l2.VIDIOC_QUERY_EXT_CTRL] = errno.ENOTTY
    with Device(PATH, kernel) as device:
        assert device.controls == {}
        with pytest.raises(CaptureError, match='its controls are none'):
            device.get('gain')
