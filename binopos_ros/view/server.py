"""The page's server: HTTP and WebSocket on one port, in a thread of its own.

    /            the page and its files
    /ws          texts and pictures for the page (`wire`), and its requests
    /feed        `name=value` lines at 5 Hz
    /metrics     Prometheus text

What is refused is counted by its reason, and shown among the metrics.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from binopos_ros.reasons import count_reason
from binopos_ros.view.access import Access
from binopos_ros.view.errors import ViewError
from binopos_ros.view.mailbox import Mailbox
from binopos_ros.view.metrics import Metric, feed, metrics_of, prometheus
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.pages import load_pages
from binopos_ros.view.screen import Mark, Screen
from binopos_ros.view.source import Look, Source
from binopos_ros.view.viewer import Viewer
from binopos_ros.view.wire import LONGEST_REQUEST, Picture, read_request, text

FEED_PERIOD = 0.2
#: s for which one look at /metrics keeps the numbers coming for the next.
SCRAPE = 60.0
#: s that a connection has to say what it wants.
OPENING = 5.0
#: Connections beyond the viewers that may be on their way in, and wait to be accepted.
OPENING_CONNECTIONS, BACKLOG = 64, 1024
#: Bytes that the kernel may hold for a viewer: a slow one is to see what is new.
SEND_BUFFER = 256 << 10
#: s for which figures that were just computed are good for the next viewer.
FRESH = 0.05
#: Close codes of WebSocket.
TOO_MANY, BAD_REQUEST, TOO_LONG = 1013, 1008, 1009
HEADERS = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': "default-src 'self'; img-src 'self' blob:; connect-src 'self' ws: "
    "wss:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
}


class PageServer:
    """Serves the page of a source, from `start` to `close`.

    Args:
        options: where, and to whom.
        source: feeds it; `post` is how.

    Attributes:
        screen: what there is to see; only touched through `post`.
        refused: requests and connections that were not served, by reason.

    Raises:
        ViewError: the port is taken, the address is not this machine's, or `websockets` is absent.
    """

    def __init__(self, options: ViewerOptions, source: Source) -> None:
        try:
            import websockets.asyncio.server
            from websockets.exceptions import ConnectionClosed
        except ImportError as error:
            msg = "the page needs 'websockets', 14 or later: pip install websockets"
            raise ViewError(msg) from error
        self._library = websockets.asyncio.server
        self._closed = ConnectionClosed
        self.options = options
        self.refused: Counter[str] = Counter()
        self._source = source
        self._access = Access(options.listen, options.token, options.origins)
        self._pages = load_pages()
        self.screen = Screen(self._on_mark)
        self._mailboxes: set[Mailbox] = set()
        self._clients = 0
        self._connections = 0
        self._scraped = -SCRAPE
        self._look = Look()
        self._figures: tuple[float, dict[str, Any]] = (0.0, {})
        self._socket = _listening(options)
        self._loop = asyncio.new_event_loop()
        self._main: asyncio.Task[None] | None = None
        self._thread = threading.Thread(target=self._run, name='page server', daemon=True)
        self._ready = threading.Event()

    def start(self) -> None:
        """Serve from now on; the source may be asked at once."""
        self._thread.start()
        self._ready.wait()

    @property
    def port(self) -> int:
        """The port that is served on."""
        return int(self._socket.getsockname()[1])

    @property
    def address(self) -> str:
        """What to open in a browser, with the token where one is asked for."""
        wild = self.options.listen in ('0.0.0.0', '::')
        host = socket.gethostname() if wild else self.options.listen
        host = f'[{host}]' if ':' in host else host
        token = f'?token={self._access.token}' if self._access.token else ''
        return f'http://{host}:{self.port}/{token}'

    def post(self, do: Callable[..., object], *arguments: Any) -> None:
        """Let the server's thread do something; nothing once it is closed."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(do, *arguments)

    def show(self, picture: Picture) -> None:
        """Show a picture to all who look; in the server's thread."""
        if len(picture.jpeg) > self.options.max_picture_size:
            self.refuse('picture larger than max_picture_size')
            return
        self.screen.picture(picture.side, self._source.instant().now)
        for mailbox in self._mailboxes:
            mailbox.put_picture(picture)

    def configure(self, options: ViewerOptions) -> None:
        """Take changed options; for viewers that come from now on."""
        self.options = options

    def refuse(self, reason: str) -> None:
        """Count what was not served or could not be shown."""
        count_reason(self.refused, reason)

    def close(self) -> None:
        """Send the viewers away and end the thread."""
        if self._main is not None:
            self.post(self._main.cancel)
            self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._main = self._loop.create_task(self._serve())
        try:
            self._loop.run_until_complete(self._main)
        except asyncio.CancelledError:
            pass
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        serving = self._library.serve(
            self._on_connection,
            sock=self._socket,
            backlog=BACKLOG,
            process_request=self._on_request,
            create_connection=self._connection_type(),
            compression=None,
            server_header=None,
            open_timeout=OPENING,
            close_timeout=1.0,
            max_size=LONGEST_REQUEST,
            max_queue=4,
            logger=_silent_logger(),
        )
        async with serving:
            self._ready.set()
            while True:
                await asyncio.sleep(1.0)
                self._look_again()

    def _connection_type(self) -> type:
        """A connection that counts itself, and is not let in where too many are on their way."""
        server = self
        limit = OPENING_CONNECTIONS + self.options.max_clients

        class Counted(self._library.ServerConnection):  # type: ignore[misc, name-defined]
            def connection_made(self, transport: Any) -> None:
                super().connection_made(transport)
                server._connections += 1
                peer = transport.get_extra_info('socket')
                if peer is not None:
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
                if server._connections > limit:
                    server.refuse('too many connections')
                    transport.abort()

            def connection_lost(self, error: Exception | None) -> None:
                server._connections -= 1
                if self.request is None and server._connections < limit:
                    server.refuse('no request that could be read')
                super().connection_lost(error)

        return Counted

    def _on_request(self, connection: Any, request: Any) -> Any:
        """Answer HTTP; None lets a WebSocket open."""
        path = urlsplit(request.path).path
        is_socket = path in ('/ws', '/feed')
        refusal = self._access.refusal(
            request.path, _known_headers(request.headers), guarded=is_socket or path == '/metrics'
        )
        if refusal:
            return self._refusal(connection, HTTPStatus.FORBIDDEN, refusal)
        if is_socket:
            if self._clients >= self.options.max_clients:
                return self._refusal(
                    connection, HTTPStatus.SERVICE_UNAVAILABLE, 'too many viewers'
                )
            return None
        if path == '/metrics':
            self._scraped = time.monotonic()
            self._look_again()
            return _response('text/plain; version=0.0.4; charset=utf-8', self._metrics().encode())
        if path not in self._pages:
            return self._refusal(connection, HTTPStatus.NOT_FOUND, 'no such page')
        return _response(*self._pages[path])

    def _refusal(self, connection: Any, status: HTTPStatus, reason: str) -> Any:
        self.refuse(reason)
        return connection.respond(status, f'{reason}\n')

    async def _on_connection(self, connection: Any) -> None:
        if self._clients >= self.options.max_clients:
            # Several have passed the door at once.
            self.refuse('too many viewers')
            await connection.close(TOO_MANY, 'too many viewers')
            return
        self._clients += 1
        try:
            if urlsplit(connection.request.path).path == '/feed':
                await self._feed(connection)
            else:
                await self._view(connection)
        except self._closed:
            return
        finally:
            self._clients -= 1
            self._look_again()

    async def _feed(self, connection: Any) -> None:
        self._look_again()
        while True:
            for line in feed(self._numbers()):
                await connection.send(line)
            await asyncio.sleep(FEED_PERIOD)

    async def _view(self, connection: Any) -> None:
        mailbox = Mailbox(self.options.picture_rate)
        viewer = Viewer(connection, self.screen, self._numbers, mailbox)
        self._mailboxes.add(mailbox)
        self._look_again()
        await connection.send(text('hello', self._source.about()))
        sending = asyncio.ensure_future(viewer.send_for_ever())
        try:
            async for words in connection:
                problem = self._request(viewer, mailbox, words)
                if problem:
                    self.refuse(problem)
                    await connection.close(BAD_REQUEST, problem)
                    return
        except self._closed as error:
            if error.sent is not None and error.sent.code == TOO_LONG:
                self.refuse('request too long')
            raise
        finally:
            self._mailboxes.discard(mailbox)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, self._closed):
                await sending

    def _request(self, viewer: Viewer, mailbox: Mailbox, words: str | bytes) -> str:
        """Do what a viewer asks; '' or why it is sent away."""
        if not viewer.may_ask():
            return 'too many requests'
        if isinstance(words, bytes):
            return 'request is binary'
        try:
            request = read_request(words)
        except ViewError as error:
            return str(error)
        if request['type'] == 'watch':
            mailbox.wants_pictures = request.get('pictures') is True
            mailbox.wants_drawn = request.get('drawn') is True
            self._look_again()
            return ''

        def answer(well: bool, told: str) -> None:
            answered = {'to': request.get('name', request['type']), 'well': well, 'text': told}
            self.post(mailbox.put_answer, text('answer', answered))

        self._source.ask(request, answer)
        return ''

    def _on_mark(self, mark: Mark) -> None:
        if any(mailbox.wants_pictures for mailbox in self._mailboxes):
            words = text('mark', {**mark._asdict(), 'stamp': str(mark.stamp)})
            for mailbox in self._mailboxes:
                mailbox.put_mark(words)

    def _numbers(self) -> dict[str, Any]:
        made, figures = self._figures
        now = time.monotonic()
        if now - made > FRESH:
            figures = {**self.screen.numbers(self._source.instant()), **self._source.more()}
            self._figures = (now, figures)
        return figures

    def _metrics(self) -> str:
        own = [
            Metric('view_viewers', 'gauge', 'Pages and feeds that are open.', self._clients),
            *(
                Metric('view_refused_total', 'counter', 'Not served.', count, {'reason': reason})
                for reason, count in sorted(self.refused.items())
            ),
        ]
        return prometheus([*metrics_of(self._numbers()), *own])

    def _look_again(self) -> None:
        """Tell the source where what is looked at has changed."""
        scraped = time.monotonic() - self._scraped < SCRAPE
        looking = self._mailboxes
        look = Look(
            numbers=self._clients > 0 or scraped,
            pictures=any(each.wants_pictures and not each.wants_drawn for each in looking),
            drawings=any(each.wants_pictures and each.wants_drawn for each in looking),
            boards=any(each.wants_pictures for each in looking),
        )
        if look != self._look:
            self._look = look
            self._source.look(look)


def _listening(options: ViewerOptions) -> socket.socket:
    family = socket.AF_INET6 if ':' in options.listen else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((options.listen, options.port))
        made.listen(BACKLOG)
    except OSError as error:
        made.close()
        msg = (
            f'the page cannot be served on {options.listen} port {options.port}: '
            f"{error.strerror or error}; choose another (--port or --listen of 'binopos view', "
            "the viewer's parameters elsewhere)"
        )
        raise ViewError(msg) from error
    return made


def _known_headers(headers: Any) -> Mapping[str, str]:
    """Those that access is judged by; a header that comes twice is none."""
    known = {}
    for name in ('Host', 'Origin', 'Authorization'):
        values = headers.get_all(name)
        if len(values) == 1:
            known[name] = values[0]
        elif values:
            known[name] = 'given more than once'
    return known


def _response(kind: str, body: bytes) -> Any:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    length = str(len(body))
    headers = Headers({**HEADERS, 'Content-Type': kind, 'Content-Length': length})
    headers['Connection'] = 'close'
    return Response(HTTPStatus.OK.value, HTTPStatus.OK.phrase, headers, body)


def _silent_logger() -> logging.Logger:
    """Who knocks with nonsense is counted; lines of log are his to write otherwise."""
    logger = logging.getLogger('binopos_ros.view')
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    logger.setLevel(logging.CRITICAL + 1)
    return logger
