"""Reading images: every encoding of the contract, and messages that lie."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from binopos_ros.detection import DetectionError, Detector, JpegImage, RawImage, decode, decoders
from binopos_ros.detection.images import ColourFrame

CENTRE, AXES = (151.3, 122.6), (31.0, 24.0)


@pytest.fixture(scope='module')
def picture():
    fine = np.full((256 * 4, 320 * 4, 3), (140, 135, 110), np.uint8)
    centre = tuple(round(16 * (4 * each + 1.5)) for each in CENTRE)
    axes = tuple(round(16 * 4 * each) for each in AXES)
    cv2.ellipse(fine, centre, axes, 25, 0, 360, (45, 40, 190), -1, cv2.LINE_AA, 4)
    clean = cv2.resize(fine, (320, 256), interpolation=cv2.INTER_AREA).astype(float)
    noisy = cv2.GaussianBlur(clean, (0, 0), 0.8) + np.random.default_rng(0).normal(
        0, 1.5, clean.shape
    )
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def yuyv(bgr):
    """BT.601 of limited range, with the colour averaged over pairs, by hand."""
    b, g, r = (bgr[..., k].astype(float) for k in range(3))
    y = 16 + (65.738 * r + 129.057 * g + 25.064 * b) / 256
    u = 128 + (-37.945 * r - 74.494 * g + 112.439 * b) / 256
    v = 128 + (112.439 * r - 94.154 * g - 18.285 * b) / 256
    out = np.empty((*bgr.shape[:2], 2))
    out[..., 0] = y
    out[:, ::2, 1] = (u[:, ::2] + u[:, 1::2]) / 2
    out[:, 1::2, 1] = (v[:, ::2] + v[:, 1::2]) / 2
    return np.clip(np.round(out), 0, 255).astype(np.uint8)


def mosaic(bgr, order):
    out = np.empty(bgr.shape[:2], np.uint8)
    for k, name in enumerate(order):
        row, column = divmod(k, 2)
        out[row::2, column::2] = bgr[row::2, column::2, 'bgr'.index(name)]
    return out


def packed(bgr, encoding):
    if encoding == 'bgr8':
        return bgr
    if encoding == 'rgb8':
        return bgr[..., ::-1]
    if encoding in ('bgra8', 'rgba8'):
        colours = bgr if encoding == 'bgra8' else bgr[..., ::-1]
        return np.dstack([colours, np.full(bgr.shape[:2], 255, np.uint8)])
    if encoding in ('8UC3', '8UC4'):
        return packed(bgr, 'bgr8' if encoding == '8UC3' else 'bgra8')
    if encoding.endswith('16'):
        # The lower byte is noise to a detector of 256 levels.
        high = packed(bgr, f'{encoding.removesuffix("16")}8').astype('<u2')
        return (high * 256 + 77).view(np.uint8)
    if encoding.startswith('bayer'):
        return mosaic(bgr, encoding[6:10])
    if encoding == 'nv12':
        return nv12(bgr)
    if encoding in ('uyvy', 'yuv422'):
        return yuyv(bgr)[..., ::-1]
    return yuyv(bgr)


def nv12(bgr):
    """The brightness, and below it the colours of squares of four pixels."""
    pairs = yuyv(bgr)
    colours = pairs[..., 1].astype(float)
    means = (colours[::2] + colours[1::2]) / 2
    return np.vstack([pairs[..., 0], np.round(means).astype(np.uint8)])


def message(bgr, encoding, padding=0):
    values = packed(bgr, encoding)
    rows = np.ascontiguousarray(values).reshape(values.shape[0], -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return RawImage(padded.tobytes(), bgr.shape[1], bgr.shape[0], padded.shape[1], encoding)


ALL = (
    'bgr8', 'rgb8', 'bgra8', 'rgba8', 'yuv422_yuy2', 'yuyv',
    'bayer_rggb8', 'bayer_bggr8', 'bayer_gbrg8', 'bayer_grbg8',
    '8UC3', '8UC4', 'rgb16', 'bgr16', 'bayer_rggb16', 'bayer_gbrg16', 'uyvy', 'yuv422', 'nv12',
)  # fmt: skip


@pytest.mark.parametrize('encoding', ALL)
@pytest.mark.parametrize('padding', [0, 12])
def test_every_encoding_gives_the_same_centre(picture, encoding, padding):
    target = Detector().detect(message(picture, encoding, padding)).target
    assert target.centre == pytest.approx(CENTRE, abs=0.05)


@pytest.mark.parametrize('encoding', ALL)
def test_a_windows_pixels_do_not_depend_on_the_window(picture, encoding):
    frame = decode(message(picture, encoding))
    whole = frame.window(0, 0, frame.width, frame.height)
    for x0, y0, x1, y1 in (
        (3, 5, 60, 41),
        (100, 100, 131, 122),
        (0, 0, 9, 9),
        (291, 239, 320, 256),
    ):
        assert np.array_equal(frame.window(x0, y0, x1, y1), whole[y0:y1, x0:x1])
    reduced = frame.reduced(4, 0, 0, frame.width, frame.height)
    assert np.array_equal(frame.reduced(4, 40, 24, 120, 96), reduced[6:24, 10:30])


@pytest.mark.parametrize('encoding', ALL)
def test_reduced_pixels_are_the_means_of_their_blocks(picture, encoding):
    frame = decode(message(picture, encoding))
    whole = frame.window(0, 0, frame.width, frame.height).astype(float)
    blocks = whole.reshape(64, 4, 80, 4, 3)
    reduced = frame.reduced(4, 0, 0, frame.width, frame.height)
    off = np.abs(reduced - blocks.mean((1, 3)))
    assert off.mean() < 0.8
    # Across an edge a mosaic's colours are interpolated in the one and not in the other.
    flat = (blocks.max((1, 3)) - blocks.min((1, 3))).max(axis=2) < 12
    assert off[flat if encoding.startswith('bayer') else ...].max() <= 3


@pytest.mark.parametrize('encoding', ['rgb16', 'bayer_rggb16'])
def test_the_order_of_the_bytes_is_heeded(picture, encoding):
    image = message(picture, encoding)
    swapped = np.frombuffer(image.data, '<u2').astype('>u2').tobytes()
    swapped = dataclasses.replace(image, data=swapped, big_endian=True)
    whole = [decode(each).window(0, 0, 320, 256) for each in (image, swapped)]
    assert np.array_equal(*whole)


@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_a_png_gives_the_same_centre(picture, kind):
    pixels = picture.astype(kind) * (256 if kind is np.uint16 else 1)
    data = cv2.imencode('.png', pixels)[1].tobytes()
    target = Detector().detect(JpegImage(data)).target
    assert target.centre == pytest.approx(CENTRE, abs=0.05)


@pytest.mark.parametrize('ending', ['.png', '.jpg'])
def test_a_grey_picture_is_named_as_grey(picture, ending):
    data = cv2.imencode(ending, picture[..., 1])[1].tobytes()
    with pytest.raises(DetectionError, match='has no colour: the red target needs'):
        decode(JpegImage(data))


@pytest.mark.parametrize(
    ('cut', 'reason'), [(12, 'has no header'), (60, 'corrupt PNG'), (-40, 'corrupt PNG')]
)
def test_a_png_that_was_cut_short_is_refused(picture, cut, reason):
    data = cv2.imencode('.png', picture)[1].tobytes()
    with pytest.raises(DetectionError, match=reason):
        decode(JpegImage(data[:cut]))


def test_a_png_that_promises_too_much_is_refused_before_it_is_unpacked(picture):
    data = bytearray(cv2.imencode('.png', picture)[1].tobytes())
    data[16:24] = (60_000).to_bytes(4, 'big') * 2
    with pytest.raises(DetectionError, match='60000 x 60000'):
        decode(JpegImage(bytes(data)))


@pytest.mark.parametrize('quality', [75, 95])
def test_both_jpeg_decoders_find_the_same_centre(picture, quality, monkeypatch):
    data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    first = Detector().detect(JpegImage(data))
    monkeypatch.setattr(decoders, 'JPEG_DECODER', 'cv2')
    second = Detector().detect(JpegImage(data))
    assert first.target.centre == pytest.approx(CENTRE, abs=0.06)
    assert second.target.centre == pytest.approx(first.target.centre, abs=0.02)


@pytest.mark.parametrize('end', [b'', b'\x00' * 40])
def test_a_jpeg_may_be_followed_by_zeros(picture, end):
    data = cv2.imencode('.jpg', picture)[1].tobytes()
    assert Detector().detect(JpegImage(data + end)).target is not None


@pytest.mark.parametrize('kind', [bytes, bytearray, memoryview, lambda d: np.frombuffer(d, 'u1')])
def test_data_may_be_any_run_of_bytes(picture, kind):
    data = cv2.imencode('.jpg', picture)[1].tobytes()
    assert Detector().detect(JpegImage(kind(data))).target is not None


def raw(width=32, height=24, step=96, encoding='bgr8', data=None):
    return RawImage(bytes(step * height) if data is None else data, width, height, step, encoding)


GOOD = cv2.imencode('.jpg', np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


@pytest.mark.parametrize(
    ('image', 'words'),
    [
        (JpegImage(b''), 'no data'),
        (JpegImage(b'\x89PNG\r\n'), 'not a JPEG'),
        (JpegImage(b'\xff\xd8'), 'no frame header'),
        (JpegImage(GOOD[:200]), 'JPEG'),
        (JpegImage(GOOD[: len(GOOD) * 2 // 3]), 'cut short'),
        (JpegImage(GOOD.replace(b'\x00\x30\x00\x40', b'\xff\xff\xff\xff')), '65535 x 65535'),
        (raw(data=b''), 'no data'),
        (raw(width=0), '0 x 24'),
        (raw(width=2**31, height=2**31, data=bytes(99)), 'pixels'),
        (raw(height=-5, data=bytes(99)), '32 x -5'),
        (raw(step=90), 'step 90 is short'),
        (raw(step=-96, data=bytes(9999)), 'step -96 is short'),
        (raw(data=bytes(96 * 24 - 1)), '2303 bytes of data are short'),
        (raw(step=2**40, data=bytes(9999)), 'short'),
        (raw(encoding='mono8'), 'has no colour'),
        (raw(encoding='mono16'), 'has no colour'),
        (raw(encoding='nv24'), "encoding 'nv24' is unknown"),
        (raw(encoding=''), "encoding '' is unknown"),
        (raw(width=31, encoding='yuv422_yuy2'), 'pairs'),
    ],
)  # fmt: skip
def test_a_message_that_lies_gives_a_reason_and_no_target(image, words):
    detection = Detector().detect(image)
    assert detection.target is None
    assert words in detection.reason
    assert '\n' not in detection.reason
    with pytest.raises(DetectionError):
        decode(image)


def test_what_is_no_image_is_told_so():
    detection = Detector().detect('picture.jpg')
    assert detection.target is None
    assert 'JpegImage' in detection.reason


def test_a_corrupt_jpeg_among_good_ones_costs_only_itself(picture):
    data = cv2.imencode('.jpg', picture)[1].tobytes()
    spoilt = data[:900] + bytes(300) + data[1200:-2]
    detector = Detector()
    found = [
        detector.detect(JpegImage(each)).target is not None for each in (data, spoilt, data, data)
    ]
    assert found == [True, False, True, True]


def test_seeded_mutations_of_messages_never_raise_and_always_give_an_answer(picture):
    small = np.ascontiguousarray(picture[80:170, 100:210])
    good = [cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, q])[1] for q in (60, 95)]
    rng = np.random.default_rng(11)
    detector, answers = Detector(), {'target': 0, 'reason': 0}
    for k in range(5000):
        if k % 2:
            data = good[k % 4 // 2].ravel().copy()
            for _ in range(rng.integers(1, 9)):
                data[rng.integers(0, data.size)] = rng.integers(0, 256)
            if k % 3 == 0:
                data = data[: rng.integers(0, data.size)]
            image = JpegImage(data.tobytes())
        else:
            encoding = str(rng.choice([*ALL, 'mono8', 'BGR8', 'bayer_rggb16', '\x00']))
            width, height, step = (int(each) for each in rng.integers(-3, 130, 3))
            if k % 8 == 0:
                step = width * 4
            image = RawImage(
                small.tobytes()[: rng.integers(0, 29701)], width, height, step, encoding
            )
        detection = detector.detect(image)
        assert (detection.target is None) == bool(detection.reason)
        answers['reason' if detection.reason else 'target'] += 1
    assert min(answers.values()) > 50


def test_the_detector_does_not_touch_the_message(picture):
    image = message(picture, 'bgr8')
    before = bytes(image.data)
    Detector().detect(image)
    assert image.data == before
    kept = picture.copy()
    Detector().detect_in(ColourFrame(picture))
    assert np.array_equal(picture, kept)


@pytest.mark.parametrize('size', [(8, 8), (8, 2000), (3000, 9), (16, 1200)])
def test_narrow_images_are_searched_too(size):
    empty = np.full((*size, 3), 120, np.uint8)
    detector = Detector()
    for _ in range(2):
        detection = detector.detect(
            RawImage(empty.tobytes(), size[1], size[0], 3 * size[1], 'bgr8')
        )
        assert detection.target is None
        assert 'no red patch' in detection.reason
