"""The detector node: every encoding of the contract in, centroids out, a picture on request."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import SetBool, Trigger

from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.nodes.messages import header

pytestmark = pytest.mark.live

WIDTH, HEIGHT = 320, 240
CENTRE, RADIUS = (151.25, 118.5), 20.0


def disc() -> np.ndarray:
    """A red disc on grey, (240, 320, 3) blue-green-red, its edge averaged over 16 x 16 points."""
    steps = (np.arange(16) + 0.5) / 16 - 0.5
    u = (np.arange(WIDTH)[:, None] + steps).ravel() - CENTRE[0]
    v = (np.arange(HEIGHT)[:, None] + steps).ravel() - CENTRE[1]
    inside = (u**2 + v[:, None] ** 2 < RADIUS**2).reshape(HEIGHT, 16, WIDTH, 16).mean(axis=(1, 3))
    picture = 120 + inside[..., None] * (np.array([40, 40, 210]) - 120)
    return np.round(picture + np.random.default_rng(1).normal(0, 1, picture.shape)).astype(
        np.uint8
    )


def raw(bgr: np.ndarray, encoding: str) -> tuple[bytes, int]:
    """Data and step of a raw image."""
    if encoding == 'rgb8':
        bgr = bgr[..., ::-1]
    elif encoding == 'yuv422_yuy2':
        luma, blue, red = np.moveaxis(cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV), 2, 0)
        bgr = np.empty((HEIGHT, WIDTH, 2), np.uint8)
        bgr[..., 0] = luma
        for place, plane in ((0, blue), (1, red)):
            bgr[:, place::2, 1] = plane.reshape(HEIGHT, -1, 2).mean(axis=2)
    elif encoding == 'bayer_rggb8':
        mosaic = bgr[..., 1].copy()
        mosaic[::2, ::2] = bgr[::2, ::2, 2]
        mosaic[1::2, 1::2] = bgr[1::2, 1::2, 0]
        bgr = mosaic
    return np.ascontiguousarray(bgr).tobytes(), bgr[0].size


def raw_message(stamp: int, encoding: str) -> Image:
    data, step = raw(disc(), encoding)
    message = Image(header=header(stamp, 'left_camera'), encoding=encoding, step=step)
    message.width, message.height, message.data = WIDTH, HEIGHT, data
    return message


def jpeg_message(stamp: int) -> CompressedImage:
    message = CompressedImage(header=header(stamp, 'left_camera'), format='jpeg')
    message.data = cv2.imencode('.jpg', disc(), (cv2.IMWRITE_JPEG_QUALITY, 95))[1].tobytes()
    return message


@pytest.mark.parametrize('encoding', ['bgr8', 'rgb8', 'yuv422_yuy2', 'bayer_rggb8'])
def test_raw_images_give_the_centre_of_the_disc(start, peer, encoding):
    start('detector')
    images = peer.publisher(Image, 'left/image_raw')
    centroids = peer.listen(PoseWithCovarianceStamped, 'left/centroid')
    peer.connect(images, inputs=('left/centroid',))
    images.publish(raw_message(5_000_000_007, encoding))
    peer.wait_for(lambda: bool(centroids), 'a centroid')
    (message,) = centroids
    u, v, diameter = position_of(message)
    within = 0.3 if encoding.startswith('bayer') else 0.1
    assert np.hypot(u - CENTRE[0], v - CENTRE[1]) < within
    assert abs(diameter - 2 * RADIUS) < 1.5
    assert np.linalg.eigvalsh(covariance_of(message)[:2, :2]).min() > 0
    assert stamp_of(message) == 5_000_000_007
    assert message.header.frame_id == 'left_camera'


def test_jpegs_of_both_cameras_are_kept_apart_and_a_bad_one_is_counted(start, peer):
    start('detector')
    topics = {side: f'{side}/image_raw/compressed' for side in ('left', 'right')}
    images = {side: peer.publisher(CompressedImage, topic) for side, topic in topics.items()}
    centroids = {
        side: peer.listen(PoseWithCovarianceStamped, f'{side}/centroid') for side in topics
    }
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')

    def drops() -> dict[str, str]:
        values = [
            v for a in diagnostics for s in a.status if 'detector' in s.name for v in s.values
        ]
        return {v.key: v.value for v in values if v.key.startswith('Dropped: ')}

    peer.connect(*images.values(), inputs=('left/centroid', 'right/centroid'))
    broken = jpeg_message(2)
    broken.data = broken.data[:100]
    images['left'].publish(jpeg_message(1))
    images['right'].publish(jpeg_message(1))
    peer.wait_for(lambda: centroids['left'] and centroids['right'], 'the first centroids')
    images['left'].publish(broken)
    peer.wait_for(lambda: len(drops()) == 1, 'the broken one')
    for message in (jpeg_message(3), jpeg_message(3)):
        images['left'].publish(message)
    peer.wait_for(lambda: len(centroids['left']) == 2, 'the centroids')
    assert [stamp_of(message) for message in centroids['left']] == [1, 3]
    peer.wait_for(lambda: len(drops()) == 2, 'the drops')
    assert set(drops().values()) == {'1'}
    assert any('left: JPEG' in key for key in drops())
    assert 'Dropped: left: the stamp was repeated' in drops()


def test_a_calibration_of_another_size_stops_the_centroids_and_says_so(start, peer):
    start('detector')
    images = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    calibration = peer.publisher(CameraInfo, 'left/camera_info')
    centroids = peer.listen(PoseWithCovarianceStamped, 'left/centroid')
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    peer.connect(images, calibration, inputs=('left/centroid',))
    info = CameraInfo(width=640, height=480, distortion_model='plumb_bob', d=[0.0] * 5)
    info.k = np.array([500.0, 0, 320, 0, 500, 240, 0, 0, 1])
    calibration.publish(info)
    peer.wait_for(lambda: bool(diagnostics), 'a diagnostic')
    images.publish(jpeg_message(1))

    def keys() -> set[str]:
        return {v.key for a in diagnostics for s in a.status for v in s.values}

    said = 'Dropped: left: the image is # x # but its camera_info is for # x #'
    peer.wait_for(lambda: any(key.startswith(said) for key in keys()), 'the drop')
    assert not centroids


def test_a_driver_that_sends_both_forms_is_served_from_the_compressed_one(start, peer):
    start('detector')
    raw_images = peer.publisher(Image, 'left/image_raw')
    jpegs = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    centroids = peer.listen(PoseWithCovarianceStamped, 'left/centroid')
    reports = peer.listen(DiagnosticArray, '/diagnostics')
    peer.connect(jpegs, inputs=('left/centroid',))
    for stamp in (1, 2, 3):
        raw_images.publish(raw_message(stamp, 'bgr8'))
        jpegs.publish(jpeg_message(stamp))
        peer.wait_for(lambda stamp=stamp: len(centroids) == stamp, 'a centroid')
    told = len(reports)
    peer.wait_for(lambda: len(reports) > told + 2, 'the diagnostics')
    assert raw_images.get_subscription_count() == 0
    values = {item.key: item.value for report in reports for item in report.status[0].values}
    assert values['Received left/image_raw'] == values['Published'] == '3'
    assert values['left: pictures'] == 'compressed'
    assert not [key for key in values if key.startswith(('Dropped: ', 'Lost '))]
    # In a second in which one came in and nothing has gone out yet it may warn, but not for ever.
    peer.wait_for(
        lambda: reports[-1].status[0].level != DiagnosticStatus.WARN, 'a report without a warning'
    )


def test_the_form_that_is_asked_for_is_the_one_that_is_taken(start, peer):
    start('detector', parameters={'detector': {'image_transport': 'raw'}})
    raw_images = peer.publisher(Image, 'left/image_raw')
    jpegs = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    centroids = peer.listen(PoseWithCovarianceStamped, 'left/centroid')
    peer.connect(raw_images, inputs=('left/centroid',))
    raw_images.publish(raw_message(1, 'bgr8'))
    peer.wait_for(lambda: bool(centroids), 'a centroid')
    assert jpegs.get_subscription_count() == 0


def test_the_overlay_is_made_only_for_those_who_look(start, peer):
    start('detector')
    images = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    centroids = peer.listen(PoseWithCovarianceStamped, 'left/centroid')
    peer.connect(images, inputs=('left/centroid', 'left/overlay/compressed'))
    overlays = peer.listen(CompressedImage, 'left/overlay/compressed')
    peer.connect(images, inputs=('left/overlay/compressed',))
    images.publish(jpeg_message(1))
    peer.wait_for(lambda: bool(overlays and centroids), 'an overlay')
    picture = cv2.imdecode(np.frombuffer(overlays[0].data, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (HEIGHT, WIDTH, 3)
    assert stamp_of(overlays[0]) == 1
    # The outline is drawn in green, which the picture itself does not hold.
    green = (picture[..., 1].astype(int) - picture[..., 2] > 60) & (picture[..., 1] > 150)
    assert green.sum() > 30


def test_it_can_be_switched_off_and_on_and_leaves_pictures_alone_meanwhile(start, peer):
    start('detector')
    jpegs = peer.publisher(CompressedImage, 'left/image_raw/compressed')
    centroids = peer.listen(PoseWithCovarianceStamped, 'left/centroid')
    reports = peer.listen(DiagnosticArray, '/diagnostics')
    peer.connect(jpegs, inputs=('left/centroid',))
    enable = peer.node.create_client(SetBool, 'detector/enable')
    others = {
        name: peer.node.create_client(Trigger, f'detector/{name}') for name in ('start', 'stop')
    }
    for client in (enable, *others.values()):
        peer.wait_for(client.service_is_ready, 'a service')

    def call(client, request) -> None:
        answer = client.call_async(request)
        peer.wait_for(answer.done, 'an answer')
        assert answer.result().success

    def left_alone() -> int:
        values = {item.key: item.value for item in reports[-1].status[0].values} if reports else {}
        return int(values.get('Pictures left alone', 0))

    for stamp, off, on in (
        (1, (enable, SetBool.Request(data=False)), (enable, SetBool.Request(data=True))),
        (11, (others['stop'], Trigger.Request()), (others['start'], Trigger.Request())),
    ):
        seen = len(centroids)
        jpegs.publish(jpeg_message(stamp))
        peer.wait_for(lambda seen=seen: len(centroids) == seen + 1, 'a centroid')
        call(*off)
        before = left_alone()
        jpegs.publish(jpeg_message(stamp + 1))
        peer.wait_for(lambda before=before: left_alone() == before + 1, 'the picture left alone')
        call(*on)
    jpegs.publish(jpeg_message(21))
    peer.wait_for(lambda: len(centroids) == 3, 'a centroid')
    assert [stamp_of(each) for each in centroids] == [1, 11, 21]
