"""The camera node stays up: lost, late, exchanged and stopped cameras, damaged frames."""

from __future__ import annotations

from dataclasses import replace

from sensor_msgs.msg import CompressedImage
from std_srvs.srv import SetBool

from binopos_ros.capture.identity import memory_file, recall


def test_a_lost_camera_is_told_and_comes_back_while_the_other_goes_on(rig, peer, diagnosed):
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rights = peer.listen(CompressedImage, 'right/image_raw/compressed')
    rig.start()
    peer.wait_for(lambda: lefts and rights, 'images')
    rig.unplug(rig.right)
    peer.wait_for(
        lambda: 'is unplugged; plug it in again' in diagnosed().message,
        'the word of the loss',
    )
    status = diagnosed()
    assert status.level == b'\x02'
    assert status.values['right: state'] == 'lost'
    assert status.values['left: state'] == 'streaming'
    count = len(lefts)
    peer.wait_for(lambda: len(lefts) > count + 3, 'further left images')
    rights.clear()
    rig.plug(rig.right)
    peer.wait_for(lambda: len(rights) > 3, 'right images again')
    peer.wait_for(lambda: diagnosed().level == b'\x00', 'the all-clear')
    values = diagnosed().values
    assert values['right: losses'] == '1 gone'
    assert float(values['right: last recovery (s)']) <= float(values['right: last outage (s)'])
    assert int(values['Pairs']) > 0
    assert 'Pair skew, median (ms)' in values


def test_a_camera_missing_at_the_start_is_taken_up_with_its_controls(rig, peer):
    rig.unplug(rig.right)
    rights = peer.listen(CompressedImage, 'right/image_raw/compressed')
    node = rig.start(**{'right.controls.gain': 45})
    rig.plug(rig.right)
    peer.wait_for(lambda: rights, 'right images')
    assert rig.cameras[rig.right].controls[0].value == 45
    peer.wait_for(lambda: node.has_parameter('right.controls.auto_exposure'), 'the controls')
    assert node.get_parameter('right.controls.gain').value == 45


def test_a_control_that_a_late_camera_does_not_take_is_left_alone(rig, peer):
    rig.unplug(rig.right)
    rights = peer.listen(CompressedImage, 'right/image_raw/compressed')
    rig.start(**{'right.controls.gain': 999})
    rig.plug(rig.right)
    peer.wait_for(lambda: rights, 'right images')
    assert rig.cameras[rig.right].controls[0].value == 35


def test_damaged_jpegs_are_dropped_with_the_reason(rig, peer, diagnosed):
    whole = rig.cameras[rig.left].picture
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rig.start()
    peer.wait_for(lambda: lefts, 'images')
    rig.cameras[rig.left].picture = whole[: len(whole) // 2]
    peer.wait_for(
        lambda: int(diagnosed().values.get('Dropped: left: JPEG cut short', 0)) > 0,
        'the drops',
    )
    rig.cameras[rig.left].picture = b'\0\0' + whole
    peer.wait_for(
        lambda: int(diagnosed().values.get('Dropped: left: not a JPEG', 0)) > 0, 'the drops'
    )
    assert all(bytes(message.data) == whole for message in lefts)


def test_capture_stops_and_starts_by_service(rig, peer, call):
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rig.start()
    peer.wait_for(lambda: lefts, 'images')
    answer = call(SetBool, 'stop_capture', SetBool.Request(data=True))
    assert (answer.success, answer.message) == (True, 'stopped')
    assert rig.kernel.leaks == {'descriptors': 0, 'mappings': 0, 'streams': 0}
    lefts.clear()
    answer = call(SetBool, 'start_capture', SetBool.Request(data=True))
    assert (answer.success, answer.message) == (True, 'capturing')
    peer.wait_for(lambda: lefts, 'images again')


def test_an_exchange_since_the_last_run_is_noticed(rig, peer, diagnosed):
    rig.start(**{'left.device': '/dev/video0', 'right.device': '/dev/video2'})
    peer.wait_for(lambda: diagnosed().level is not None, 'diagnostics')
    peer.wait_for(lambda: recall(memory_file()), 'the memory')
    rig.stop()
    rig.plugged = {
        replace(rig.left, node='/dev/video2'): None,
        replace(rig.right, node='/dev/video0'): None,
    }
    rig.start(**{'left.device': '/dev/video0', 'right.device': '/dev/video2'})
    peer.wait_for(
        lambda: 'left and right have changed places' in diagnosed().message,
        'the word of the exchange',
    )
