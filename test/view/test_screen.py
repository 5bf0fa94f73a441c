"""What the page says is what the topics said."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from binopos_ros.view.metrics import feed, metrics_of, prometheus
from binopos_ros.view.screen import CURVE_LENGTH, Instant, Screen
from binopos_ros.view.status import status_text
from page_server import Message, diagnostics, header, health, pose

WALL = 1.7e9
STILL = np.diag([1e-6, 4e-6, 9e-6])


def at(seconds):
    return Instant(100.0 + seconds, WALL + seconds)


def track(screen, count, rate=30.0, late=0.02):
    """Poses at a rate, each that late; the last one's instant."""
    for number in range(count):
        stamp = int((WALL + number / rate) * 1e9)
        screen.take('target/pose', pose(stamp, (0.1, 0.2, 1.0), STILL), at(number / rate + late))
    return (count - 1) / rate + late


def texts(screen):
    return [each.text for each in screen.timeline.events.since(0)]


def test_the_newest_pose_with_its_deviations_rate_and_latency():
    screen = Screen()
    end = track(screen, 300)
    numbers = screen.numbers(at(end + 0.01))
    assert numbers['pose']['position'] == pytest.approx([0.1, 0.2, 1.0])
    assert numbers['pose']['deviation'] == pytest.approx([0.001, 0.002, 0.003])
    assert numbers['pose']['frame'] == 'left_camera_optical_frame'
    assert numbers['age'] == pytest.approx(0.01)
    assert numbers['rate'] == pytest.approx(30.0, rel=0.02)
    assert numbers['latency']['median'] == pytest.approx(0.02, abs=1e-3)


def test_the_rate_falls_and_the_age_grows_when_nothing_comes():
    screen = Screen()
    end = track(screen, 300)
    later = screen.numbers(at(end + 3.0))
    assert later['age'] == pytest.approx(3.0)
    assert later['rate'] < 20.0
    assert screen.numbers(at(end + 30.0))['rate'] == 0.0


def test_stamps_of_another_time_tell_no_latency():
    screen = Screen()
    screen.take('target/pose', pose(5 * 10**9, (0, 0, 1)), at(0.0))
    assert math.isnan(screen.numbers(at(0.0))['latency']['median'])


def test_the_curves_hold_two_minutes_and_no_more():
    screen = Screen()
    track(screen, 10 * 150, rate=10.0)
    points = screen.curves.since(0)
    span = points[-1][0] - points[0][0]
    assert CURVE_LENGTH * 0.95 < span < CURVE_LENGTH * 1.5
    assert points[-1][1:7] == pytest.approx((0.1, 0.2, 1.0, 0.001, 0.002, 0.003))


def test_a_reader_of_the_curves_gets_each_point_once():
    screen = Screen()
    track(screen, 60)
    first = screen.curves.since(0)
    seen = screen.curves.count
    assert screen.curves.since(seen) == []
    screen.take('target/pose', pose(int((WALL + 9) * 1e9), (0, 0, 1)), at(9.0))
    assert len(screen.curves.since(seen)) == 1
    assert len(screen.curves.since(0)) == len(first) + 1


def test_a_speed_has_its_deviation_along_the_motion():
    screen = Screen()
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.diag([4e-4, 1e-4, 1e-4])
    message = Message(
        header=header(1),
        twist=Message(
            twist=Message(linear=Message(x=0.3, y=0.0, z=0.0)), covariance=covariance.ravel()
        ),
    )
    screen.take('target/odometry', message, at(0.0))
    numbers = screen.numbers(at(0.1))
    assert (numbers['speed'], numbers['speed_std']) == pytest.approx((0.3, 0.02))
    assert math.isnan(screen.numbers(at(5.0))['speed'])


def test_lost_and_found_are_events_and_coasting_is_none():
    screen = Screen()
    words = ('starting', 'tracking', 'coasting', 'tracking', 'coasting', 'lost', 'tracking')
    for second, word in enumerate(words):
        screen.take('target/health', health(word, 'no position was used for 0.5 s'), at(second))
    assert texts(screen) == [
        'target found',
        'target lost: no position was used for 0.5 s',
        'target found',
    ]
    lost = screen.timeline.events.since(0)[1]
    assert lost.grade == 'alarm'
    assert 'pictures' in lost.remedy


def test_a_detector_that_is_switched_off_is_the_remedy():
    screen = Screen()
    screen.take('/diagnostics', diagnostics('detector', 3, 'no input', Enabled='False'), at(0))
    screen.take('target/health', health('lost', 'no position was used for 0.5 s'), at(0))
    assert 'press "Detector on"' in screen.numbers(at(0))['health']['remedy']


def test_a_smoother_that_says_nothing_any_more_is_no_tracking_target():
    screen = Screen()
    screen.take('target/health', health('tracking'), at(0.0))
    assert screen.numbers(at(1.0))['health']['word'] == 'tracking'
    assert screen.numbers(at(10.0))['health']['word'] == 'silent'


def test_an_unplugged_camera_is_an_event_with_its_remedy_once():
    screen = Screen()
    trouble = 'left: /dev/video0: cannot read: it is not plugged in; plug it in (again)'
    for second, (level, message) in enumerate(
        [(0, 'running'), (2, trouble), (2, trouble), (0, 'running')]
    ):
        screen.take('/diagnostics', diagnostics('camera', level, message), at(second))
    assert texts(screen) == [trouble, 'runs well again']


def test_a_node_that_waits_for_its_first_input_has_no_trouble():
    screen = Screen()
    screen.take('/diagnostics', diagnostics('detector', 3, 'no input'), at(0))
    assert texts(screen) == []
    screen.take('/diagnostics', diagnostics('detector', 0, 'running'), at(1))
    screen.take('/diagnostics', diagnostics('detector', 3, 'no input'), at(2))
    assert texts(screen) == ['no input']


def test_a_node_that_falls_silent_is_an_alarm():
    screen = Screen()
    screen.take('/diagnostics', diagnostics('detector', 0, 'running'), at(0))
    (node,) = screen.numbers(at(10))['nodes']
    assert node['level'] == 'silent'
    assert node['remedy']
    assert texts(screen) == ['says nothing any more']


def test_drops_by_node_and_reason_the_most_frequent_first():
    screen = Screen()
    values = {'Dropped: left: no circle': '3', 'Dropped: right: too dark': '7', 'Dropped': '10'}
    screen.take('/diagnostics', diagnostics('detector', 1, '2 dropped: x', **values), at(0))
    assert [(each['reason'], each['count']) for each in screen.numbers(at(0))['drops']] == [
        ('right: too dark', 7),
        ('left: no circle', 3),
    ]
    assert texts(screen) == []


def test_a_clock_that_jumps_back_is_an_event_and_begins_the_curves_anew():
    screen = Screen()
    end = track(screen, 60)
    screen.take('target/pose', pose(int((WALL - 100) * 1e9), (0, 0, 1)), at(end + 0.03))
    assert 'jumped back' in texts(screen)[-1]
    assert len(screen.curves.since(0)) == 1


def test_a_pose_that_is_not_finite_is_counted_and_not_shown():
    screen = Screen()
    screen.take('target/pose', pose(1, (math.nan, 0, 1)), at(0))
    numbers = screen.numbers(at(0))
    assert numbers['pose'] is None
    assert numbers['drops'] == [{'node': 'page', 'reason': 'pose is not finite', 'count': 1}]


def test_prometheus_and_the_feed_say_the_same_as_the_page():
    screen = Screen()
    end = track(screen, 60)
    screen.take('target/health', health('tracking'), at(end))
    values = {'Dropped: a "quoted" \\ reason': '4'}
    screen.take('/diagnostics', diagnostics('detector', 0, 'running', **values), at(end))
    numbers = screen.numbers(at(end))
    lines = prometheus(metrics_of(numbers)).splitlines()
    assert 'binopos_position_x_metres 0.1' in lines
    assert 'binopos_health{word="tracking"} 1.0' in lines
    told = [line for line in lines if line.startswith('binopos_dropped_total')]
    assert told == [
        'binopos_dropped_total{node="detector",reason="a \\"quoted\\" \\\\ reason"} 4.0'
    ]
    assert {'binopos_position_z_metres=1', 'binopos_health=tracking'} <= set(feed(numbers))


def test_an_old_position_is_no_metric_of_now():
    screen = Screen()
    end = track(screen, 60)
    numbers = screen.numbers(at(end + 2.0))
    assert 'binopos_position_x_metres NaN' in prometheus(metrics_of(numbers))
    assert not [line for line in feed(numbers) if 'position' in line]


def test_one_line_tells_health_rate_age_position_deviation_and_drops():
    screen = Screen()
    assert status_text(screen.numbers(at(0.0))) == 'nothing heard of the nodes yet'
    end = track(screen, 300)
    screen.take('target/health', health('tracking'), at(end))
    counts = {'Pairs': '307', 'Pairs: left: nothing red': '5', 'Pairs: overtaken': '2'}
    # Both pictures of each pair are counted, but the pair is lost once.
    counts['Dropped: left: nothing red'] = '10'
    screen.take('/diagnostics', diagnostics('detector', 0, '', **counts), at(end))
    told = status_text(screen.numbers(at(end + 0.1)))
    assert re.fullmatch(
        r'tracking  (29|30)/s  0\.1 s old  0\.1000 0\.2000 1\.0000 m ±1\.0 2\.0 3\.0 mm  '
        r'7 dropped, most: left: nothing red',
        told,
    ), told


def test_a_line_shows_no_position_of_some_time_ago():
    screen = Screen()
    end = track(screen, 30)
    screen.take('target/health', health('lost', 'no position was used for 2 s'), at(end + 2.0))
    told = status_text(screen.numbers(at(end + 2.0)))
    assert told.startswith('lost: no position was used for 2 s  ')
    assert '2.0 s old' in told
    assert ' m ' not in told
