"""Bags to test with, made on the spot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from binopos_ros.bag import BagWriter, messages

START = 1_700_000_000_000_000_000
PERIOD = 33_333_333
IMAGES = ('/stereo/left/image_raw/compressed', '/stereo/right/image_raw/compressed')


@pytest.fixture
def make_bag() -> Callable[..., Path]:
    """Write a bag of image pairs at 30 Hz; keywords go to the writer."""

    def make(path: Path, *, pairs: int = 20, size: int = 2000, **options: Any) -> Path:
        random = np.random.default_rng(7)
        with BagWriter(path, **options) as writer:
            for topic in IMAGES:
                writer.add_topic(topic, messages.COMPRESSED_IMAGE)
            for number in range(pairs):
                stamp = START + number * PERIOD
                for topic in IMAGES:
                    jpeg = random.integers(0, 256, size, dtype=np.uint8).tobytes()
                    writer.write(topic, stamp, messages.compressed_image(stamp, 'cam', jpeg))
        return path

    return make
