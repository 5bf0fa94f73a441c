"""What lies above a like thing: a mirror image under water, and none seen from the air."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from binopos_ros.bag import messages
from binopos_ros.detection import detect
from other_bags import JPEG, PAIRS, Entry, pixels_of, rewritten
from verbs import Done, figure, process, simulated, used

pytestmark = pytest.mark.xdist_group('mirror_image')

MIRRORED = 'mirror image'
#: Of the target in pictures that are coded anew, and of the other one, a diameter and more away.
RIGHT_MM, WRONG_MM = 3.0, 20.0


def with_copy(scale: float, step: float, flipped: bool) -> Callable[[Entry], Entry]:
    """Pictures with the target a second time, `step` diameters below it (above it: negative)."""

    def add(entry: Entry) -> Entry:
        if not entry.topic.endswith(JPEG):
            return entry
        picture = pixels_of(entry).copy()
        target = detect(picture)
        assert target is not None
        half = int(0.75 * target.diameter)
        u, v = (round(each) for each in target.centre)
        patch = picture[v - half : v + half, u - half : u + half]
        side = round(2 * half * scale)
        copy = cv2.resize(patch, (side, side), interpolation=cv2.INTER_AREA)
        if flipped:
            copy = cv2.flip(copy, 0)
        top, left = int(v + step * target.diameter) - side // 2, u - side // 2
        picture[top : top + side, left : left + side] = copy
        jpeg = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, 95))[1].tobytes()
        stamp = messages.stamp_of(entry.message)
        return entry._replace(message=messages.compressed_image(stamp, 'cam', jpeg))

    return add


def error_mm(done: Done) -> float:
    return float(figure(done, 'error of target/position against truth, RMS').split()[0])


def test_a_target_seen_from_the_air_is_no_mirror_image_of_what_lies_below_it(
    demo_bag: Path, tmp_path: Path
) -> None:
    bag = rewritten(demo_bag, tmp_path / 'bag', with_copy(0.7, 2.5, flipped=False))
    done = process(bag)
    assert used(done) == PAIRS
    assert MIRRORED not in done.stdout
    assert error_mm(done) < RIGHT_MM
    # What the rig looks through is what decides.
    done = process(bag, '--ros-args', '-p', 'detector:mirror_above:=true')
    assert used(done) == 0 or error_mm(done) > WRONG_MM


def test_a_mirror_image_in_the_surface_above_a_robots_target_is_refused(tmp_path: Path) -> None:
    """It is the larger one, and would be followed."""
    bag = simulated(tmp_path / 'ports', 'ports', PAIRS)
    mirrored = rewritten(bag, tmp_path / 'bag', with_copy(1.2, -2.5, flipped=True))
    done = process(mirrored)
    assert used(done) == PAIRS
    assert error_mm(done) < RIGHT_MM
    done = process(mirrored, '--ros-args', '-p', 'detector:mirror_above:=false')
    assert used(done) < PAIRS or error_mm(done) > WRONG_MM
