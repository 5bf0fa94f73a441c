"""Cameras by name, from trees as sysfs and udev build them."""

from __future__ import annotations

import errno
import sys
import types

import pytest

from binopos_ros.capture import errors, usb
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.usb import Camera, choose, find_cameras


def plug(root, number, *, port='', serial='', vendor='1209', product='0001', index=0, name='Lab'):
    """Add a video node, as the kernel does when a camera is plugged in."""
    if port:
        device = root / 'sys/devices/pci0/usb3' / port
        interface = device / f'{port}:1.0'
        interface.mkdir(parents=True, exist_ok=True)
        (device / 'idVendor').write_text(vendor + '\n')
        (device / 'idProduct').write_text(product + '\n')
        (device / 'busnum').write_text('3\n')
        if not (device / 'devnum').exists():
            (device / 'devnum').write_text(f'{number + 2}\n')
        if serial:
            (device / 'serial').write_text(serial + '\n')
    else:
        interface = root / f'sys/devices/platform/vivid.{number}'
        interface.mkdir(parents=True)
    entry = root / f'sys/class/video4linux/video{number}'
    entry.mkdir(parents=True)
    (entry / 'name').write_text(name + '\n')
    (entry / 'index').write_text(f'{index}\n')
    (entry / 'device').symlink_to(interface)
    if port:
        for folder, link in (
            ('by-id', f'usb-{name}_{serial}-video-index{index}'),
            ('by-path', f'pci-0-usb-0:{port}:1.0-video-index{index}'),
        ):
            (root / 'dev/v4l' / folder).mkdir(parents=True, exist_ok=True)
            path = root / 'dev/v4l' / folder / link
            if not path.is_symlink():
                path.symlink_to(f'../../video{number}')


@pytest.fixture
def two(tmp_path):
    """A pair as it usually is: each camera with a second node for its metadata; and a vivid."""
    plug(tmp_path, 0, port='3-1.2', serial='S1')
    plug(tmp_path, 1, port='3-1.2', serial='S1', index=1)
    plug(tmp_path, 2, port='3-1.4', serial='00042', product='00AB')
    plug(tmp_path, 10, name='vivid')
    (tmp_path / 'sys/class/video4linux/vbi0').mkdir()
    return find_cameras(str(tmp_path))


def test_the_tree_is_read(two):
    assert [camera.node for camera in two] == [
        '/dev/video0',
        '/dev/video1',
        '/dev/video2',
        '/dev/video10',
    ]
    assert two[0] == Camera(
        node='/dev/video0',
        name='Lab',
        index=0,
        vendor_product='1209:0001',
        serial='S1',
        port='3-1.2',
        by_id='/dev/v4l/by-id/usb-Lab_S1-video-index0',
        by_path='/dev/v4l/by-path/pci-0-usb-0:3-1.2:1.0-video-index0',
        bus=3,
        address=2,
    )
    assert two[3] == Camera(node='/dev/video10', name='vivid')


def test_a_machine_without_cameras_has_none(tmp_path):
    assert find_cameras(str(tmp_path)) == []


def test_what_is_unplugged_while_we_look_is_not_there(two, tmp_path, monkeypatch):
    """udev and the kernel take entries away between the listing and the reading of them."""
    listed = usb.Path.iterdir

    def late(folder):
        yield from listed(folder)
        yield folder / 'video77'

    monkeypatch.setattr(usb.Path, 'iterdir', late)
    assert find_cameras(str(tmp_path)) == two

    def gone(folder):
        raise FileNotFoundError(errno.ENOENT, 'gone', str(folder))

    monkeypatch.setattr(usb.Path, 'iterdir', gone)
    assert find_cameras(str(tmp_path)) == []


@pytest.mark.parametrize(
    'name',
    [
        '/dev/video2',
        'video2',
        '2',
        '00042',
        'serial:00042',
        '1209:00ab',
        '1209:00AB',
        '3-1.4',
        '/dev/v4l/by-id/usb-Lab_00042-video-index0',
        'usb-Lab_00042-video-index0',
        '/dev/v4l/by-path/pci-0-usb-0:3-1.4:1.0-video-index0',
    ],
)
def test_a_camera_answers_to_every_kind_of_name(two, name):
    assert choose(name, two).node == '/dev/video2'


def test_a_link_of_the_users_own_is_followed(two, tmp_path):
    link = tmp_path / 'left_camera'
    link.symlink_to('/dev/video10')
    assert choose(str(link), two).node == '/dev/video10'


def test_a_device_with_several_nodes_is_its_first(two):
    assert choose('S1', two).node == '/dev/video0'
    assert choose('/dev/video1', two).node == '/dev/video1'


def test_an_absent_camera_is_named_with_those_present(two):
    with pytest.raises(CaptureError, match="camera 'S9' is not plugged in") as caught:
        choose('S9', two)
    assert caught.value.cause == errors.GONE
    assert '/dev/video0 (Lab, serial S1, 1209:0001 at port 3-1.2)' in str(caught.value)
    with pytest.raises(CaptureError, match='there are: none'):
        choose('S9', [])


def test_a_name_that_two_cameras_bear_is_refused(tmp_path):
    plug(tmp_path, 0, port='3-1', serial='SAME')
    plug(tmp_path, 2, port='3-2', serial='SAME')
    cameras = find_cameras(str(tmp_path))
    for name in ('SAME', '1209:0001'):
        with pytest.raises(CaptureError, match='could be any of') as caught:
            choose(name, cameras)
        assert '3-1' in str(caught.value)
        assert '3-2' in str(caught.value)
    assert choose('3-2', cameras).node == '/dev/video2'


class FakeUsb:
    """pyusb as far as a reset needs it."""

    def __init__(self, monkeypatch, error=None, present=True):
        self.calls = []
        core = types.ModuleType('usb.core')
        core.USBError = type('USBError', (OSError,), {})
        core.NoBackendError = type('NoBackendError', (ValueError,), {})
        core.find = lambda **where: self.find(where, present)
        package = types.ModuleType('usb')
        package.core = core
        monkeypatch.setitem(sys.modules, 'usb', package)
        monkeypatch.setitem(sys.modules, 'usb.core', core)
        self.error = core.USBError(error, 'refused') if isinstance(error, int) else error
        if error == 'backend':
            self.error = core.NoBackendError('No backend available')

    def find(self, where, present):
        self.calls.append(where)
        if type(self.error).__name__ == 'NoBackendError':
            raise self.error
        return self if present else None

    def reset(self):
        if self.error:
            raise self.error
        self.calls.append('reset')


def test_a_hung_device_is_reset_by_its_place_on_the_bus(two, monkeypatch):
    fake = FakeUsb(monkeypatch)
    usb.reset(two[2])
    assert fake.calls == [{'bus': 3, 'address': 4}, 'reset']


@pytest.mark.parametrize(
    ('error', 'words', 'cause'),
    [
        (errno.EACCES, 'udev rule config/99-binopos-cameras.rules', errors.DENIED),
        (errno.EIO, 'the reset failed', errors.FAILED),
        ('backend', 'libusb-1.0-0', errors.INVALID),
    ],
)
def test_a_reset_that_fails_says_why(two, monkeypatch, error, words, cause):
    FakeUsb(monkeypatch, error)
    with pytest.raises(CaptureError, match=words) as caught:
        usb.reset(two[2])
    assert caught.value.cause == cause


def test_a_reset_of_what_is_not_there_says_so(two, monkeypatch):
    FakeUsb(monkeypatch, present=False)
    with pytest.raises(CaptureError, match='left the USB bus'):
        usb.reset(two[2])
    with pytest.raises(CaptureError, match='not on USB'):
        usb.reset(two[3])
