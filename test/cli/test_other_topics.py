"""Pictures under other people's names: found, given by hand, side by side or rectified."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from binopos_ros.bag import BagReader, messages
from other_bags import INFO, JPEG, LEFT, PAIRS, RIGHT, Entry, pixels_of, raw, renamed, rewritten
from verbs import binopos_here, figure, process, refused, used

pytestmark = pytest.mark.xdist_group('other_bags')

ISAAC = '/front_stereo_camera/left/image_raw'


@pytest.mark.parametrize(
    ('left', 'right'),
    [
        ('/left_camera/image_raw/compressed', '/right_camera/image_raw/compressed'),
        ('/zed/zed_node/left/image_rect_color', '/zed/zed_node/right/image_rect_color'),
        ('/zed/zed_node/left/color/rect/image', '/zed/zed_node/right/color/rect/image'),
        (ISAAC, '/front_stereo_camera/right/image_raw'),
        ('/camera/camera/infra1/image_rect_raw', '/camera/camera/infra2/image_rect_raw'),
        ('/cam_l/image_color/compressed', '/cam_r/image_color/compressed'),
    ],
)
def test_names_of_known_cameras_are_found_by_themselves(
    demo_bag: Path, tmp_path: Path, left: str, right: str
) -> None:
    copy = rewritten(demo_bag, tmp_path / 'bag', lambda entry: as_camera(entry, left, right))
    done = process(copy)
    assert int(figure(done, 'pairs seen')) == PAIRS
    # The contract's own names need no word.
    assert (f'left {left}, right {right}' in done.stdout) == (left != ISAAC)
    # A picture that is not rectified under a name that says so gives what it gives.
    if 'rect' not in left:
        assert used(done) == PAIRS


def test_of_one_cameras_pictures_those_that_tell_most_are_taken(
    demo_bag: Path, tmp_path: Path
) -> None:
    """As a ZED publishes them: raw and rectified, in colour and grey."""
    names = ('raw/image_raw_color', 'raw/image_raw_gray', 'image_rect_color', 'image_rect_gray')

    def publish(entry: Entry) -> list[Entry]:
        side = entry.topic.split('/')[2]
        if entry.topic.endswith(INFO):
            return [
                entry._replace(topic=f'/zed/{folder}/camera_info')
                for folder in (side, f'{side}/raw')
            ]
        if entry.topic.endswith(JPEG):
            return [raw(entry)._replace(topic=f'/zed/{side}/{name}') for name in names]
        return [entry]

    done = process(rewritten(demo_bag, tmp_path / 'bag', publish))
    assert used(done) == PAIRS
    assert 'left /zed/left/raw/image_raw_color' in figure(done, 'note')


def as_camera(entry: Entry, left: str, right: str) -> Entry:
    """The rig's pictures under other names, raw where the name is not of a compressed topic."""
    for own, image in ((LEFT, left), (RIGHT, right)):
        if entry.topic == f'{own}/{INFO}':
            return entry._replace(
                topic=f'{image.removesuffix("/compressed").rsplit("/", 1)[0]}/{INFO}'
            )
        if entry.topic == f'{own}/{JPEG}':
            if image.endswith('/compressed'):
                return entry._replace(topic=image)
            return raw(entry)._replace(topic=image)
    return entry


ODD = {f'{LEFT}/{JPEG}': '/port/picture', f'{RIGHT}/{JPEG}': '/starboard/picture'} | {
    f'{LEFT}/{INFO}': '/port/camera_info',
    f'{RIGHT}/{INFO}': '/starboard/camera_info',
}


def test_topics_of_any_name_are_given_by_hand(demo_bag: Path, tmp_path: Path) -> None:
    copy = rewritten(demo_bag, tmp_path / 'bag', renamed(ODD))
    refused(process(copy), '/port/picture (8)', '--left /port/picture --right /starboard/picture')
    done = process(copy, '--left', '/port/picture', '--right', 'starboard/picture')
    assert used(done) == PAIRS
    assert figure(done, 'error of target/position against truth, RMS') == figure(
        process(
            rewritten(demo_bag, tmp_path / 'same', lambda entry: entry), '-o', tmp_path / 'o.mcap'
        ),
        'error of target/position against truth, RMS',
    )


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        (('--left', '/port/picture'), '--right'),
        (('--left', '/port/pict', '--right', '/starboard/picture'), 'no topic /port/pict'),
        (('--left', '/port/picture', '--right', '/port/picture'), '--side-by-side'),
        (('--left', '/port/camera_info', '--right', '/port/picture'), 'no images'),
        (('--remap', '/port/picture'), 'write FROM:=TO'),
    ],
)
def test_topics_that_do_not_fit_are_one_line(
    demo_bag: Path, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    refused(process(rewritten(demo_bag, tmp_path / 'bag', renamed(ODD)), *words), says)


def test_topics_are_read_under_other_names(demo_bag: Path, tmp_path: Path) -> None:
    copy = rewritten(demo_bag, tmp_path / 'bag', renamed(ODD))
    rules = [f'{new}:={old}' for old, new in ODD.items()]
    assert used(process(copy, '--remap', *rules)) == PAIRS


def test_swapped_cameras_are_swapped_back(demo_bag: Path, tmp_path: Path) -> None:
    swapped = {f'{LEFT}/{JPEG}': f'{RIGHT}/{JPEG}', f'{RIGHT}/{JPEG}': f'{LEFT}/{JPEG}'}
    copy = rewritten(demo_bag, tmp_path / 'bag', renamed(swapped))
    assert used(process(copy)) == 0
    rules = [f'{new}:={old}' for old, new in swapped.items()]
    done = binopos_here('process', copy, '-o', tmp_path / 'again.mcap', '--remap', *rules)
    assert used(done) == PAIRS


def test_one_of_two_rigs_is_chosen(demo_bag: Path, tmp_path: Path) -> None:
    def double(entry: Entry) -> list[Entry]:
        return [entry, entry._replace(topic=entry.topic.replace('/stereo', '/auv7/front'))]

    copy = rewritten(demo_bag, tmp_path / 'bag', double)
    refused(process(copy), 'more than one rig: /auv7/front, /stereo', '--namespace /auv7/front')
    refused(
        process(copy, '--namespace', '/auv8'), '--namespace /auv8: no image topic lies below it'
    )
    assert used(process(copy, '--namespace', 'auv7/front')) == PAIRS
    with BagReader(tmp_path / 'out.mcap') as reader:
        assert reader.topics['/auv7/front/target/pose'].count == PAIRS


def test_calibrate_takes_topics_by_hand_too(demo_bag: Path, tmp_path: Path) -> None:
    copy = rewritten(demo_bag, tmp_path / 'bag', renamed(ODD), repeat=3)
    same = rewritten(demo_bag, tmp_path / 'same', lambda entry: entry, repeat=3)
    expected = binopos_here('calibrate', 'check', same, '--config', demo_bag / 'binopos.yaml')
    assert expected.returncode in (0, 1), expected.stderr
    refused(binopos_here('calibrate', 'check', copy), '--left /port/picture --right')
    words = ('--left', '/port/picture', '--right', '/starboard/picture')
    assert binopos_here('calibrate', 'check', copy, *words).stdout == expected.stdout
    remap = [f'{new}:={old}' for old, new in ODD.items()]
    done = binopos_here('calibrate', 'check', copy, '--remap', *remap)
    assert done.stdout == expected.stdout
    done = binopos_here('calibrate', 'stereo', copy, *words, '--square', '0.03')
    refused(done, 'board')


@pytest.mark.parametrize('encoding', ['bgr8', 'jpeg'])
def test_two_views_side_by_side_are_a_pair(demo_bag: Path, tmp_path: Path, encoding: str) -> None:
    views: dict[str, Entry] = {}

    def join(entry: Entry) -> Entry | list[Entry]:
        if entry.topic.endswith(JPEG):
            views[entry.topic] = entry
        if entry.topic != f'{RIGHT}/{JPEG}':
            return [] if entry.topic.endswith(JPEG) else entry
        both = np.hstack([pixels_of(views[f'{side}/{JPEG}']) for side in (LEFT, RIGHT)])
        joined = raw(entry, both)._replace(topic='/zed/side_by_side')
        if encoding == 'jpeg':
            jpeg = cv2.imencode('.jpg', both, (cv2.IMWRITE_JPEG_QUALITY, 95))[1].tobytes()
            message = messages.compressed_image(messages.stamp_of(entry.message), 'cam', jpeg)
            joined = joined._replace(message=message, type=messages.COMPRESSED_IMAGE)
        return joined

    copy = rewritten(demo_bag, tmp_path / 'bag', join)
    refused(process(copy), '--side-by-side /zed/side_by_side')
    done = process(copy, '--side-by-side', '/zed/side_by_side')
    assert used(done) == PAIRS
    error = figure(done, 'error of target/position against truth, RMS')
    assert float(error.split()[0]) < 3.0, error


def test_rectified_pictures_are_seen_by_the_cameras_of_p(demo_bag: Path, tmp_path: Path) -> None:
    """Positions are then in the frame of the rectified left picture: the truth, turned by R."""
    infos: dict[str, Any] = {}
    turn: list[np.ndarray] = []

    def rectify(entry: Entry) -> Entry | None:
        side = entry.topic.split('/')[2]
        if entry.topic.endswith(INFO):
            # As cameras with a strong toe-in have them, so that K and P differ well.
            infos[side] = entry.message
            return entry
        if not entry.topic.endswith(JPEG):
            return entry
        info = infos[side]
        k, r, p = info.k.reshape(3, 3), info.r.reshape(3, 3), info.p.reshape(3, 4)
        if side == 'left':
            turn[:] = [r]
        maps = cv2.initUndistortRectifyMap(
            k, info.d, r, p[:, :3], (info.width, info.height), cv2.CV_32FC1
        )
        seen = cv2.remap(pixels_of(entry), *maps, cv2.INTER_CUBIC)
        return raw(entry, seen)._replace(topic=f'/stereo/{side}/image_rect_color')

    copy = rewritten(demo_bag, tmp_path / 'bag', rectify)
    with BagReader(demo_bag) as reader:
        records = reader.messages(['/stereo/truth/pose'])
        truth = np.array([messages.position_of(reader.decode(record)) for record in records])
    normal = turn[0] @ interface_normal(demo_bag)
    words = '--ros-args', '-p', f'triangulator:interface.normal:={normal.tolist()}'
    done = process(copy, *words)
    assert 'rectified' in figure(done, 'note') + done.stdout
    assert used(done) == PAIRS
    with BagReader(tmp_path / 'out.mcap') as reader:
        records = reader.messages(['/stereo/target/position'])
        found = np.array([messages.position_of(reader.decode(record)) for record in records])
    errors = np.linalg.norm(found - truth @ turn[0].T, axis=1)
    assert errors.max() < 0.006, errors


def interface_normal(demo_bag: Path) -> np.ndarray:
    import yaml

    content = yaml.safe_load((demo_bag / 'binopos.yaml').read_text())
    block = content['/**/triangulator']['ros__parameters']['interface']
    normal = np.array(block['normal'])
    return np.asarray(normal / np.linalg.norm(normal))


def test_rectified_pictures_without_p_are_refused(demo_bag: Path, tmp_path: Path) -> None:
    def forget(entry: Entry) -> Entry:
        if entry.topic.endswith(INFO):
            return entry._replace(message=dataclasses.replace(entry.message, p=np.zeros(12)))
        if entry.topic.endswith(JPEG):
            return raw(entry)._replace(topic=entry.topic.replace(JPEG, 'image_rect'))
        return entry

    refused(process(rewritten(demo_bag, tmp_path / 'bag', forget)), 'rectified, which needs P')
