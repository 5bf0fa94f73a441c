"""A page server without ROS: its source is the test."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace as Message

import numpy as np

from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.screen import Instant
from binopos_ros.view.server import PageServer
from binopos_ros.view.source import Look
from binopos_ros.view.wire import Picture

JPEG = b'\xff\xd8 the bytes of a camera \xff\xd9'


class Told:
    """A source that remembers what it was told, and answers that it did as asked."""

    def __init__(self):
        self.looks = [Look()]
        self.asked = []
        self.changed = threading.Condition()

    def about(self):
        return {'title': '/stereo', 'mode': 'live', 'buttons': []}

    def more(self):
        return {}

    def instant(self):
        return Instant(time.monotonic(), time.time())

    def look(self, look):
        with self.changed:
            self.looks.append(look)
            self.changed.notify_all()

    def ask(self, request, answer):
        self.asked.append(request)
        answer(True, 'done')

    def wait_until(self, condition):
        with self.changed:
            assert self.changed.wait_for(lambda: condition(self.looks[-1]), 20)


class Served:
    """A server that runs, and what it is fed."""

    def __init__(self, **options):
        self.source = Told()
        self.server = PageServer(ViewerOptions(port=0, **options), self.source)
        self.server.start()
        self.authority = f'127.0.0.1:{self.server.port}'

    def take(self, topic, message):
        self.server.post(self.server.screen.take, topic, message, self.source.instant())

    def show(self, side, stamp, jpeg=JPEG):
        self.server.post(self.server.show, Picture(side, stamp, jpeg))

    def refused(self):
        """Reasons with their counts, once the server's thread has come to this."""
        done = threading.Event()
        found = {}
        self.server.post(lambda: (found.update(self.server.refused), done.set()))
        assert done.wait(20)
        return found

    def wait_refused(self, reason, count):
        """Wait until so many were refused for a reason; the last may just be on its way out."""
        deadline = time.monotonic() + 20
        while self.refused().get(reason, 0) != count:
            assert time.monotonic() < deadline, self.refused()
            time.sleep(0.01)


def header(stamp, frame='left_camera_optical_frame'):
    seconds, rest = divmod(stamp, 10**9)
    return Message(stamp=Message(sec=seconds, nanosec=rest), frame_id=frame)


def pose(stamp, position, covariance=None):
    """A PoseWithCovarianceStamped as the suite reads it."""
    full = np.zeros((6, 6))
    full[:3, :3] = np.eye(3) * 1e-6 if covariance is None else covariance
    x, y, z = position
    return Message(
        header=header(stamp),
        pose=Message(
            pose=Message(position=Message(x=x, y=y, z=z)), covariance=full.ravel().tolist()
        ),
    )


def health(word, reason=''):
    return Message(message=word, values=[Message(key='Reason', value=reason)])


def diagnostics(node, level, message, **values):
    status = Message(
        name=f'stereo/{node}: stage',
        level=bytes([level]),
        message=message,
        values=[Message(key=key, value=value) for key, value in values.items()],
    )
    return Message(status=[status])
