"""What is red and what is not, in water of many colours, and pictures that fooled detectors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from binopos_ros.detection import Detector, JpegImage, RawImage
from binopos_ros.detection.colour import hue
from waters import OTHERS, RED, WATERS, tank


@pytest.mark.parametrize('water', WATERS)
@pytest.mark.parametrize('other', OTHERS)
def test_of_two_colours_the_red_one_is_taken(water, other):
    image = tank(water, ((90, 130), 14, RED), ((220, 110), 20, OTHERS[other]))
    target = Detector().detect(image).target
    assert target is not None
    assert np.allclose(target.centre, (90, 130), atol=0.5)


def test_alone_the_other_colours_are_refused_with_their_reason():
    taken = dict.fromkeys(OTHERS, 0)
    for water in WATERS:
        for name, colour in OTHERS.items():
            detection = Detector().detect(tank(water, ((160, 120), 18, colour)))
            taken[name] += detection.target is not None
            kind = 'yellow' if name in ('yellow', 'orange') else 'pink'
            for each in detection.candidates[:1]:
                assert not each.reason or kind in each.reason or 'contrast' in each.reason
    # What is seen of pink in blue water is the colour of a red that has faded there.
    assert taken['yellow'] == taken['magenta'] == 0
    assert taken['orange'] <= 1
    assert taken['pink'] <= 2


@pytest.mark.parametrize('way', [0.1, 0.4, 0.7])
def test_red_stays_red_until_the_water_has_taken_two_thirds_of_it(way):
    for water in WATERS:
        if np.exp(-way * water[1]) < 1 / 3:
            continue
        target = Detector().detect(tank(water, ((160, 120), 18, RED), way=way)).target
        assert target is not None, water


def test_the_hue_of_a_colour_does_not_change_with_what_water_adds_to_it():
    veil, own = np.array((120.0, 130.0, 70.0)), np.array((30.0, 35.0, 185.0))
    hues = [hue(own * share + veil * (1 - share), veil) for share in (0.25, 0.5, 1.0)]
    assert np.ptp([each.tint for each in hues]) < 0.05
    assert np.all(np.diff([each.purity for each in hues]) > 0)
    assert abs(hues[-1].tint) < 0.1
    assert hue((30, 150, 190), veil).tint > 0.5
    assert hue((170, 40, 200), veil).tint < -0.4


def speck(colour, water, diameter, seed=0):
    """A speck of light that is added to the water, in a JPEG."""
    picture = np.full((240, 320, 3), water, float)
    fine = np.zeros((960, 1280), np.uint8)
    cv2.circle(fine, (641, 481), round(2 * diameter), 255, -1)
    share = cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA)[..., None] / 255
    picture = cv2.GaussianBlur(picture * (1 - share) + np.array(colour) * share, (0, 0), 0.9)
    picture = picture + np.random.default_rng(seed).normal(0, 2, picture.shape)
    picture = np.clip(np.round(picture), 0, 255).astype(np.uint8)
    return JpegImage(cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes())


@pytest.mark.parametrize('diameter', [5, 7, 10, 30])
def test_a_white_speck_in_green_water_is_no_target_however_small(diameter):
    # Redder than its surroundings it is, as all is that is not green.
    for water, _ in WATERS:
        for light in ((255, 255, 250), (235, 240, 238), (250, 255, 255)):
            for floor in ({}, {'min_redness': -0.4}):
                detection = Detector(**floor).detect(speck(light, water, diameter))
                assert detection.target is None, (water, light)


def test_a_full_red_is_red():
    for red in ((0, 0, 255), (0, 0, 120), (8, 4, 250)):
        for water in WATERS:
            assert Detector().detect(tank(water, ((160, 120), 18, red), way=0.0)).target


# By their numbers: what else than the labelled box is a right answer (the folder's own account).
ALSO_RIGHT = {801: [(322, 216)], 856: [(352, 166), (395, 158)], 867: [(317, 206), (367, 197)]}
ALSO_RIGHT[1469] = [(340, 317)]
SPECK = 934
"""The picture whose only decoy is a fish or a speck of 7 px: nothing in it tells it from a far
target."""


def test_no_decoy_is_taken(decoys):
    hits = 0
    for name, jpeg, boxes in decoys:
        target = Detector().detect(JpegImage(jpeg)).target
        if target is None or name == SPECK:
            continue
        u, v = target.centre
        in_box = any(x0 <= u <= x1 and y0 <= v <= y1 for x0, y0, x1, y1 in boxes)
        beside = any(np.hypot(u - x, v - y) < 12 for x, y in ALSO_RIGHT.get(name, []))
        assert in_box or beside, (name, u, v)
        hits += 1
    assert hits >= 6


def test_a_bar_is_no_target_and_a_tilted_disc_is():
    ground, red = np.array([150, 140, 110]), np.array([45, 40, 190])
    rng = np.random.default_rng(4)
    for degrees in range(0, 180, 20):
        for ratio in (0.3, 0.45):
            taken = {}
            for name in ('bar', 'disc'):
                fine = np.zeros((960, 1280), np.uint8)
                if name == 'bar':
                    box = cv2.boxPoints(((640.0, 480.0), (240.0, 240.0 * ratio), degrees))
                    cv2.fillPoly(fine, [box.astype(np.int32)], 255)
                else:
                    axes = (120, round(120 * ratio))
                    cv2.ellipse(fine, (640, 480), axes, degrees, 0, 360, 255, -1)
                share = cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA) / 255
                share = cv2.GaussianBlur(share, (0, 0), 0.8)[..., None]
                picture = ground * (1 - share) + red * share + rng.normal(0, 2, (240, 320, 3))
                pixels = np.clip(picture, 0, 255).astype(np.uint8)
                image = RawImage(pixels.tobytes(), 320, 240, 960, 'bgr8')
                taken[name] = Detector().detect(image).target is not None
                if name == 'disc':
                    options = {'target': {'shape': 'ball'}}
                    assert Detector(**options).detect(image).target is None
            assert taken == {'bar': False, 'disc': True}, (degrees, ratio)
