"""Cameras that live in a fake kernel, for the whole room."""

from __future__ import annotations

import pytest

import fake_kernel
from binopos_ros.capture import kernel as v4l2

PATH = '/dev/video0'


@pytest.fixture
def fake():
    """The module of fakes."""
    return fake_kernel


@pytest.fixture
def camera(fake):
    """A webcam: MJPG and YUYV, and a control of every kind."""
    return fake.FakeCamera(
        modes={
            'MJPG': {(640, 480): (30, 15), (1280, 720): (30,)},
            'YUYV': {(640, 480): (10, 5)},
        },
        controls=[
            fake.FakeControl(0x980001, 'User Controls', v4l2.CTRL_TYPE_CTRL_CLASS),
            fake.FakeControl(0x980900, 'Brightness', minimum=-64, maximum=64, default=0),
            fake.FakeControl(0x980913, 'Gain', maximum=95, step=5, default=35),
            fake.FakeControl(
                0x98090C, 'White Balance, Automatic', v4l2.CTRL_TYPE_BOOLEAN, 0, 1, 1, 1
            ),
            fake.FakeControl(
                0x9A0901,
                'Auto Exposure',
                v4l2.CTRL_TYPE_MENU,
                0,
                3,
                1,
                3,
                menu={1: 'Manual Mode', 3: 'Aperture Priority Mode'},
            ),
            fake.FakeControl(
                0x9A0902,
                'Exposure Time, Absolute',
                minimum=1,
                maximum=5000,
                default=166,
                flags=v4l2.CTRL_FLAG_INACTIVE,
            ),
            fake.FakeControl(
                0x98091F, 'Shutter', v4l2.CTRL_TYPE_INTEGER_MENU, 0, 1, 1, 0, menu={0: 8, 1: 16}
            ),
            fake.FakeControl(0x980920, 'Reset', v4l2.CTRL_TYPE_BUTTON, 0, 0, 0, 0),
            fake.FakeControl(
                0x980921, 'Big', v4l2.CTRL_TYPE_INTEGER64, -(1 << 40), 1 << 40, 1, 1 << 33
            ),
            fake.FakeControl(0x980922, 'Name', v4l2.CTRL_TYPE_STRING, 1, 8, 1, 'left'),
            fake.FakeControl(0x980923, 'Bits', v4l2.CTRL_TYPE_BITMASK, 0, 0x8000000F, 0, 1),
            fake.FakeControl(0x980924, 'Temperature', flags=v4l2.CTRL_FLAG_READ_ONLY, default=41),
            fake.FakeControl(0x980925, 'Matrix', v4l2.CTRL_COMPOUND_TYPES),
        ],
    )


@pytest.fixture
def kernel(fake, camera):
    """A kernel with that webcam at /dev/video0; nothing may be left open after a test."""
    kernel = fake.FakeKernel({PATH: camera})
    yield kernel
    assert kernel.leaks == {'descriptors': 0, 'mappings': 0, 'streams': 0}


@pytest.fixture
def take(fake):
    """Build a frame: `take(sequence, data, stamp_ns, flags)`."""

    def build(sequence, data=b'\xff\xd8picture\xff\xd9', stamp_ns=None, flags=0):
        stamp = 1_000_000_000 + 33_000_000 * sequence if stamp_ns is None else stamp_ns
        return fake.FakeFrame(data, sequence, stamp, flags | v4l2.BUF_FLAG_TIMESTAMP_MONOTONIC)

    return build
