"""The page of a live suite: what its viewers get is what was published."""

from __future__ import annotations

import asyncio
import json
import threading

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import CompressedImage, Image
from std_srvs.srv import Trigger
from websockets.asyncio.client import connect

from binopos_ros.bag import BagReader
from binopos_ros.detection.images import decode_jpeg
from binopos_ros.view.wire import read_picture_frame

pytestmark = pytest.mark.live

JPEG = b'\xff\xd8' + bytes(range(256)) * 400 + b'\xff\xd9'


class Browser:
    """A viewer in a thread of its own: keeps the newest of what it is sent."""

    def __init__(self, address):
        self.pictures, self.texts = {}, {}
        self._address = address.replace('http', 'ws') + 'ws'
        self._loop = asyncio.new_event_loop()
        self._opened = threading.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=[self._run()])
        self._thread.start()
        assert self._opened.wait(20)

    async def _run(self):
        async with connect(self._address) as self._socket:
            self._closing = asyncio.Event()
            self._opened.set()
            reading = asyncio.ensure_future(self._read())
            await self._closing.wait()
        await reading

    async def _read(self):
        async for message in self._socket:
            if isinstance(message, bytes):
                picture = read_picture_frame(message)
                self.pictures[picture.side] = picture.stamp, bytes(picture.jpeg)
            else:
                told = json.loads(message)
                self.texts[told['type']] = told

    def send(self, **request):
        words = json.dumps(request)
        asyncio.run_coroutine_threadsafe(self._socket.send(words), self._loop).result(20)

    def close(self):
        # The loop ends with the connection, and with it what would tell of the end.
        self._loop.call_soon_threadsafe(self._closing.set)
        self._thread.join()
        self._loop.close()


def press(peer, browser, name):
    browser.texts.pop('answer', None)
    browser.send(type='press', name=name)
    peer.wait_for(lambda: 'answer' in browser.texts, f'the answer to {name}')
    return browser.texts['answer']['well'], browser.texts['answer']['text']


def test_viewers_get_what_is_published_while_they_look(start, peer, tmp_path):
    poses = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    pictures = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    raw = peer.publisher(Image, 'right/image_raw')
    called = []

    def on_reset(_, response):
        called.append('reset')
        response.success, response.message = True, 'the target was forgotten'
        return response

    def on_parameters(request, response):
        values = {
            'interface.normal': ParameterValue(type=8, double_array_value=[0.0, 0.0, 1.0]),
            'interface.distance': ParameterValue(type=3, double_value=0.8),
        }
        response.values = [values[name] for name in request.names]
        return response

    peer.node.create_service(Trigger, 'smoother/reset', on_reset)
    peer.node.create_service(GetParameters, 'triangulator/get_parameters', on_parameters)
    node = start('viewer', parameters={'viewer': {'port': 0, 'folder': str(tmp_path)}})
    address = node.process.stdout.readline().split()[-1]
    # Nobody looks: nothing is heard.
    assert (poses.get_subscription_count(), pictures.get_subscription_count()) == (0, 0)
    browser = Browser(address)
    try:
        peer.wait_for(poses.get_subscription_count, 'a subscription to the pose')
        assert pictures.get_subscription_count() == 0
        browser.send(type='watch', pictures=True)
        peer.wait_for(
            lambda: pictures.get_subscription_count() and raw.get_subscription_count(),
            'subscriptions to both pictures',
        )
        pose = PoseWithCovarianceStamped()
        pose.header.stamp.sec, pose.header.stamp.nanosec = 1_700_000_000, 123_456_789
        pose.header.frame_id = 'map'
        pose.pose.pose.position.z = 1.25
        pose.pose.covariance[14] = 4e-6
        picture = CompressedImage(format='jpeg', data=JPEG)
        picture.header.stamp.sec = 77
        grey = Image(width=64, height=48, encoding='bgr8', step=192, data=bytes([90] * 9216))

        def all_came():
            poses.publish(pose)
            pictures.publish(picture)
            raw.publish(grey)
            told = browser.texts.get('state', {}).get('pose')
            return told and {'left', 'right'} <= browser.pictures.keys()

        peer.wait_for(all_came, 'the pose and both pictures')
        told = browser.texts['state']['pose']
        assert (told['stamp'], told['frame']) == ('1700000000123456789', 'map')
        assert told['position'] == [0.0, 0.0, 1.25]
        assert told['deviation'] == pytest.approx([0.0, 0.0, 0.002])
        # Not encoded again, to the last byte.
        assert browser.pictures['left'] == (77 * 10**9, JPEG)
        pixels = decode_jpeg(browser.pictures['right'][1])
        assert pixels.shape == (48, 64, 3)
        assert abs(int(pixels.mean()) - 90) <= 1

        peer.wait_for(lambda: 'surface' in browser.texts['state'], 'the surface')
        surface = browser.texts['state']['surface']
        assert surface == {'normal': [0.0, 0.0, 1.0], 'distance': 0.8}
        assert press(peer, browser, 'reset') == (True, 'the target was forgotten')
        assert called == ['reset']
        assert press(peer, browser, 'pause') == (
            False,
            'no recorder runs here; start one, then press again',
        )
        # What the detector draws is heard in the place of the cameras' pictures.
        drawings = peer.publisher(CompressedImage, 'left/overlay/compressed')
        browser.send(type='watch', pictures=True, drawn=True)
        peer.wait_for(drawings.get_subscription_count, 'a subscription to the overlay')
        drawing = CompressedImage(format='jpeg', data=b'\xff\xd8 drawn \xff\xd9')

        def drawing_came():
            drawings.publish(drawing)
            return browser.pictures['left'][1] == bytes(drawing.data)

        peer.wait_for(drawing_came, 'the overlay')
        browser.send(type='watch', pictures=True)
        peer.wait_for(pictures.get_subscription_count, 'a subscription to the picture again')
        # What `calibrate --live` sees is shown beside them.
        boards = peer.publisher(CompressedImage, 'calibration/overlay/compressed')

        def board_came():
            boards.publish(drawing)
            return browser.pictures.get('board', (0, b''))[1] == bytes(drawing.data)

        peer.wait_for(board_came, "the calibrator's overlay")
        # A still pair: both pictures of one instant, as they came.
        grey.header.stamp = picture.header.stamp
        pictures.publish(picture)
        raw.publish(grey)
        well, told = press(peer, browser, 'still')
        while not well:
            pictures.publish(picture)
            raw.publish(grey)
            picture.header.stamp.sec += 1
            grey.header.stamp = picture.header.stamp
            well, told = press(peer, browser, 'still')
        (left,) = (tmp_path / 'stills' / 'left').iterdir()
        (right,) = (tmp_path / 'stills' / 'right').iterdir()
        assert left.read_bytes() == JPEG
        assert left.name == right.name
        assert str(tmp_path / 'stills') in told
    finally:
        browser.close()
    peer.wait_for(
        lambda: not (poses.get_subscription_count() or pictures.get_subscription_count()),
        'the end of the subscriptions',
    )
    assert node.end() == (0, '')


def test_a_recording_is_begun_and_ended_on_the_page(start, peer, tmp_path):
    poses = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    node = start('viewer', parameters={'viewer': {'port': 0, 'folder': str(tmp_path)}})
    browser = Browser(node.process.stdout.readline().split()[-1])

    def recorder():
        poses.publish(PoseWithCovarianceStamped())
        return browser.texts.get('state', {}).get('recorder')

    def poses_on_disk():
        with BagReader(said['bag']) as bag:
            return '/stereo/target/pose' in bag.topics

    try:
        well, told = press(peer, browser, 'record')
        assert well, told
        peer.wait_for(lambda: recorder() and recorder()['duration'] > 0, 'the recorder')
        said = recorder()
        # The recorder's first messages may be the log's: the poses' are waited for.
        peer.wait_for(lambda: recorder() and poses_on_disk(), 'a pose in the recording')
        assert said['state'] == 'recording'
        assert said['bag'] in told
        assert said['free'] > 0
        assert press(peer, browser, 'record') == (
            False,
            'a recorder runs already: stop it first',
        )
        assert press(peer, browser, 'stop')[0]
        # Pressed again, it says that none runs, once the recorder has ended.
        peer.wait_for(lambda: not press(peer, browser, 'stop')[0], 'the end of the recorder')
    finally:
        browser.close()
    assert node.end()[0] == 0
    with BagReader(said['bag']) as bag:
        assert bag.topics['/stereo/target/pose'].count > 0
