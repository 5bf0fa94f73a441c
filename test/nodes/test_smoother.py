"""The smoother node: pose and odometry out, foretold while the target is out of sight, reset."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.nodes.messages import header, pose_message

pytestmark = pytest.mark.live

PERIOD = 33_333_333
HOUR = 3600 * 10**9
COVARIANCE = np.diag([1e-8, 1e-8, 1e-6])


def position(stamp: int, x: float) -> PoseWithCovarianceStamped:
    return pose_message(stamp, 'left_camera', (x, 0.1, 1.2), COVARIANCE)


def test_a_moving_target_gives_its_pose_its_velocity_and_markers(start, peer):
    start('smoother', parameters={'triangulator': {'target.diameter': 0.06}})
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    poses = peer.listen(PoseWithCovarianceStamped, 'target/pose')
    odometry = peer.listen(Odometry, 'target/odometry')
    markers = peer.listen(MarkerArray, 'target/markers')
    peer.connect(positions, inputs=('target/pose', 'target/odometry', 'target/markers'))
    speed = 0.15
    for k in range(120):
        positions.publish(position(k * PERIOD, speed * k * PERIOD * 1e-9))
        peer.wait_for(lambda k=k: len(poses) > k, f'pose {k}')
    peer.wait_for(lambda: len(odometry) == len(markers) == 120, 'odometry and markers')
    assert [stamp_of(message) for message in poses] == [k * PERIOD for k in range(120)]
    last = odometry[-1]
    assert last.header.frame_id == 'left_camera'
    assert last.child_frame_id == 'target'
    expected = np.array([speed * 119 * PERIOD * 1e-9, 0.1, 1.2])
    np.testing.assert_allclose(position_of(last), expected, atol=1e-3)
    assert abs(last.twist.twist.linear.x - speed) < 0.02
    np.testing.assert_array_equal(position_of(last), position_of(poses[-1]))
    assert np.linalg.eigvalsh(covariance_of(last)).min() > 0
    ball, ellipsoid = markers[-1].markers
    assert ball.pose.position == last.pose.pose.position
    # The target's depth is known worst, so the ellipsoid is longest along z.
    lengths = [ellipsoid.scale.x, ellipsoid.scale.y, ellipsoid.scale.z]
    assert max(lengths) > 2 * min(lengths) > 0
    # Of the target's size, which the triangulator was told; the ellipsoid shines through.
    assert ball.scale.x == 0.06
    assert ball.color.a < 1.0
    assert 0.0 < ball.lifetime.sec + 1e-9 * ball.lifetime.nanosec <= 0.5
    # No more positions: the target is lost, and its markers go.
    peer.wait_for(lambda: len(markers) > 120, 'the end of the markers')
    assert markers[-1].markers[0].action == Marker.DELETEALL


def test_at_a_fixed_rate_the_pose_is_foretold_for_the_sensor_timeout_and_then_stops(start, peer):
    values = {'output_rate': 50.0, 'sensor_timeout': 3.0}
    start('smoother', parameters={'smoother': values})
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    poses = peer.listen(PoseWithCovarianceStamped, 'target/pose')
    peer.connect(positions, inputs=('target/pose',))
    begin = time.time_ns()
    last = begin
    for k in range(30):
        last = begin + k * PERIOD
        peer.wait_for(lambda stamp=last: time.time_ns() >= stamp, 'the next frame')
        positions.publish(position(last, 0.0))

    def after() -> list[PoseWithCovarianceStamped]:
        return [message for message in poses if stamp_of(message) > last + PERIOD]

    # A seventh of those due: a busy machine may leave ticks out, but not all of them.
    peer.wait_for(lambda: len(after()) > 20, 'poses foretold')
    peer.wait_for(lambda: time.time_ns() > last + 4_500_000_000, 'silence')
    assert stamp_of(after()[-1]) <= last + 3_000_000_000
    variances = [np.trace(covariance_of(message)[:3, :3]) for message in after()]
    assert variances == sorted(variances)


def test_a_clock_that_stands_gives_no_pose_of_its_stamp_a_second_time(start, peer):
    start('smoother', parameters={'smoother': {'output_rate': 200.0, 'use_sim_time': True}})
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    clock = peer.publisher(Clock, '/clock')
    poses = peer.listen(PoseWithCovarianceStamped, 'target/pose')
    peer.connect(positions, clock, inputs=('target/pose',))
    now = 0

    def ticked(known: int) -> bool:
        """Let a millisecond pass, and say so more than once."""
        nonlocal now
        now += 1_000_000
        seconds, nanoseconds = divmod(now, 1_000_000_000)
        for _ in range(4):
            clock.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))
        return len(poses) > known

    for k in range(1, 31):
        now = max(now, k * PERIOD)
        positions.publish(position(k * PERIOD, 0.0))
        known = len(poses)
        if k > 2:
            peer.wait_for(lambda known=known: ticked(known), f'a pose after frame {k}')
    stamps = [stamp_of(message) for message in poses]
    assert len(stamps) > 20
    assert stamps == sorted(set(stamps))


def test_a_wrong_position_is_refused_counted_and_not_followed(start, peer):
    start('smoother')
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    poses = peer.listen(PoseWithCovarianceStamped, 'target/pose')
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    peer.connect(positions, inputs=('target/pose',))
    for k in range(40):
        positions.publish(position(k * PERIOD, 10.0 if k == 35 else 0.0))
        peer.wait_for(lambda k=k: len(poses) > k, f'pose {k}')
    worst = max(abs(position_of(message)[0]) for message in poses)
    assert worst < 1e-3

    def values() -> dict[str, str]:
        return {v.key: v.value for a in diagnostics for s in a.status for v in s.values}

    peer.wait_for(lambda: values().get('Dropped') == '1', 'the drop')


def test_reset_forgets_the_target(start, peer):
    start('smoother')
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    poses = peer.listen(PoseWithCovarianceStamped, 'target/pose')
    peer.connect(positions, inputs=('target/pose',))
    for k in range(10):
        positions.publish(position(k * PERIOD, 0.0))
    peer.wait_for(lambda: len(poses) == 10, 'the poses')
    client = peer.node.create_client(Trigger, 'smoother/reset')
    peer.wait_for(client.service_is_ready, 'the service')
    answer = client.call_async(Trigger.Request())
    peer.wait_for(answer.done, 'the answer')
    assert answer.result().success
    # Far from where the target was: refused before, the first of a new track now.
    positions.publish(position(10 * PERIOD, 5.0))
    peer.wait_for(lambda: len(poses) == 11, 'the pose after the reset')
    assert abs(position_of(poses[-1])[0] - 5.0) < 1e-6


def robot(stamp: int, y: float) -> Odometry:
    message = Odometry(header=header(stamp, 'odom'), child_frame_id='base_link')
    message.pose.pose.position.y = y
    message.pose.covariance = np.diag([1e-8] * 6).ravel()
    return message


FIXED = {
    'fixed_frame': 'odom',
    'platform.source': 'odometry',
    'platform.mounting': [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0],
}


def test_in_a_fixed_frame_positions_wait_for_the_robot_and_a_target_at_rest_stands_still(
    start, peer
):
    start('smoother', parameters={'smoother': {**FIXED, 'platform.timeout': 10.0}})
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    odometry = peer.publisher(Odometry, 'platform/odometry')
    poses = peer.listen(PoseWithCovarianceStamped, 'target/pose')
    plain = peer.listen(PoseStamped, 'target/pose_stamped')
    peer.connect(positions, odometry, inputs=('target/pose', 'target/pose_stamped'))
    for k in range(20):
        # The robot moves aside by a centimetre a frame, and the target in its pictures back.
        odometry.publish(robot(k * PERIOD, 0.01 * k))
        moved = 0.01 * (k - 0.5)
        positions.publish(
            pose_message(k * PERIOD - PERIOD // 2, 'left', (0.2, 0.1 - moved, 1.2), COVARIANCE)
        )
        # The first lies before all that is known of the robot.
        peer.wait_for(lambda k=k: len(poses) == len(plain) == k, f'pose {k}')
    for message in poses:
        assert message.header.frame_id == 'odom'
        np.testing.assert_allclose(position_of(message), [0.2, 0.1, 1.7], atol=1e-6)
    np.testing.assert_array_equal(position_of(plain[-1]), position_of(poses[-1]))
    # A bag that is played in a loop: all begins again, an hour earlier.
    poses.clear()
    again = itertools.count()

    def go_on() -> bool:
        k = next(again)
        odometry.publish(robot(k * PERIOD - HOUR, 0.01 * k))
        seen = (0.2, 0.1 - 0.01 * k, 1.2)
        positions.publish(pose_message(k * PERIOD - HOUR, 'left', seen, COVARIANCE))
        return bool(poses)

    peer.wait_for(go_on, 'a pose of the next round')
    assert stamp_of(poses[0]) < 0
    np.testing.assert_allclose(position_of(poses[0]), [0.2, 0.1, 1.7], atol=1e-6)


def test_what_gets_no_pose_of_the_robot_is_dropped_with_its_reason(start, peer):
    start('smoother', parameters={'smoother': FIXED})
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    odometry = peer.publisher(Odometry, 'platform/odometry')
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    peer.connect(positions, odometry, inputs=('target/pose',))
    stranger = robot(0, 0.0)
    stranger.header.frame_id = 'map'
    odometry.publish(stranger)
    positions.publish(position(0, 0.0))

    def values() -> dict[str, str]:
        return {v.key: v.value for a in diagnostics for s in a.status for v in s.values}

    peer.wait_for(lambda: 'Dropped: the odometry has not come yet' in values(), 'the drop')
    assert values()["Refused: the odometry is in the frame 'map', not in 'odom'"] == '1'


def test_the_target_s_health_goes_from_starting_to_tracking_to_lost(start, peer):
    start('smoother', parameters={'smoother': {'health.max_std': 0.01}})
    positions = peer.publisher(PoseWithCovarianceStamped, 'target/position')
    told = peer.listen(DiagnosticStatus, 'target/health')
    peer.connect(positions, inputs=('target/health',))
    peer.wait_for(lambda: bool(told), 'the first word')
    assert told[-1].message == 'starting'
    positions.publish(position(0, 0.0))
    peer.wait_for(lambda: any(each.message == 'tracking' for each in told), 'tracking')
    peer.wait_for(lambda: told[-1].message == 'lost', 'its loss')
    words = [each.message for each in told]
    assert words.index('tracking') < words.index('lost')
    assert told[-1].level == DiagnosticStatus.ERROR
    values = {each.key: each.value for each in told[-1].values}
    assert float(values['Age of the last position (s)']) > 0.5
    assert 'no position was used' in values['Reason']
    # One that is known worse than the limit.
    positions.publish(pose_message(50 * PERIOD, 'left_camera', (0, 0, 1), 1e4 * COVARIANCE))
    peer.wait_for(lambda: any(each.message == 'degraded' for each in told), 'degraded')
