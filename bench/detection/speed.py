"""Speed of the detector at 1280 x 960, beside what a user would write and beside AprilTag.

Run as `python bench/detection/speed.py`. One thread, one run; times are those of the CPU, so other
programs matter little; ratios are of the medians, to the plain script. The peer pupil-apriltags
is left out, with a line saying so, where it is not installed.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
import numpy as np

from binopos_ros.detection import JPEG_DECODER, Detector, JpegImage, RawImage, decode
from figures import Column, Figures

WIDTH, HEIGHT = 1280, 960
CENTRE, AXES = (702.3, 511.6), (20.0, 17.0)


def scene() -> np.ndarray:
    """A disc of 40 px on an uneven floor, with a little noise."""
    rng = np.random.default_rng(1)
    floor = np.add(cv2.resize(rng.normal(0, 12, (12, 16, 3)), (WIDTH, HEIGHT)), (150, 140, 110))
    picture = np.clip(floor, 0, 255).astype(np.uint8)
    centre, axes = ([round(16 * each) for each in pair] for pair in (CENTRE, AXES))
    cv2.ellipse(picture, centre, axes, 25, 0, 360, (45, 40, 190), -1, cv2.LINE_AA, 4)
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.7)
    return np.clip(smooth + rng.normal(0, 2, smooth.shape), 0, 255).astype(np.uint8)


def plain_script(bgr: np.ndarray) -> tuple[float, float]:
    """Red hues on the full frame, the largest outline, and its moments."""
    hsv = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)
    mask = cv2.inRange(hsv, (0, 110, 60), (8, 255, 255))
    mask |= cv2.inRange(hsv, (168, 110, 60), (180, 255, 255))
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[-2]
    m = cv2.moments(max(outlines, key=cv2.contourArea))
    return m['m10'] / m['m00'], m['m01'] / m['m00']


def apriltag(grey: np.ndarray) -> Callable[[], object] | None:
    try:
        import pupil_apriltags
    except ImportError:
        return None
    detector = pupil_apriltags.Detector(families='tag36h11', nthreads=1)
    return lambda: detector.detect(grey)


def interleaved(
    works: dict[str, Callable[[], object]], rounds: int = 60
) -> dict[str, list[float]]:
    """CPU times of this thread, ms; the works take turns, so that all are disturbed alike."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(rounds + 3):
        for name, work in works.items():
            start = time.thread_time()
            work()
            if turn >= 3:
                times[name].append(1e3 * (time.thread_time() - start))
    return times


def in_a_row(work: Callable[[], object], rounds: int = 300) -> list[float]:
    """CPU times of this thread, ms, where nothing else is done in between."""
    times = []
    for _ in range(rounds):
        start = time.thread_time()
        work()
        times.append(1e3 * (time.thread_time() - start))
    return times


def main() -> int:
    cv2.setNumThreads(1)
    found = Figures('detection/speed', peers=('pupil-apriltags', 'simplejpeg'))
    bgr = scene()
    jpeg = cv2.imencode('.jpg', bgr, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    empty = cv2.GaussianBlur(bgr[:, ::-1], (0, 0), 60)
    raw = RawImage(bgr.tobytes(), WIDTH, HEIGHT, 3 * WIDTH, 'bgr8')
    pairs = (
        cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_YUY2) if hasattr(cv2, 'COLOR_BGR2YUV_YUY2') else None
    )
    frame, blank = (
        decode(JpegImage(jpeg)),
        decode(RawImage(empty.tobytes(), WIDTH, HEIGHT, 3 * WIDTH, 'bgr8')),
    )
    followers = [Detector() for _ in range(3)]
    works: dict[str, Callable[[], object]] = {
        'plain script (HSV, full frame)': lambda: plain_script(bgr),
        'following, of pixels': lambda: followers[0].detect_in(frame),
        'following, bgr8 message': lambda: followers[1].detect(raw),
        'lost, target in view': lambda: Detector().detect_in(frame),
        'lost, no target in view': lambda: Detector().detect_in(blank),
        "the paper's rule (full frame)": lambda: Detector(method='paper').detect_in(frame),
        f'JPEG decoding ({JPEG_DECODER})': lambda: decode(JpegImage(jpeg)),
        'JPEG at 1/4 (cv2)': lambda: cv2.imdecode(
            np.frombuffer(jpeg, np.uint8), cv2.IMREAD_REDUCED_COLOR_4
        ),
    }
    if pairs is not None:
        yuyv = RawImage(pairs.tobytes(), WIDTH, HEIGHT, 2 * WIDTH, 'yuv422_yuy2')
        works['following, yuv422_yuy2 message'] = lambda: followers[2].detect(yuyv)
    tags = apriltag(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY))
    if tags is not None:
        works['pupil-apriltags (36h11)'] = tags
    times = interleaved(works)
    times['following, of pixels, nothing else'] = in_a_row(works['following, of pixels'])
    script = statistics.median(times['plain script (HSV, full frame)'])
    table = found.table(
        'works',
        f'{WIDTH} x {HEIGHT}, one thread',
        Column('ms', '.2f'),
        Column('least, ms', '.2f'),
        Column('plain script / this', '.2f', '<'),
    )
    for name, each in times.items():
        ratio = script / statistics.median(each)
        table.row(name, each, min(each), ratio, compared=name.startswith(('following', 'lost')))
    found.keep()
    if tags is None:
        print('pupil-apriltags is not installed: pip install pupil-apriltags to compare with it')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
