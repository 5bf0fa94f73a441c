"""A dive's bags on the page and in a report: what was written there, at its time."""

from __future__ import annotations

import asyncio
import json
import re
import threading

import cv2
import numpy as np
import pytest
from websockets.asyncio.client import connect

from binopos_ros.bag import BagWriter, results
from binopos_ros.bag import messages as made
from binopos_ros.view.dive import Dive
from binopos_ros.view.drawing import curve, path
from binopos_ros.view.errors import ViewError
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.recorded import BagPage
from binopos_ros.view.wire import read_picture_frame
from verbs import binopos_here, refused

START = 1_700_000_000 * 10**9
STEP = 33_333_333
COUNT = 90
PATIENCE = 20.0


def stamp(number):
    return START + number * STEP


def jpeg(number):
    return bytes(cv2.imencode('.jpg', np.full((24, 32, 3), number, np.uint8))[1])


def health(word, reason):
    return made.status('', 'target', 0, word, {'Reason': reason})


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """What was processed, and the recording with its pictures: a metre to the right."""
    folder = tmp_path_factory.mktemp('dive')
    processed, recorded = folder / 'processed.mcap', folder / 'recorded.mcap'
    with BagWriter(processed) as bag:
        bag.add_topic('/stereo/target/pose', made.POSE_WITH_COVARIANCE)
        bag.add_topic('/stereo/target/health', made.STATUS)
        for number in range(COUNT):
            place = (number / (COUNT - 1), 0.0, 1.2)
            pose = results.pose_with_covariance(stamp(number), 'map', place, np.eye(3) * 1e-8)
            bag.write('/stereo/target/pose', stamp(number), pose)
            word = ('lost', 'no position was used for 0.5 s') if number > 60 else ('tracking', '')
            bag.write('/stereo/target/health', stamp(number), health(*word))
    with BagWriter(recorded) as bag:
        topics = {side: f'/stereo/{side}/image_raw/compressed' for side in ('left', 'right')}
        for topic in topics.values():
            bag.add_topic(topic, made.COMPRESSED_IMAGE)
        # Of the recording; what was processed afterwards counts.
        bag.add_topic('/stereo/target/pose', made.POSE_WITH_COVARIANCE)
        bad = results.pose_with_covariance(START, 'map', (9.0, 9.0, 9.0), np.eye(3))
        bag.write('/stereo/target/pose', START, bad)
        for number in range(COUNT):
            for topic in topics.values():
                picture = made.compressed_image(stamp(number), '', jpeg(number))
                bag.write(topic, stamp(number), picture)
    return processed, recorded


@pytest.fixture
def page(bags):
    with Dive(bags) as dive:
        made_page = BagPage(dive, ViewerOptions(port=0))
        running = threading.Thread(target=made_page.run)
        running.start()
        yield made_page
        made_page.close()
        running.join()


async def arrival(viewer, number):
    """Wait until the pose and both pictures of one instant are shown."""
    got = {}

    async def look():
        while got != dict.fromkeys(('pose', 'left', 'right'), stamp(number)):
            message = await viewer.recv()
            if isinstance(message, bytes):
                picture = read_picture_frame(message)
                got[picture.side] = picture.stamp
                assert bytes(picture.jpeg) == jpeg((picture.stamp - START) // STEP)
            elif (told := json.loads(message))['type'] == 'state' and told['pose']:
                got['pose'] = int(told['pose']['stamp'])
                state = told
        return state

    return await asyncio.wait_for(look(), PATIENCE)


def test_a_bag_is_gone_through_to_the_very_pose(page):
    async def look():
        async with connect(page.address.replace('http', 'ws') + 'ws') as viewer:
            hello = json.loads(await viewer.recv())
            await viewer.send('{"type": "watch", "pictures": true}')
            await viewer.send(json.dumps({'type': 'seek', 'at': 30 * STEP * 1e-9 + 0.001}))
            state = await arrival(viewer, 30)
            await viewer.send('{"type": "step", "by": 1}')
            await arrival(viewer, 31)
            await viewer.send('{"type": "step", "by": -1}')
            await arrival(viewer, 30)
            await viewer.send('{"type": "speed", "rate": 20}')
            await viewer.send('{"type": "play"}')
            end = await arrival(viewer, COUNT - 1)
            return hello, state, end

    hello, state, end = asyncio.run(look())
    assert hello['mode'] == 'bag'
    assert hello['duration'] == pytest.approx((COUNT - 1) * STEP * 1e-9)
    assert state['pose']['position'] == pytest.approx([30 / (COUNT - 1), 0.0, 1.2])
    assert state['pose']['frame'] == 'map'
    assert end['pose']['position'] == pytest.approx([1.0, 0.0, 1.2])
    assert end['health']['word'] == 'lost'


def test_nonsense_is_answered_and_changes_nothing(page):
    async def ask():
        async with connect(page.address.replace('http', 'ws') + 'ws') as viewer:
            for words in (
                '{"type": "seek", "at": "x"}',
                '{"type": "seek", "at": NaN}',
                '{"type": "step", "by": 1e9}',
                '{"type": "speed", "rate": true}',
                '{"type": "press", "name": "reset"}',
            ):
                await viewer.send(words)
                while (told := json.loads(await viewer.recv()))['type'] != 'answer':
                    pass
                assert (told['well'], told['text']) == (False, 'not known')

    asyncio.run(asyncio.wait_for(ask(), PATIENCE))


def test_a_report_tells_the_dive_and_needs_nothing_beside_it(bags, tmp_path):
    out = tmp_path / 'dive.html'
    done = binopos_here('report', *bags, '-o', out)
    assert done.returncode == 0, done.stderr
    text = out.read_text()
    assert f'<td class="n">{COUNT}</td>' in text
    assert '1.000 m' in text
    assert '0.10 mm, 0.10 mm' in text
    lost = (COUNT - 1 - 61) * STEP * 1e-9
    assert f'lost {lost:.1f} s' in text
    assert 'target lost: no position was used for 0.5 s' in text
    assert text.count('data:image/jpeg;base64,') == 2
    for word in ('x (m)', 'y (m)', 'z (m)', 'time (s)', 'prefers-color-scheme: dark'):
        assert word.replace(': ', ':') in text
    # Nothing is fetched.
    assert not re.search(r'(src|href)=(?!"data:)', text)
    assert 'processed.mcap' in text
    refused(binopos_here('report', *bags, '-o', out), 'exists already', '--force')


def test_a_bag_with_nothing_to_show_is_one_line(tmp_path):
    bag = tmp_path / 'strange.mcap'
    with BagWriter(bag) as writing:
        writing.add_topic('/strange', made.VECTOR3)
        writing.write('/strange', 1, results.vector3(1, '', (0, 0, 0)))
    out = tmp_path / 'dive.html'
    refused(binopos_here('report', bag, '-o', out), str(bag), "the suite's topics")
    assert not out.exists()
    refused(binopos_here('view', bag, '--port', 0), str(bag))
    refused(binopos_here('view', tmp_path / 'none.mcap'), 'none.mcap')
    refused(binopos_here('view', bag, '--port', 70000), 'port')
    with pytest.raises(ViewError):
        Dive([bag])


def test_curves_break_where_nothing_was_measured_and_paths_are_to_scale():
    times = np.r_[np.arange(0, 2, 0.1), np.arange(10, 12, 0.1)]
    drawn = curve('x', 'm', times, np.ones_like(times), np.full_like(times, 0.01))
    assert drawn.count('<polyline') == 2
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    points = re.search(r'polyline class="line" points="([^"]+)"', path('', 'm', 'xy', square))[1]
    (a, b, c) = (np.array(each.split(','), float) for each in points.split())
    assert np.linalg.norm(b - a) == pytest.approx(np.linalg.norm(c - b), abs=0.2)
