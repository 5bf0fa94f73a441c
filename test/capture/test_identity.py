"""Left stays left: over ports, numbers, and runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from binopos_ros.capture.identity import (
    Identity,
    exchanged,
    find_again,
    memory_file,
    recall,
    remember,
)
from binopos_ros.capture.usb import Camera

LEFT = Camera('/dev/video0', 'Lab', 0, '1209:0001', 'S1', '3-1')
RIGHT = Camera('/dev/video2', 'Lab', 0, '1209:0001', 'S2', '3-2')
METADATA = replace(LEFT, node='/dev/video1', index=1)
VIVID = Camera('/dev/video9', 'vivid')


def test_a_camera_with_a_serial_is_found_on_any_port_under_any_number():
    identity = Identity.of(LEFT)
    moved = replace(LEFT, node='/dev/video7', port='1-4')
    other_at_its_port = replace(RIGHT, port='3-1')
    assert find_again(identity, [METADATA, other_at_its_port, moved]) == moved


def test_another_camera_at_its_port_is_not_taken_for_it():
    identity = Identity.of(LEFT)
    assert find_again(identity, [replace(RIGHT, port='3-1')]) is None


def test_cameras_that_share_a_serial_are_kept_apart_by_their_ports():
    left, right = replace(LEFT, serial='0001'), replace(RIGHT, serial='0001')
    renumbered = [replace(right, node='/dev/video0'), replace(left, node='/dev/video2')]
    assert find_again(Identity.of(left), renumbered) == renumbered[1]
    # Neither is taken for the other while that one is away, whoever looks first.
    for own, other in ((left, right), (right, left)):
        assert find_again(Identity.of(own), [other], [Identity.of(other)]) is None
        moved = replace(own, port='1-4', node='/dev/video7')
        assert find_again(Identity.of(own), [other, moved], [Identity.of(other)]) == moved


def test_a_camera_is_not_lost_in_what_the_kernel_still_lists_where_it_was():
    """While one is moved, the kernel lists it at both ports for an instant."""
    here, there = LEFT, replace(LEFT, node='/dev/video4', port='3-2')
    identity, right = Identity.of(LEFT), Identity.of(RIGHT)
    assert find_again(identity, [here, there], [right]) == here
    assert find_again(identity, [there], [right]) == there
    # What then comes to its old port is another camera.
    identity = Identity.of(find_again(identity, [here, there], [right]))
    exchanged_right = replace(RIGHT, node='/dev/video0', port='3-1')
    assert find_again(identity, [exchanged_right]) is None
    assert find_again(identity, [exchanged_right, there]) == there


def test_without_a_serial_the_only_free_camera_of_the_model_is_it():
    left, right = replace(LEFT, serial=''), replace(RIGHT, serial='')
    identity = Identity.of(left)
    moved = replace(left, node='/dev/video4', port='3-3')
    assert find_again(identity, [right, moved], [Identity.of(right)]) == moved
    assert find_again(identity, [right, moved]) is None
    assert find_again(identity, [replace(moved, vendor_product='046d:0825')]) is None


def test_a_camera_that_is_not_on_usb_is_its_node():
    identity = Identity.of(VIVID)
    assert find_again(identity, [LEFT, VIVID]) == VIVID
    assert find_again(identity, [LEFT]) is None


def test_an_exchange_of_left_and_right_is_noticed():
    before = {'left': Identity.of(LEFT), 'right': Identity.of(RIGHT)}
    assert exchanged(before, {'left': before['right'], 'right': before['left']})
    assert not exchanged(before, before)
    assert not exchanged({}, before)
    nameless = {side: replace(one, serial='') for side, one in before.items()}
    assert not exchanged(nameless, {'left': nameless['right'], 'right': nameless['left']})


def test_identities_outlast_the_run(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros'))
    identities = {'left': Identity.of(LEFT)}
    assert recall(memory_file()) == {}
    remember(memory_file(), identities)
    assert recall(memory_file()) == identities
    monkeypatch.delenv('ROS_HOME')
    monkeypatch.setenv('HOME', str(tmp_path))
    assert memory_file() == tmp_path / '.ros/binopos_cameras.json'


@pytest.mark.parametrize('text', ['', '[]', '{"left": 3}', '{"left": {"colour": 1}}', '\0'])
def test_an_unreadable_memory_is_no_memory(tmp_path, text):
    path = tmp_path / 'memory.json'
    path.write_text(text)
    assert recall(path) == {}
