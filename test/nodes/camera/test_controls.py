"""The cameras' controls as parameters of the node."""

from __future__ import annotations

from rcl_interfaces.srv import DescribeParameters


def test_controls_are_parameters_with_their_range_and_menu(rig, call, set_parameter):
    rig.start(**{'left.controls.gain': 40})
    left, right = rig.cameras.values()
    assert left.controls[0].value == 40
    assert right.controls[0].value == 35
    names = ['left.controls.gain', 'left.controls.auto_exposure']
    gain, exposure = call(
        DescribeParameters,
        'camera/describe_parameters',
        DescribeParameters.Request(names=names),
    ).descriptors
    assert (gain.integer_range[0].from_value, gain.integer_range[0].to_value) == (-1, 95)
    assert '1: Manual Mode, 3: Aperture Priority Mode' in exposure.description
    assert set_parameter('left.controls.gain', 60).successful
    assert left.controls[0].value == 60
    refused = set_parameter('left.controls.gain', 61)
    assert not refused.successful
    assert 'steps of 5' in refused.reason
    assert set_parameter('left.controls.gain', -1).successful
    assert left.controls[0].value == 60


def test_exposure_and_gain_are_kept_equal(rig, peer):
    node = rig.start(lock_exposure=True)
    left, right = rig.cameras.values()
    left.controls[0].value, left.controls[2].value = 70, 1234
    peer.wait_for(
        lambda: (right.controls[0].value, right.controls[2].value) == (70, 1234), 'equality'
    )
    assert right.controls[1].value == 1
    assert left.controls[1].value == 3
    assert node.get_parameter('lock_exposure').value
