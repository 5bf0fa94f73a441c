"""The detector on real pictures of red buoys under water, group by group.

A hit is a centre inside the hand-drawn box; a wrong target is any other target, in a picture with
a box or without.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from binopos_ros.detection import Detector, JpegImage

CLEAR = (100, 200, 300, 400, 900, 1000)
OPEN = (0, 500, 600, 700, 1100, 1400)


@dataclass
class Score:
    pictures: int = 0
    boxes: int = 0
    hits: int = 0
    wrong: int = 0
    simple_hits: int = 0
    simple_wrong: int = 0

    def __add__(self, other: Score) -> Score:
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Score(*(a + b for a, b in pairs))

    @property
    def recall(self) -> float:
        return self.hits / self.boxes

    @property
    def precision(self) -> float:
        return self.hits / (self.hits + self.wrong)


def simple_rule(bgr: np.ndarray) -> np.ndarray | None:
    """What a user would write: red hues, and the largest blob's centroid."""
    hsv = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)
    low = cv2.inRange(hsv, (0, 111, 61), (7, 255, 255))
    mask = low | cv2.inRange(hsv, (169, 111, 61), (180, 255, 255))
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[-2]
    if not outlines:
        return None
    m = cv2.moments(max(outlines, key=cv2.contourArea))
    return np.array([m['m10'], m['m01']]) / m['m00'] if m['m00'] else None


def within(centre: np.ndarray | None, box: tuple[int, int, int, int] | None) -> bool:
    if centre is None or box is None:
        return False
    u, v = centre
    return bool(box[0] <= u <= box[2] and box[1] <= v <= box[3])


@pytest.fixture(scope='module')
def scores(buoys) -> dict[int, Score]:
    groups: dict[int, Score] = defaultdict(Score)
    for buoy in buoys:
        target = Detector().detect(JpegImage(buoy.jpeg)).target
        centre = None if target is None else target.centre
        bgr = cv2.imdecode(np.frombuffer(buoy.jpeg, np.uint8), cv2.IMREAD_COLOR)
        simple = simple_rule(bgr)
        groups[buoy.hundred] += Score(
            1,
            buoy.box is not None,
            within(centre, buoy.box),
            centre is not None and not within(centre, buoy.box),
            within(simple, buoy.box),
            simple is not None and not within(simple, buoy.box),
        )
    return dict(groups)


def total(scores: dict[int, Score], hundreds: tuple[int, ...]) -> Score:
    return sum((scores[each] for each in hundreds), Score())


def test_hits_misses_and_wrong_targets_are_told_per_group(scores, capsys):
    with capsys.disabled():
        print('\n group  pictures  boxes   hits  missed  wrong   | simple rule: hits  wrong')
        rows = [*sorted(scores.items()), ('clear', total(scores, CLEAR))]
        for name, each in [*rows, ('open', total(scores, OPEN))]:
            missed = each.boxes - each.hits
            print(
                f'{name:>6}{each.pictures:10}{each.boxes:7}{each.hits:7}{missed:8}{each.wrong:7}'
                f'{each.simple_hits:22}{each.simple_wrong:7}'
            )
    assert sum(each.pictures for each in scores.values()) == 132
    everything = total(scores, tuple(scores))
    # As many as the detector found before it told red from yellow and white, and none wrong.
    assert everything.hits >= 94 > everything.simple_hits
    assert everything.wrong == 0 < everything.simple_wrong


def test_clear_pools_are_found_nearly_always_and_hardly_ever_wrongly(scores):
    clear = total(scores, CLEAR)
    assert clear.recall >= 0.95
    assert clear.precision >= 0.97


def test_open_water_gives_silence_rather_than_wrong_targets(scores):
    open_water = total(scores, OPEN)
    assert open_water.wrong <= 0.05 * open_water.pictures


@pytest.mark.parametrize('hundred', OPEN)
def test_open_water_is_seen_better_than_by_the_simple_rule(scores, hundred):
    assert scores[hundred].hits >= scores[hundred].simple_hits
    assert total(scores, OPEN).hits > 1.5 * total(scores, OPEN).simple_hits


def test_every_picture_without_a_target_has_a_reason(buoys):
    for buoy in buoys[::4]:
        detection = Detector().detect(JpegImage(buoy.jpeg))
        assert (detection.target is None) == bool(detection.reason)
        for candidate in detection.candidates:
            if detection.target is None:
                assert candidate.reason


@pytest.mark.parametrize(
    'change', [{'min_contrast': 0.15}, {'min_redness': -0.15}, {'min_fit': 0.75}]
)
def test_the_answers_do_not_hang_on_the_last_digit_of_a_threshold(buoys, change):
    detector = Detector(track=False, **change)
    clear, open_water = Score(), Score()
    for buoy in buoys:
        target = detector.detect(JpegImage(buoy.jpeg)).target
        hit = target is not None and within(target.centre, buoy.box)
        score = Score(1, buoy.box is not None, hit, target is not None and not hit)
        clear += score if buoy.hundred in CLEAR else Score()
        open_water += score if buoy.hundred in OPEN else Score()
    assert clear.recall >= 0.95
    assert clear.precision >= 0.97
    assert open_water.wrong <= 0.05 * open_water.pictures
