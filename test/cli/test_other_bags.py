"""Bags as other people's rigs record them, by the verb: every pair of them is used."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

import malice
from binopos_ros.bag import BagReader, BagWriter, messages
from binopos_ros.cli import main

pytestmark = pytest.mark.xdist_group('other_bags')

PAIRS = 8
LEFT, RIGHT = '/stereo/left', '/stereo/right'
JPEG, INFO = 'image_raw/compressed', 'camera_info'
STRING = 'std_msgs/msg/String'


class Done(NamedTuple):
    status: int
    stdout: str
    stderr: str


class Entry(NamedTuple):
    """A message on its way into a bag."""

    topic: str
    log_ns: int
    message: Any
    type: str = ''  #: '' keeps that of the topic it came from


def binopos(*words: object) -> Done:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            status = main([str(word) for word in words])
        except SystemExit as leaving:
            status = int(leaving.code or 0)
    return Done(status, out.getvalue(), err.getvalue())


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('other') / 'bag'
    assert binopos('simulate', '-o', folder, '--preset', 'demo', '--pairs', PAIRS).status == 0
    return folder


Change = Callable[[Entry], 'Entry | list[Entry] | None']


def rewritten(bag: Path, copy: Path, change: Change, *, repeat: int = 1) -> Path:
    """A copy of a bag: `change` gives what becomes of each message; `repeat` plays it again."""
    entries: list[Entry] = []
    with BagReader(bag) as reader:
        length = reader.end_ns - reader.start_ns + 33_333_333
        for turn in range(repeat):
            for record in reader.messages():
                message = reader.decode(record)
                stamp = messages.stamp_of(message) + turn * length
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
                log_ns = record.stamp_ns + turn * length
                kind = reader.topics[record.topic].type
                changed = change(Entry(record.topic, log_ns, message, kind))
                entries += changed if isinstance(changed, list) else [changed] if changed else []
    with BagWriter(copy) as writer:
        for topic, kind in {entry.topic: entry.type for entry in entries}.items():
            writer.add_topic(topic, kind)
        for entry in sorted(entries, key=lambda each: each.log_ns):
            writer.write(entry.topic, entry.log_ns, entry.message)
    (copy / 'binopos.yaml').write_text((bag / 'binopos.yaml').read_text())
    return copy


def renamed(names: dict[str, str]) -> Change:
    """Topics that begin with a name begin with another."""

    def rename(entry: Entry) -> Entry:
        for old, new in names.items():
            if entry.topic.startswith(old):
                return entry._replace(topic=new + entry.topic.removeprefix(old))
        return entry

    return rename


def process(bag: Path, *words: object) -> Done:
    return binopos('process', bag, '-o', bag.parent / 'out.mcap', *words)


def figure(done: Done, name: str) -> str:
    assert 'Traceback' not in done.stderr
    found = [
        line.split('  ')[-1].strip()
        for line in done.stdout.splitlines()
        if line.startswith(f'  {name} ')
    ]
    assert found, done.stdout + done.stderr
    return found[0]


def used(done: Done) -> int:
    return int(figure(done, 'pairs used'))


def refused(done: Done, *words: str) -> None:
    assert done.status == 2, done.stdout + done.stderr
    assert done.stderr.count('\n') == 1, done.stderr
    for word in words:
        assert word in done.stderr


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
    bag: Path, tmp_path: Path, left: str, right: str
) -> None:
    copy = rewritten(bag, tmp_path / 'bag', lambda entry: as_camera(entry, left, right))
    done = process(copy)
    assert int(figure(done, 'pairs seen')) == PAIRS
    # The contract's own names need no word.
    assert (f'left {left}, right {right}' in done.stdout) == (left != ISAAC)
    # A picture that is not rectified under a name that says so gives what it gives.
    if 'rect' not in left:
        assert used(done) == PAIRS


def test_of_one_cameras_pictures_those_that_tell_most_are_taken(bag: Path, tmp_path: Path) -> None:
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

    done = process(rewritten(bag, tmp_path / 'bag', publish))
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


def pixels_of(entry: Entry) -> np.ndarray:
    return np.asarray(cv2.imdecode(entry.message.data, cv2.IMREAD_COLOR))


def raw(entry: Entry, pixels: np.ndarray | None = None, encoding: str = 'bgr8') -> Entry:
    """The same picture, or another, as sensor_msgs/Image."""
    pixels = np.ascontiguousarray(pixels_of(entry) if pixels is None else pixels)
    height, width = pixels.shape[:2]
    message = messages.image(
        messages.stamp_of(entry.message),
        entry.message.header.frame_id,
        pixels.view(np.uint8).ravel(),
        (width, height),
        encoding,
        pixels.nbytes // height,
    )
    return entry._replace(message=message, type=messages.IMAGE)


ODD = {f'{LEFT}/{JPEG}': '/port/picture', f'{RIGHT}/{JPEG}': '/starboard/picture'} | {
    f'{LEFT}/{INFO}': '/port/camera_info',
    f'{RIGHT}/{INFO}': '/starboard/camera_info',
}


def test_topics_of_any_name_are_given_by_hand(bag: Path, tmp_path: Path) -> None:
    copy = rewritten(bag, tmp_path / 'bag', renamed(ODD))
    refused(process(copy), '/port/picture (8)', '--left /port/picture --right /starboard/picture')
    done = process(copy, '--left', '/port/picture', '--right', 'starboard/picture')
    assert used(done) == PAIRS
    assert figure(done, 'error of target/position against truth, RMS') == figure(
        process(rewritten(bag, tmp_path / 'same', lambda entry: entry), '-o', tmp_path / 'o.mcap'),
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
    bag: Path, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    refused(process(rewritten(bag, tmp_path / 'bag', renamed(ODD)), *words), says)


def test_topics_are_read_under_other_names(bag: Path, tmp_path: Path) -> None:
    copy = rewritten(bag, tmp_path / 'bag', renamed(ODD))
    rules = [f'{new}:={old}' for old, new in ODD.items()]
    assert used(process(copy, '--remap', *rules)) == PAIRS


def test_swapped_cameras_are_swapped_back(bag: Path, tmp_path: Path) -> None:
    swapped = {f'{LEFT}/{JPEG}': f'{RIGHT}/{JPEG}', f'{RIGHT}/{JPEG}': f'{LEFT}/{JPEG}'}
    copy = rewritten(bag, tmp_path / 'bag', renamed(swapped))
    assert used(process(copy)) == 0
    rules = [f'{new}:={old}' for old, new in swapped.items()]
    done = binopos('process', copy, '-o', tmp_path / 'again.mcap', '--remap', *rules)
    assert used(done) == PAIRS


def test_one_of_two_rigs_is_chosen(bag: Path, tmp_path: Path) -> None:
    def double(entry: Entry) -> list[Entry]:
        return [entry, entry._replace(topic=entry.topic.replace('/stereo', '/auv7/front'))]

    copy = rewritten(bag, tmp_path / 'bag', double)
    refused(process(copy), 'more than one rig: /auv7/front, /stereo', '--namespace /auv7/front')
    assert used(process(copy, '--namespace', 'auv7/front')) == PAIRS
    with BagReader(tmp_path / 'out.mcap') as reader:
        assert reader.topics['/auv7/front/target/pose'].count == PAIRS


def test_calibrate_takes_topics_by_hand_too(bag: Path, tmp_path: Path) -> None:
    copy = rewritten(bag, tmp_path / 'bag', renamed(ODD), repeat=3)
    same = rewritten(bag, tmp_path / 'same', lambda entry: entry, repeat=3)
    expected = binopos('calibrate', 'check', same, '--config', bag / 'binopos.yaml')
    assert expected.status in (0, 1), expected.stderr
    refused(binopos('calibrate', 'check', copy), '--left /port/picture --right')
    words = ('--left', '/port/picture', '--right', '/starboard/picture')
    assert binopos('calibrate', 'check', copy, *words) == expected
    remap = [f'{new}:={old}' for old, new in ODD.items()]
    assert binopos('calibrate', 'check', copy, '--remap', *remap) == expected
    done = binopos('calibrate', 'stereo', copy, *words, '--square', '0.03')
    refused(done, 'board')


@pytest.mark.parametrize('encoding', ['bgr8', 'jpeg'])
def test_two_views_side_by_side_are_a_pair(bag: Path, tmp_path: Path, encoding: str) -> None:
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

    copy = rewritten(bag, tmp_path / 'bag', join)
    refused(process(copy), '--side-by-side /zed/side_by_side')
    done = process(copy, '--side-by-side', '/zed/side_by_side')
    assert used(done) == PAIRS
    error = figure(done, 'error of target/position against truth, RMS')
    assert float(error.split()[0]) < 3.0, error


def test_rectified_pictures_are_seen_by_the_cameras_of_p(bag: Path, tmp_path: Path) -> None:
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

    copy = rewritten(bag, tmp_path / 'bag', rectify)
    with BagReader(bag) as reader:
        records = reader.messages(['/stereo/truth/pose'])
        truth = np.array([messages.position_of(reader.decode(record)) for record in records])
    normal = turn[0] @ interface_normal(bag)
    words = '--ros-args', '-p', f'triangulator:interface.normal:={normal.tolist()}'
    done = process(copy, *words)
    assert 'rectified' in figure(done, 'note') + done.stdout
    assert used(done) == PAIRS
    with BagReader(tmp_path / 'out.mcap') as reader:
        records = reader.messages(['/stereo/target/position'])
        found = np.array([messages.position_of(reader.decode(record)) for record in records])
    errors = np.linalg.norm(found - truth @ turn[0].T, axis=1)
    assert errors.max() < 0.006, errors


def interface_normal(bag: Path) -> np.ndarray:
    import yaml

    content = yaml.safe_load((bag / 'binopos.yaml').read_text())
    block = content['/**/triangulator']['ros__parameters']['interface']
    normal = np.array(block['normal'])
    return np.asarray(normal / np.linalg.norm(normal))


def test_rectified_pictures_without_p_are_refused(bag: Path, tmp_path: Path) -> None:
    def forget(entry: Entry) -> Entry:
        if entry.topic.endswith(INFO):
            return entry._replace(message=dataclasses.replace(entry.message, p=np.zeros(12)))
        if entry.topic.endswith(JPEG):
            return raw(entry)._replace(topic=entry.topic.replace(JPEG, 'image_rect'))
        return entry

    refused(process(rewritten(bag, tmp_path / 'bag', forget)), 'rectified, which needs P')


def test_raw_beside_compressed_is_one_stream(bag: Path, tmp_path: Path) -> None:
    def double(entry: Entry) -> list[Entry]:
        if entry.topic.endswith(JPEG):
            return [entry, raw(entry)._replace(topic=entry.topic.removesuffix('/compressed'))]
        return [entry]

    done = process(rewritten(bag, tmp_path / 'bag', double))
    assert figure(done, 'pairs seen') == figure(done, 'pairs used') == str(PAIRS)
    assert figure(done, 'dropped') == '0'


def test_a_bag_in_sqlite_gives_what_the_same_in_mcap_gives(bag: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'old'
    folder.mkdir()
    with BagReader(bag) as reader:
        topics = {topic: info.type for topic, info in reader.topics.items()}
        rows = [(each.topic, each.stamp_ns, each.data) for each in reader.messages()]
    malice.sqlite_bag(folder / 'old_0.db3', topics, rows)
    (folder / 'binopos.yaml').write_text((bag / 'binopos.yaml').read_text())
    tables = [tmp_path / name for name in ('one.csv', 'two.csv')]
    for source, table in zip((bag, folder), tables, strict=True):
        done = binopos('process', source, '-o', table.with_suffix('.mcap'), '--csv', table)
        assert used(done) == PAIRS
    assert tables[0].read_bytes() == tables[1].read_bytes()


TURNS = 19
MANY = PAIRS * TURNS


def late(topics: str, nanoseconds: int) -> Change:
    def delay(entry: Entry) -> Entry:
        late = topics in entry.topic
        return entry._replace(log_ns=entry.log_ns + nanoseconds) if late else entry

    return delay


@pytest.mark.parametrize(
    ('topics', 'seconds'),
    [('camera_info', 4.0), ('camera_info', 60.0), ('/right/image_raw', 2.5), ('/left/', 30.0)],
)
def test_what_was_logged_late_is_used_all_the_same(
    bag: Path, tmp_path: Path, topics: str, seconds: float
) -> None:
    change = late(topics, int(seconds * 1e9))
    done = process(rewritten(bag, tmp_path / 'bag', change, repeat=TURNS))
    assert figure(done, 'pairs seen') == figure(done, 'pairs used') == str(MANY)


def test_a_calibration_that_comes_after_an_empty_one_is_used(bag: Path, tmp_path: Path) -> None:
    seen = iter(range(10_000))

    def forget(entry: Entry) -> Entry:
        if entry.topic == f'{RIGHT}/{INFO}' and next(seen) < PAIRS // 2:
            return entry._replace(message=dataclasses.replace(entry.message, k=np.zeros(9)))
        return entry

    done = process(rewritten(bag, tmp_path / 'bag', forget))
    assert used(done) == PAIRS
    assert 'camera_info of the right camera is left out' in done.stdout


def test_both_cameras_that_start_again_keep_their_pairs_however_late_one_is_logged(
    bag: Path, tmp_path: Path
) -> None:
    counts: dict[str, int] = {}

    def jump(entry: Entry) -> Entry:
        count = counts[entry.topic] = counts.get(entry.topic, -1) + 1
        if count >= MANY // 2:
            entry.message.header.stamp.sec -= 3600
        return late('/right/', 1_500_000_000)(entry)

    done = process(rewritten(bag, tmp_path / 'bag', jump, repeat=TURNS))
    assert used(done) >= MANY - 2


def test_calibration_files_beside_a_bag_without_camera_info_are_used(
    bag: Path, tmp_path: Path
) -> None:
    copy = rewritten(bag, tmp_path / 'bag', lambda e: None if e.topic.endswith(INFO) else e)
    refused(process(copy), f'{LEFT}/{INFO} is missing', '--calibration DIR')
    assert used(process(copy, '--calibration', bag)) == PAIRS
    (tmp_path / 'out.mcap').unlink()
    for side in ('left', 'right'):
        (copy / f'{side}.yaml').write_text((bag / f'{side}.yaml').read_text())
    done = process(copy)
    assert used(done) == PAIRS
    assert 'calibration: ' in figure(done, 'note')


@pytest.mark.parametrize(
    ('topic', 'says'),
    [
        (f'{LEFT}/{JPEG}', f'{JPEG} holds {STRING}'),
        (f'{LEFT}/{INFO}', f'it holds {STRING}'),
    ],
)
def test_a_topic_of_the_wrong_type_is_named(
    bag: Path, tmp_path: Path, topic: str, says: str
) -> None:
    refused(process(rewritten(bag, tmp_path / 'bag', as_string(topic))), topic, says)


def test_a_truth_of_the_wrong_type_is_left_out(bag: Path, tmp_path: Path) -> None:
    done = process(rewritten(bag, tmp_path / 'bag', as_string('/stereo/truth/pose')))
    assert used(done) == PAIRS
    assert f'/stereo/truth/pose holds {STRING}' in done.stdout


def as_string(topic: str) -> Change:
    from binopos_ros.bag.definitions import jazzy

    def change(entry: Entry) -> Entry:
        if entry.topic != topic:
            return entry
        return entry._replace(message=jazzy().types[STRING](data='what?'), type=STRING)

    return change


def test_stamps_that_are_zero_and_frames_without_a_name_are_told(
    bag: Path, tmp_path: Path
) -> None:
    def forget(entry: Entry) -> Entry:
        if entry.topic.startswith(LEFT):
            entry.message.header.stamp.sec = entry.message.header.stamp.nanosec = 0
            entry.message.header.frame_id = ''
        return entry

    done = process(rewritten(bag, tmp_path / 'bag', forget))
    assert done.status == 1
    assert "left: the stamp is zero: the camera's driver sets none" in done.stdout
    assert f'{LEFT}/{JPEG}: frame_id is empty' in done.stdout


@pytest.fixture(autouse=True)
def one_output(tmp_path: Path) -> Iterator[None]:
    """Outputs of earlier calls in the same folder are not in the way."""
    yield
    (tmp_path / 'out.mcap').unlink(missing_ok=True)
