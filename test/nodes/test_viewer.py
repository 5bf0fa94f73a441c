"""The page of a live suite: what its viewers get is what was published."""

from __future__ import annotations

import asyncio
import json
import threading

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CompressedImage, Image
from std_srvs.srv import Trigger
from websockets.asyncio.client import connect

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


def test_viewers_get_what_is_published_while_they_look(start, peer):
    poses = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    pictures = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    raw = peer.publisher(Image, 'right/image_raw')
    called = []

    def on_reset(_, response):
        called.append('reset')
        response.success, response.message = True, 'the target was forgotten'
        return response

    peer.node.create_service(Trigger, 'smoother/reset', on_reset)
    node = start('viewer', parameters={'viewer': {'port': 0}})
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

        browser.send(type='press', name='reset')
        peer.wait_for(lambda: 'answer' in browser.texts, 'the answer to a button')
        assert called == ['reset']
        answer = browser.texts.pop('answer')
        assert (answer['well'], answer['text']) == (True, 'the target was forgotten')
        browser.send(type='press', name='record')
        peer.wait_for(lambda: 'answer' in browser.texts, 'the answer to another')
        assert not browser.texts['answer']['well']
        assert 'no recorder runs' in browser.texts['answer']['text']
    finally:
        browser.close()
    peer.wait_for(
        lambda: not (poses.get_subscription_count() or pictures.get_subscription_count()),
        'the end of the subscriptions',
    )
    assert node.end() == (0, '')
