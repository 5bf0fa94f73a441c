"""Parts of a JPEG by the compiled part, against the same JPEG decoded whole by a peer."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.detection import DetectionError, Detector, JpegImage, decode, decoders
from binopos_ros.detection.errors import UnreadableError
from binopos_ros.detection.images import prepare
from binopos_ros.detection.jpeg_frame import JpegFrame

pytestmark = pytest.mark.skipif(
    not decoders.decodes_parts(),
    reason='the compiled part is not built: it takes a C compiler and the headers of '
    'libjpeg-turbo (apt install gcc libjpeg-dev), and "pip install -e ." again',
)
simplejpeg = pytest.importorskip('simplejpeg')

SAMPLINGS = ('444', '422', '420', '440', '411')
RED = (45, 40, 190)


def encoded(size, seed, sampling='420', quality=90):
    """A picture of blurred noise, (width, height), as a JPEG."""
    noise = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.frombuffer(
        simplejpeg.encode_jpeg(
            smooth, quality=quality, colorspace='BGR', colorsubsampling=sampling
        ),
        np.uint8,
    )


def tank(place, size=(640, 480), seed=0):
    picture = np.full((size[1], size[0], 3), (150, 140, 110), np.uint8)
    centre = tuple(round(16 * each) for each in place)
    cv2.ellipse(picture, centre, (16 * 15, 16 * 12), 20, 0, 360, RED, -1, cv2.LINE_AA, 4)
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)


def jpeg(picture, *flags):
    return cv2.imencode('.jpg', picture, flags)[1].tobytes()


@settings(max_examples=150, deadline=None)
@given(st.data(), st.sampled_from(SAMPLINGS))
def test_a_part_has_the_pixels_of_the_whole(data, sampling):
    size = data.draw(st.tuples(st.integers(8, 130), st.integers(8, 130)))
    x0, x1 = sorted(data.draw(st.sets(st.integers(0, size[0]), min_size=2, max_size=2)))
    y0, y1 = sorted(data.draw(st.sets(st.integers(0, size[1]), min_size=2, max_size=2)))
    octets = encoded(size, sum(size), sampling, data.draw(st.sampled_from((60, 95))))
    whole = simplejpeg.decode_jpeg(octets, 'BGR')
    assert np.array_equal(decoders.decode_box(octets, size, (x0, y0, x1, y1)), whole[y0:y1, x0:x1])


@pytest.mark.parametrize(
    'flags',
    [
        (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        (cv2.IMWRITE_JPEG_RST_INTERVAL, 7),
        (cv2.IMWRITE_JPEG_OPTIMIZE, 1),
    ],
)
def test_so_it_has_in_jpegs_of_other_kinds(flags):
    octets = np.frombuffer(jpeg(tank((300, 200)), *flags), np.uint8)
    whole = simplejpeg.decode_jpeg(octets, 'BGR')
    part = decoders.decode_box(octets, (640, 480), (201, 99, 410, 303))
    assert np.array_equal(part, whole[99:303, 201:410])


def test_a_target_is_followed_and_found_to_the_same_digits_in_parts_as_in_the_whole(monkeypatch):
    images = [
        JpegImage(jpeg(tank((120 + 9 * k + (k > 20) * 200, 100 + 7 * k), seed=k)))
        for k in range(32)
    ]
    by_parts = [detector.detect(each) for detector in [Detector()] for each in images]
    monkeypatch.setattr(decoders, 'JPEG_DECODER', 'simplejpeg')
    whole = [detector.detect(each) for detector in [Detector()] for each in images]
    assert sum(each.tracked for each in whole) > 25
    for part, other in zip(by_parts, whole, strict=True):
        assert part.tracked == other.tracked
        assert np.abs(part.target.centre - other.target.centre).max() < 1e-3
        assert np.allclose(part.target.covariance, other.target.covariance, rtol=1e-3)


def test_little_of_the_picture_is_decoded_where_a_target_is_followed(monkeypatch):
    boxes = []
    decode_part = decoders.decode_part
    monkeypatch.setattr(
        decoders, 'decode_part', lambda *each: (boxes.append(each[3]), decode_part(*each))
    )
    detector = Detector()
    for k in range(14):
        assert detector.detect(JpegImage(jpeg(tank((200 + 4 * k, 200), seed=k)))).target
    assert boxes[0] == (0, 0, 640, 480)
    assert len(boxes) == 14
    assert max((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes[1:]) < 640 * 480 / 5


def test_a_corrupt_jpeg_is_refused_where_it_is_looked_at_and_the_target_is_not_forgotten():
    good = jpeg(tank((300, 200)))
    spoilt = good[:1500] + bytes(600) + good[2100:-2] + b'\xff\xd9'
    detector = Detector()
    assert detector.detect(JpegImage(good)).target is not None
    refused = detector.detect(JpegImage(spoilt))
    assert refused.target is None
    assert 'corrupt JPEG' in refused.reason
    assert detector.detect(JpegImage(good)).tracked
    with pytest.raises(UnreadableError):
        decode(JpegImage(spoilt))


def test_how_much_was_decoded_ahead_does_not_change_what_is_refused():
    good = bytearray(jpeg(tank((300, 100))))
    place = len(good) * 3 // 4
    good[place : place + 60] = bytes(60)
    image = JpegImage(bytes(good))
    with pytest.raises(UnreadableError):
        decode(image)
    above = 200, 50, 400, 150
    pixels = []
    for ahead in (None, (0, 0, 640, 480), above, (0, 0, 30, 30), (-90, -90, -10, -10)):
        frame = prepare(image, ahead)
        pixels.append(frame.window(*above))
        with pytest.raises(UnreadableError):
            frame.window(0, 0, 640, 480)
    assert all(np.array_equal(pixels[0], each) for each in pixels[1:])


def test_grey_is_named_as_grey_and_a_frame_is_of_the_header():
    with pytest.raises(DetectionError, match='has no colour'):
        prepare(JpegImage(jpeg(tank((300, 200))[..., 1])), None)
    frame = prepare(JpegImage(jpeg(tank((300, 200)))), (0, 0, 50, 50))
    assert isinstance(frame, JpegFrame)
    assert (frame.width, frame.height) == (640, 480)
    assert frame.rounding == decode(JpegImage(jpeg(tank((300, 200))))).rounding


@pytest.mark.parametrize(
    ('size', 'box', 'shape'),
    [
        ((64, 48), (0, 0, 65, 48), (48, 65, 3)),
        ((64, 48), (9, 0, 9, 48), (48, 0, 3)),
        ((64, 48), (0, 0, 64, 48), (48, 64, 2)),
        ((60, 48), (0, 0, 60, 48), (48, 60, 3)),
        ((2**32 - 1, 48), (0, 0, 8, 8), (8, 8, 3)),
    ],
)
def test_boxes_that_do_not_fit_are_refused(size, box, shape):
    octets = encoded((64, 48), 0)
    with pytest.raises(ValueError, match=r'fit|headers'):
        decoders.decode_part(octets, np.empty(shape, np.uint8), size, box)


def test_whatever_the_data_are_a_part_is_decoded_or_refused():
    rng = np.random.default_rng(5)
    good = [
        encoded((70, 54), 1, '420'),
        encoded((70, 54), 2, '422'),
        np.frombuffer(jpeg(tank((20, 20), (70, 54)), cv2.IMWRITE_JPEG_PROGRESSIVE, 1), np.uint8),
        np.frombuffer(jpeg(tank((20, 20), (70, 54)), cv2.IMWRITE_JPEG_RST_INTERVAL, 2), np.uint8),
    ]
    outcomes = {'decoded': 0, 'refused': 0}
    for k in range(6000):
        octets = good[k % 4].copy()
        for _ in range(rng.integers(1, 6)):
            octets[rng.integers(2, octets.size)] = rng.integers(0, 256)
        if k % 5 == 0:
            octets = octets[: rng.integers(1, octets.size)]
        x0, y0 = rng.integers(0, 69), rng.integers(0, 53)
        box = int(x0), int(y0), int(rng.integers(x0 + 1, 71)), int(rng.integers(y0 + 1, 55))
        try:
            decoders.decode_box(octets, (70, 54), box)
        except UnreadableError:
            outcomes['refused'] += 1
        else:
            outcomes['decoded'] += 1
    assert min(outcomes.values()) > 600
