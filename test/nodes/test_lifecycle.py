"""Every node starts with defaults or a clear refusal, says how it is, and ends when told to."""

from __future__ import annotations

import signal
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter

pytestmark = pytest.mark.live

NODES = {'detector': {}, 'triangulator': {'method': 'straight'}, 'smoother': {}}


def statuses(arrays, name):
    return [s for array in arrays for s in array.status if s.name == f'stereo/{name}: stage']


@pytest.mark.parametrize('name', NODES)
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
def test_a_node_reports_that_it_waits_and_ends_when_it_is_told(start, peer, name, number):
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    node = start(name, parameters={name: NODES[name]})
    peer.wait_for(lambda: bool(statuses(diagnostics, name)), 'a diagnostic')
    status = statuses(diagnostics, name)[0]
    assert status.level == DiagnosticStatus.STALE
    assert status.message == 'no input'
    assert {'Published', 'Dropped', 'Actual frequency (Hz)'} <= {v.key for v in status.values}
    assert node.end(number) == (0, '')


@pytest.mark.parametrize('start_up', [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.9])
def test_a_node_that_is_told_to_end_while_it_starts_says_nothing(start, start_up):
    """The moment falls before, in and after the slow imports, wherever the machine is by then."""
    node = start('smoother')
    time.sleep(start_up)
    node.process.send_signal(signal.SIGTERM)
    status, errors = node.wait()
    assert errors == ''
    assert status in (0, -signal.SIGTERM)


@pytest.mark.parametrize(
    ('name', 'values', 'words'),
    [
        ('smoother', {'max_jmp': 1.0}, "unknown parameter 'max_jmp': did you mean 'max_jump'?"),
        ('smoother', {'sensor_timeout': -1.0}, 'it must lie in 0.0 .. 60.0'),
        ('smoother', {'method': 'magic'}, 'choose one of'),
        ('triangulator', {}, 'needs an interface'),
        ('triangulator', {'interface.indices': [1.0, 1.3]}, 'interface.normal is missing'),
        (
            'triangulator',
            {'interface.normal': [0.0, 0.0, 1.0], 'interface.indices': [1.0, 0.9]},
            'interface.indices',
        ),
        (
            'triangulator',
            {'interface.normal': [0.0, 0.0, 1.0], 'interface.indices': [1.0, 1.3]},
            'ahead of the camera',
        ),
        ('detector', {'min_diameter': 'small'}, 'min_diameter'),
        ('detector', {'min_diameter': 50.0, 'max_diameter': 20.0}, 'must not exceed'),
        (
            'detector',
            {'qos_overrides./stereo/left/centroid.publisher.durability': 'transient-local'},
            'qos_overrides./stereo/left/centroid',
        ),
    ],
)
def test_a_bad_parameter_is_one_line_and_status_2(start, name, values, words):
    status, errors = start(name, parameters={name: values}).wait()
    assert status == 2
    assert words in errors
    assert errors.startswith(f'{name}: ')
    assert errors.count('\n') == 1


def test_parameters_change_at_run_time_only_to_what_fits_together(start, peer):
    start('detector')
    describe = peer.node.create_client(DescribeParameters, 'detector/describe_parameters')
    change = peer.node.create_client(SetParameters, 'detector/set_parameters')
    peer.wait_for(lambda: describe.service_is_ready() and change.service_is_ready(), 'services')

    asked = describe.call_async(DescribeParameters.Request(names=['min_diameter']))
    peer.wait_for(asked.done, 'the description')
    (descriptor,) = asked.result().descriptors
    assert '[px]' in descriptor.description
    assert descriptor.floating_point_range[0].from_value == 3.0

    def set_to(value):
        parameter = Parameter('min_diameter', value=value).to_parameter_msg()
        answer = change.call_async(SetParameters.Request(parameters=[parameter]))
        peer.wait_for(answer.done, 'the answer')
        return answer.result().results[0]

    assert set_to(12.0).successful
    refused = set_to(3500.0)
    assert not refused.successful
    assert 'must not exceed' in refused.reason
