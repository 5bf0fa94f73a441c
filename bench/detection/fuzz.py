"""Malformed images by the hundred thousand: `python bench/detection/fuzz.py [COUNT] [SEED]`.

Half are JPEGs with bytes changed, cut, doubled or left out, half raw images whose sizes, steps,
encodings and amounts of data lie. Counts what the detector answered; any exception ends the run.
"""

from __future__ import annotations

import collections
import re
import sys
import time

import cv2
import numpy as np

from binopos_ros.detection import ENCODINGS, JPEG_DECODER, Detector, JpegImage, RawImage

SIZE = (96, 128)
STRANGE = ('', 'mono8', 'mono16', '32FC1', 'BGR8', 'nv21', 'bayer_rggb16', 'bgr8\x00', 'é')


def disc() -> np.ndarray:
    picture = np.full((*SIZE, 3), (140, 135, 110), np.uint8)
    cv2.ellipse(picture, (60, 50), (22, 17), 30, 0, 360, (40, 40, 190), -1, cv2.LINE_AA)
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def spoilt_jpeg(rng: np.random.Generator, seeds: list[bytes]) -> JpegImage:
    data = bytearray(seeds[rng.integers(len(seeds))])
    for _ in range(rng.integers(0, 7)):
        kind, place = rng.integers(0, 5), int(rng.integers(0, len(data)))
        if kind <= 1:
            data[place] = int(rng.integers(0, 256))
        elif kind == 2:
            del data[place : place + int(rng.integers(1, 60))]
        elif kind == 3:
            data[place:place] = data[place : place + int(rng.integers(1, 60))]
        else:
            data[place : place + 2] = bytes([0xFF, int(rng.integers(0xC0, 256))])
        data = data or bytearray(b'\xff')
    if rng.integers(0, 6) == 0:
        data = data[: rng.integers(0, len(data) + 1)]
    return JpegImage(bytes(data))


def lying_raw(rng: np.random.Generator, data: bytes) -> RawImage:
    encoding = str(rng.choice(ENCODINGS)) if rng.random() < 0.85 else str(rng.choice(STRANGE))
    width, height = (int(each) for each in rng.integers(-2, 140, 2))
    step = width * int(rng.integers(0, 6)) + int(rng.integers(-3, 9))
    if rng.random() < 0.1:
        width, height, step = (int(2.0 ** rng.integers(8, 63)) for _ in range(3))
    return RawImage(data[: rng.integers(0, len(data) + 1)], width, height, step, encoding)


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    rng = np.random.default_rng(seed)
    picture = disc()
    seeds = [
        cv2.imencode('.jpg', picture, flags)[1].tobytes()
        for flags in (
            [cv2.IMWRITE_JPEG_QUALITY, 60],
            [cv2.IMWRITE_JPEG_QUALITY, 95],
            [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
            [cv2.IMWRITE_JPEG_RST_INTERVAL, 4],
        )
    ]
    data = np.dstack([picture, picture[..., 0]]).tobytes()
    detectors = [Detector(), Detector(track=False), Detector(method='paper')]
    answers: collections.Counter[str] = collections.Counter()
    slowest = 0.0
    for k in range(count):
        image = spoilt_jpeg(rng, seeds) if k % 2 else lying_raw(rng, data)
        start = time.perf_counter()
        detection = detectors[k % 3].detect(image)
        slowest = max(slowest, time.perf_counter() - start)
        assert (detection.target is None) == bool(detection.reason), k
        reason = detection.reason or 'target found'
        answers[' '.join(re.sub(r"'.*?'|\S*\d\S*", '#', reason).split()[:5])] += 1
    print(f'{count} messages, seed {seed}, decoder {JPEG_DECODER}: no exception;', end=' ')
    print(f'the slowest took {1e3 * slowest:.0f} ms')
    for reason, times in answers.most_common():
        print(f'{times:8}  {reason}')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
