"""The page's server by its door: who gets in, and what they get."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
import urllib.parse

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from binopos_ros.view.errors import ViewError
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.server import PageServer
from binopos_ros.view.source import Look
from binopos_ros.view.wire import read_picture_frame
from page_server import JPEG, Served, Told, health, pose

PATIENCE = 20.0


@pytest.fixture(scope='module')
def served():
    made = Served()
    yield made
    made.server.close()


@pytest.fixture
def serve():
    """Serve with options of a test's own."""
    running = []

    def start(**options):
        running.append(Served(**options))
        return running[-1]

    yield start
    for each in running:
        each.server.close()


def get(authority, path, **headers):
    """Status, headers and body of one GET, its path as it stands."""
    connection = http.client.HTTPConnection(authority, timeout=PATIENCE)
    connection.putrequest('GET', path, skip_host='Host' in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), body


async def received(socket_, wanted):
    """The first message that is wanted; a text is its object."""

    async def first():
        while True:
            message = await socket_.recv()
            message = message if isinstance(message, bytes) else json.loads(message)
            if wanted(message):
                return message

    return await asyncio.wait_for(first(), PATIENCE)


async def watch(viewer):
    """Look at pictures, from when this returns."""
    await viewer.send('{"type": "watch", "pictures": true}')
    await viewer.send('{"type": "press", "name": "nothing"}')
    await received(viewer, is_kind('answer'))


async def sent_away(viewer):
    """Wait until the server closes the connection."""
    while True:
        await asyncio.wait_for(viewer.recv(), PATIENCE)


def is_kind(kind):
    return lambda message: isinstance(message, dict) and message['type'] == kind


def state_with(word):
    return lambda m: isinstance(m, dict) and m['type'] == 'state' and m['health']['word'] == word


def is_picture(message):
    return isinstance(message, bytes)


def alive(served):
    assert get(served.authority, '/')[0] == 200


def test_the_page_and_its_files_come_with_their_types_and_keep_scripts_of_others_out(served):
    status, headers, body = get(served.authority, '/')
    assert status == 200
    assert headers['Content-Type'].startswith('text/html')
    assert "default-src 'self'" in headers['Content-Security-Policy']
    assert body.startswith(b'<!DOCTYPE html>')


def test_a_viewer_gets_what_the_topics_said(served):
    async def look():
        async with connect(f'ws://{served.authority}/ws') as viewer:
            hello = await received(viewer, is_kind('hello'))
            await watch(viewer)
            served.take('target/pose', pose(1_700_000_000_123_456_789, (0.1, -0.2, 1.3)))
            served.take('target/health', health('tracking'))
            served.take('left/centroid', pose(77, (12.5, 30.25, 9.0)))
            served.show('left', 77)
            mark = await received(viewer, is_kind('mark'))
            picture = await received(viewer, is_picture)
            state = await received(viewer, state_with('tracking'))
            return hello, mark, read_picture_frame(picture), state

    hello, mark, picture, state = asyncio.run(look())
    assert hello['title'] == '/stereo'
    assert (mark['side'], mark['stamp'], mark['u'], mark['v']) == ('left', '77', 12.5, 30.25)
    assert (picture.side, picture.stamp, bytes(picture.jpeg)) == ('left', 77, JPEG)
    # To the nanosecond, which a browser's numbers cannot hold.
    assert state['pose']['stamp'] == '1700000000123456789'
    assert state['pose']['position'] == [0.1, -0.2, 1.3]
    assert state['events'] == [] or state['events'][0]['text'] == 'target found'


def test_nothing_is_asked_for_that_nobody_looks_at(serve):
    served = serve()
    assert served.source.looks == [Look()]

    async def look():
        async with connect(f'ws://{served.authority}/ws') as viewer:
            await asyncio.to_thread(served.source.wait_until, lambda look: look.numbers)
            await viewer.send(json.dumps({'type': 'watch', 'pictures': True}))
            await asyncio.to_thread(served.source.wait_until, lambda look: look.pictures)
            await viewer.send(json.dumps({'type': 'watch', 'pictures': False}))
            await asyncio.to_thread(served.source.wait_until, lambda look: not look.pictures)

    asyncio.run(look())
    served.source.wait_until(lambda look: not look.numbers)


def test_two_viewers_both_see_and_one_that_does_not_read_holds_up_nobody(serve):
    served = serve(picture_rate=1000.0)
    large = JPEG + bytes(200_000)
    count = 200

    async def look():
        async with (
            connect(f'ws://{served.authority}/ws', max_queue=1, close_timeout=0.1) as slow,
            connect(f'ws://{served.authority}/ws') as quick,
        ):
            await watch(slow)
            await watch(quick)
            for number in range(count):
                # Within picture_rate.
                await asyncio.sleep(0.002)
                served.show('left', number, large)
                got = read_picture_frame(await received(quick, is_picture))
                assert got.stamp == number
            # What waits for the slow one is in the kernel's buffers and one picture here.
            waiting = [0]
            while waiting[-1] < count - 1:
                waiting.append(read_picture_frame(await received(slow, is_picture)).stamp)
            return len(waiting)

    assert asyncio.run(look()) < count / 2


@pytest.mark.parametrize(
    'path',
    [
        '/../options.py',
        '/page/../../options.py',
        '/%2e%2e/options.py',
        '/..%2f..%2fetc%2fpasswd',
        '//etc/passwd',
        '/./index.html',
        '/index.html/../../options.py',
        '/\\..\\options.py',
        '/index.html%00.js',
        '/' + 'a' * 4000,
    ],
    ids=range(10),
)
def test_no_path_leads_out_of_the_page(served, path):
    before = served.refused().get('no such page', 0)
    assert get(served.authority, path)[0] == 404
    served.wait_refused('no such page', before + 1)


@pytest.mark.parametrize(
    ('headers', 'reason'),
    [
        ({'Origin': 'http://evil.example'}, 'foreign origin'),
        ({'Origin': 'null'}, 'foreign origin'),
        ({'Host': 'evil.example:8470'}, 'unknown host'),
        ({'Host': 'evil.example', 'Origin': 'http://evil.example'}, 'unknown host'),
    ],
)
def test_pages_of_others_are_refused_and_counted(served, headers, reason):
    before = served.refused().get(reason, 0)
    for path in ('/', '/metrics'):
        status, _, body = get(served.authority, path, **headers)
        assert (status, body.decode().strip()) == (403, reason)
    served.wait_refused(reason, before + 2)


def test_a_foreign_page_opens_no_socket_and_a_cockpit_that_is_named_does(serve):
    served = serve(origins=('http://blueos.local',))

    async def knock(origin):
        async with connect(f'ws://{served.authority}/feed', origin=origin) as feed:
            return await asyncio.wait_for(feed.recv(), PATIENCE)

    with pytest.raises(InvalidStatus):
        asyncio.run(knock('http://evil.example'))
    assert served.refused() == {'foreign origin': 1}
    assert '=' in asyncio.run(knock('http://blueos.local'))
    assert '=' in asyncio.run(knock(f'http://{served.authority}'))


def test_others_need_the_token(serve):
    served = serve(listen='0.0.0.0')
    token = urllib.parse.parse_qs(urllib.parse.urlsplit(served.server.address).query)['token'][0]
    assert len(token) >= 20
    assert get(served.authority, '/metrics')[0] == 403
    assert get(served.authority, '/metrics?token=wrong')[0] == 403
    assert get(served.authority, f'/metrics?token={token}')[0] == 200
    assert get(served.authority, '/metrics', Authorization=f'Bearer {token}')[0] == 200

    # By whatever name the network has for this machine.
    named = get(served.authority, f'/metrics?token={token}', Host='robot.example:8470')
    assert named[0] == 200

    async def knock(query):
        async with connect(f'ws://{served.authority}/ws{query}') as viewer:
            return json.loads(await viewer.recv())['type']

    for query in ('', '?token=', '?token=wrong', f'?token={token}x'):
        with pytest.raises(InvalidStatus):
            asyncio.run(knock(query))
    assert asyncio.run(knock(f'?token={token}')) == 'hello'
    assert served.refused() == {'wrong token': 6}


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('{', 'request is not JSON'),
        ('[1]', "request is not an object with a 'type'"),
        (b'\x00\x01', 'request is binary'),
        ('"' + 'a' * 5000 + '"', 'request too long'),
    ],
    ids=['cut short', 'no object', 'binary', 'too long'],
)
def test_nonsense_sends_its_sender_away_and_is_counted(served, words, reason):
    before = served.refused().get(reason, 0)

    async def send():
        async with connect(f'ws://{served.authority}/ws') as viewer:
            await viewer.send(words)
            with pytest.raises(ConnectionClosed):
                await sent_away(viewer)

    asyncio.run(send())
    served.wait_refused(reason, before + 1)
    alive(served)


def test_a_viewer_that_asks_without_end_is_sent_away(served):
    async def ask():
        async with connect(f'ws://{served.authority}/ws') as viewer:
            for _ in range(2000):
                await viewer.send('{"type": "press", "name": "reset"}')
            await sent_away(viewer)

    with pytest.raises(ConnectionClosed):
        asyncio.run(ask())
    served.wait_refused('too many requests', 1)
    assert len(served.source.asked) < 1000
    alive(served)


def test_a_button_is_answered(served):
    async def press():
        async with connect(f'ws://{served.authority}/ws') as viewer:
            await viewer.send('{"type": "press", "name": "reset"}')
            return await received(viewer, is_kind('answer'))

    assert asyncio.run(press()) == {'type': 'answer', 'to': 'reset', 'well': True, 'text': 'done'}


def test_a_thousand_connections_are_cut_off_and_the_page_is_there_afterwards(serve):
    served = serve(max_clients=2)

    async def look():
        async with (
            connect(f'ws://{served.authority}/ws') as first,
            connect(f'ws://{served.authority}/ws'),
        ):
            with pytest.raises(InvalidStatus):
                await connect(f'ws://{served.authority}/ws')
            crowd = []
            for _ in range(10):
                # That say nothing, and go when they have been cut off or are tired.
                crowd = [socket.create_connection(address_of(served)) for _ in range(100)]
                for each in crowd:
                    each.close()
            crowd = [socket.create_connection(address_of(served)) for _ in range(150)]
            await received(first, is_kind('state'))
            for each in crowd:
                each.close()
            await received(first, is_kind('state'))

    asyncio.run(look())
    refused = served.refused()
    assert refused['too many viewers'] == 1
    assert refused['too many connections'] > 0
    alive(served)


def address_of(served):
    return '127.0.0.1', served.server.port


@pytest.mark.parametrize(
    'data',
    [
        b'\x16\x03\x01\x02\x00\x01\x00',
        b'POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\nx',
        b'GET / HTTP/1.1\r\n' + b'A: b\r\n' * 300 + b'\r\n',
        b'GET ' + b'/' * 20000,
        b'\r\n\r\n',
    ],
    ids=['TLS', 'POST', 'many headers', 'long line', 'empty'],
)
def test_what_is_no_request_is_hung_up_on(served, data):
    with socket.create_connection(address_of(served), timeout=PATIENCE) as knocking:
        knocking.sendall(data)
        knocking.shutdown(socket.SHUT_WR)
        answer = b''
        try:
            while chunk := knocking.recv(4096):
                answer += chunk
        except ConnectionResetError:
            pass
    assert b' 200 ' not in answer.split(b'\r\n')[0]
    alive(served)


def test_a_frame_of_wrong_form_is_hung_up_on(served):
    """Not masked, as a client's frames must be; then one of reserved kind."""
    for frame in (b'\x81\x02{}', b'\x83\x80\x00\x00\x00\x00', b'\xff' * 40):
        with socket.create_connection(address_of(served), timeout=PATIENCE) as knocking:
            knocking.sendall(
                f'GET /ws HTTP/1.1\r\nHost: {served.authority}\r\nUpgrade: websocket\r\n'
                'Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
                'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n'.encode()
            )
            assert b'101' in knocking.recv(4096)
            knocking.sendall(frame)
            try:
                while knocking.recv(65536):
                    pass
            except ConnectionResetError:
                pass
    alive(served)


def test_a_picture_that_is_too_large_is_counted_and_not_shown(serve):
    served = serve(max_picture_size=2000)
    served.show('left', 1, bytes(2001))
    assert served.refused() == {'picture larger than max_picture_size': 1}


def test_the_metrics_count_who_was_refused(serve):
    served = serve()
    get(served.authority, '/nothing')
    body = get(served.authority, '/metrics')[2].decode()
    assert 'binopos_view_refused_total{reason="no such page"} 1' in body
    # Who scrapes looks.
    served.source.wait_until(lambda look: look.numbers and not look.pictures)


def test_a_port_that_is_taken_is_one_line_that_says_what_to_do(served):
    with pytest.raises(ViewError, match=r'127\.0\.0\.1 port \d+: .*in use.*--port'):
        PageServer(ViewerOptions(port=served.server.port), Told())
    with pytest.raises(ViewError, match='--listen'):
        PageServer(ViewerOptions(listen='203.0.113.7', port=0), Told())
