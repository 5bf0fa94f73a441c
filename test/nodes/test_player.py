"""The player: what it plays, when, and what it refuses."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np
import pytest
import rclpy
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage
from std_msgs.msg import String
from std_srvs.srv import Trigger

from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from binopos_ros.bag.playback import PlayerOptions
from binopos_ros.bag.qos import Qos
from binopos_ros.nodes.playing import Player
from binopos_ros.optics import camera_info

pytestmark = pytest.mark.live

LEFT = '/stereo/left/image_raw/compressed'
RIGHT = '/stereo/right/image_raw/compressed'
CALIBRATION = '/stereo/left/camera_info'
START = 10**18
PERIOD = 20_000_000
PAIRS = 50

EVENT = 'example_interfaces/srv/AddTwoInts_Event'
PY = 'rosbag2-mcap/rosbag2_py/test/resources/mcap'
TESTS = 'rosbag2-mcap/rosbag2_tests/resources/mcap'
CPP = 'rosbag2-mcap/rosbag2_cpp/test/rosbag2_cpp/bags'


@pytest.fixture
def bag(tmp_path):
    """50 image pairs at 50 Hz, with a calibration at the start only."""
    info = camera_info.CameraInfo('left', 64, 48, 'plumb_bob', (0.0,) * 5, (50.0,) * 9)
    random = np.random.default_rng(3)
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(LEFT, messages.COMPRESSED_IMAGE)
        writer.add_topic(RIGHT, messages.COMPRESSED_IMAGE, qos=(Qos('best_effort'),))
        writer.add_topic(CALIBRATION, messages.CAMERA_INFO)
        writer.write(CALIBRATION, START, messages.camera_info(START, 'left', info))
        for number in range(PAIRS):
            stamp = START + number * PERIOD
            for topic in (LEFT, RIGHT):
                jpeg = random.bytes(1000)
                writer.write(topic, stamp, messages.compressed_image(stamp, topic, jpeg))
    return tmp_path / 'bag'


@pytest.fixture
def play(peer):
    """A player in this process: play(bag, option=...)."""
    node = rclpy.create_node('player', namespace='stereo', context=peer.context)
    opened = []

    def player(bag, **options):
        reader = BagReader(bag)
        played = Player(node, reader, PlayerOptions(**options))
        opened.append((played, reader))
        return played

    yield player
    for played, reader in opened:
        played.stop()
        reader.close()
    node.destroy_node()


def listen_raw(peer, message_type, topic):
    received = []
    peer.node.create_subscription(
        message_type,
        topic,
        received.append,
        QoSProfile(depth=200, reliability=rclpy.qos.QoSReliabilityPolicy.BEST_EFFORT),
        raw=True,
    )
    return received


def recorded(bag, topic):
    with BagReader(bag) as reader:
        return [record.data for record in reader.messages([topic])]


def test_every_message_arrives_unaltered_and_in_order_and_the_process_ends(start, peer, bag):
    left = listen_raw(peer, CompressedImage, LEFT)
    right = listen_raw(peer, CompressedImage, RIGHT)
    calibrations = listen_raw(peer, CameraInfo, CALIBRATION)
    node = start('player', parameters={'player': {'bag': str(bag)}})
    peer.wait_for(lambda: len(left) == len(right) == PAIRS, 'all the images')
    assert left == recorded(bag, LEFT)
    assert right == recorded(bag, RIGHT)
    # The transport pads messages to four bytes.
    (calibration,) = calibrations
    (sent,) = recorded(bag, CALIBRATION)
    assert calibration.rstrip(b'\0') == sent.rstrip(b'\0')
    status, log = node.wait()
    assert status == 0
    assert f'{2 * PAIRS + 1} messages played' in log


def test_messages_never_come_before_their_time(play, peer, bag):
    arrivals = []
    peer.node.create_subscription(
        CompressedImage,
        LEFT,
        lambda m: arrivals.append((messages.stamp_of(m), time.monotonic())),
        100,
    )
    listen_raw(peer, CompressedImage, RIGHT)
    peer.listen(CameraInfo, CALIBRATION)
    player = play(bag, rate=2.0)
    assert player.wall_time_of(START) is None
    player.start()
    peer.wait_for(lambda: len(arrivals) == PAIRS, 'all the images')
    for stamp, arrival in arrivals:
        assert player.wall_time_of(stamp) <= arrival
    length = player.wall_time_of(START + (PAIRS - 1) * PERIOD) - player.wall_time_of(START)
    assert length == pytest.approx((PAIRS - 1) * PERIOD * 1e-9 / 2.0)
    assert player.counts == {LEFT: PAIRS, RIGHT: PAIRS, CALIBRATION: 1}


def test_the_offered_quality_of_service_is_the_recorded_one(play, peer, bag):
    play(bag)
    offers = {}
    peer.wait_for(
        lambda: (
            offers.update(
                (topic, [i.qos_profile for i in peer.node.get_publishers_info_by_topic(topic)])
                for topic in (LEFT, RIGHT)
            )
            or all(offers.values())
        ),
        'the publishers',
    )
    assert offers[LEFT][0].reliability == rclpy.qos.QoSReliabilityPolicy.RELIABLE
    assert offers[RIGHT][0].reliability == rclpy.qos.QoSReliabilityPolicy.BEST_EFFORT


def test_topics_are_chosen_and_renamed(play, peer, bag):
    renamed = listen_raw(peer, CompressedImage, '/other/left')
    player = play(bag, topics=(LEFT,), remap=(f'{LEFT}:=/other/left',), rate=20.0)
    assert player.topics == [LEFT]
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    peer.wait_for(lambda: len(renamed) == PAIRS, 'the images')


def test_a_later_start_still_brings_the_calibration(play, peer, bag):
    left = listen_raw(peer, CompressedImage, LEFT)
    listen_raw(peer, CompressedImage, RIGHT)
    calibrations = listen_raw(peer, CameraInfo, CALIBRATION)
    player = play(bag, start_offset=0.5, rate=20.0)
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    peer.wait_for(lambda: len(left) == PAIRS - 25 and len(calibrations) == 1, 'the rest')
    assert left == recorded(bag, LEFT)[25:]


def test_a_start_behind_the_end_is_an_error_in_one_line(play, peer, bag):
    player = play(bag, start_offset=100.0, wait_for_subscribers=0.0)
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    assert 'start offset 100 s lies behind the end of the bag, which is 1.0 s long' in player.error


def test_the_clock_is_the_bags(play, peer, bag):
    clocks = peer.listen(Clock, '/clock')
    peer.listen(CompressedImage, LEFT)
    listen_raw(peer, CompressedImage, RIGHT)
    peer.listen(CameraInfo, CALIBRATION)
    player = play(bag, clock=200.0)
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    times = [c.clock.sec * 10**9 + c.clock.nanosec for c in clocks]
    assert len(times) > 50
    assert times == sorted(times)
    assert times[0] >= START
    assert times[-1] <= START + PAIRS * PERIOD


def test_a_paused_bag_is_stepped_and_resumed_by_services(start, peer, bag):
    left = listen_raw(peer, CompressedImage, LEFT)
    node = start(
        'player', parameters={'player': {'bag': str(bag), 'start_paused': True, 'topics': [LEFT]}}
    )

    def call(name):
        client = peer.node.create_client(Trigger, f'player/{name}')
        peer.wait_for(client.service_is_ready, f'the service {name}')
        answer = client.call_async(Trigger.Request())
        peer.wait_for(answer.done, f'the answer of {name}')
        return answer.result().success, answer.result().message

    assert call('is_paused') == (True, 'paused')
    # The player waits for its subscribers first, and for them to see it.
    peer.wait_for(lambda: peer.node.count_publishers(LEFT) == 1, 'the publisher')
    for count in (1, 2, 3):
        assert call('play_next') == (True, 'one message played')
        peer.wait_for(lambda count=count: len(left) == count, f'message {count}')
    assert call('resume') == (True, 'playing')
    assert call('play_next')[0] is False
    assert call('toggle_paused') == (True, 'paused')
    seen = len(left)
    assert seen < PAIRS
    assert call('resume') == (True, 'playing')
    peer.wait_for(lambda: len(left) == PAIRS, 'the rest')
    assert left == recorded(bag, LEFT)
    assert node.wait()[0] == 0


def test_a_looping_bag_begins_again_and_ends_when_told_to(start, peer, bag):
    left = listen_raw(peer, CompressedImage, LEFT)
    node = start(
        'player',
        parameters={'player': {'bag': str(bag), 'loop': True, 'rate': 20.0, 'topics': [LEFT]}},
    )
    peer.wait_for(lambda: len(left) > 2 * PAIRS + 5, 'the third round')
    assert left[PAIRS : 2 * PAIRS] == left[:PAIRS]
    status, log = node.end()
    assert status == 0
    assert 'Traceback' not in log


@pytest.mark.parametrize(
    ('bag', 'topic', 'count'), [(f'{PY}/talker', '/topic', 10), (f'{PY}/wbag', '/AAA', 804)]
)
def test_bags_of_rosbag2_play(play, peer, shared_data, bag, topic, count):
    texts = listen_raw(peer, String, topic)
    player = play(shared_data / bag, topics=(topic,), rate=100.0)
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    assert sum(player.counts.values()) == count
    if count < 200:
        peer.wait_for(lambda: len(texts) == count, 'the messages')


def test_what_cannot_be_played_is_skipped_with_its_reason(play, shared_data):
    player = play(shared_data / CPP / 'topics_and_services.mcap')
    assert set(player.topics) == {'/parameter_events', '/rosout'}
    assert player.skipped == {
        '/add_two_ints/_service_event': f'message type {EVENT} is not installed',
        '/add_two_ints2/_service_event': f'message type {EVENT} is not installed',
        '/events/write_split': 'message type rosbag2_interfaces/msg/WriteSplitEvent '
        'is not installed',
    }


@pytest.mark.parametrize(
    ('bag', 'reason'),
    [
        (f'{TESTS}/wrong_rmw_test', "encoded as 'wrong_format', not as 'cdr'"),
        (f'{TESTS}/cdr_test', 'test_msgs/msg/BasicTypes is not installed'),
        (f'{CPP}/only_services.mcap', 'nothing to play'),
    ],
)
def test_a_bag_of_which_nothing_can_be_played_is_refused(play, shared_data, bag, reason):
    with pytest.raises(BagError, match=reason) as refusal:
        play(shared_data / bag)
    assert '\n' not in str(refusal.value)


def test_what_a_live_node_publishes_is_not_played_over_it(play, peer, bag):
    """A recorded dive beside the live suite doubles nothing."""
    peer.publisher(CompressedImage, RIGHT)
    left = listen_raw(peer, CompressedImage, LEFT)
    right = listen_raw(peer, CompressedImage, RIGHT)
    player = play(bag, rate=20.0, wait_for_subscribers=2.0)
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    peer.wait_for(lambda: len(left) == PAIRS, 'the images')
    assert right == []
    assert player.skipped == {RIGHT: '/stereo/test_peer publishes it already'}


def test_a_bag_plays_without_listeners_too(play, peer, bag):
    player = play(bag, wait_for_subscribers=0.2, rate=50.0)
    player.start()
    peer.wait_for(player.finished.is_set, 'the end')
    assert Counter(player.counts).total() == 2 * PAIRS + 1
    assert player.error == ''


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({}, "set the parameter 'bag'"),
        ({'bag': '/no/such/bag'}, 'no such bag'),
        ({'bag': 'BAG', 'rate': 0.0}, 'must lie in'),
        ({'bag': 'BAG', 'topics': ['/nothing']}, 'no topic /nothing in this bag'),
        ({'bag': 'BAG', 'remap': ['/a']}, 'write FROM:=TO'),
    ],
)
def test_bad_parameters_are_one_line_and_status_2(start, bag, values, words):
    values = {key: str(bag) if value == 'BAG' else value for key, value in values.items()}
    status, log = start('player', parameters={'player': values}).wait()
    assert status == 2
    assert words in log
    assert log.count('\n') == 1
