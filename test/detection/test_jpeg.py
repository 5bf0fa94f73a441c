"""What is read from a JPEG's header, against JPEGs whose tables are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.detection import DetectionError
from binopos_ros.detection.jpeg import read_header

# ITU-T T.81, tables K.1 and K.2: the six coefficients of lowest frequency in zigzag order.
LUMA = np.array([16, 11, 12, 14, 12, 10])
CHROMA = np.array([17, 18, 18, 24, 21, 24])


def encoded(*flags: int) -> np.ndarray:
    picture = np.random.default_rng(0).integers(0, 256, (40, 56, 3), np.uint8)
    done, data = cv2.imencode('.jpg', picture, flags)
    assert done
    return data.ravel()


def rounding(steps: np.ndarray, quality: int) -> float:
    """By the scaling of the standard tables that encoders share (quality 50 and more)."""
    scaled = np.clip((steps * (200 - 2 * quality) + 50) // 100, 1, 255)
    return float(np.mean(scaled.astype(float) ** 2) / 12)


@pytest.mark.parametrize('quality', [50, 75, 90, 100])
def test_size_and_rounding_are_those_of_the_standard_tables(quality):
    header = read_header(encoded(cv2.IMWRITE_JPEG_QUALITY, quality))
    assert (header.width, header.height) == (56, 40)
    assert header.rounding.luma == pytest.approx(rounding(LUMA, quality))
    # 4:2:0: four pixels share a sample of chroma.
    assert header.rounding.chroma == pytest.approx(4 * rounding(CHROMA, quality))


def test_a_progressive_jpeg_tells_the_same():
    plain, progressive = (
        read_header(encoded(cv2.IMWRITE_JPEG_QUALITY, 80, cv2.IMWRITE_JPEG_PROGRESSIVE, flag))
        for flag in (0, 1)
    )
    assert plain == progressive


def test_a_grey_jpeg_has_no_chroma():
    grey = cv2.imencode('.jpg', np.zeros((16, 24), np.uint8))[1].ravel()
    header = read_header(grey)
    assert (header.width, header.height) == (24, 16)
    assert header.rounding.chroma == 0


def test_padding_between_segments_is_passed_over():
    data = encoded()
    padded = np.concatenate([data[:2], np.full(3, 255, np.uint8), data[2:]])
    assert read_header(padded) == read_header(data)


@given(st.data())
def test_whatever_the_header_says_it_is_read_or_refused(data):
    octets = encoded()[:400].copy()
    for _ in range(data.draw(st.integers(1, 12))):
        octets[data.draw(st.integers(2, 399))] = data.draw(st.integers(0, 255))
    octets = octets[: data.draw(st.integers(1, 400))]
    try:
        header = read_header(octets)
    except DetectionError:
        return
    assert header.width >= 0
    assert header.height >= 0
    assert np.isfinite(header.rounding).all()
    assert min(header.rounding) >= 0
