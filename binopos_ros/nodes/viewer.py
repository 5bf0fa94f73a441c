"""The viewer node: the operator's page, fed from the live topics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from binopos_ros.detection import DetectionError
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.interfaces import installed_class
from binopos_ros.nodes.onlooker import Onlooker
from binopos_ros.nodes.pictures import Pictures
from binopos_ros.nodes.running import run
from binopos_ros.nodes.shell import StageNode, sensor_data
from binopos_ros.nodes.triggers import offer_triggers
from binopos_ros.nodes.viewer_buttons import Buttons
from binopos_ros.nodes.viewer_recording import Recordings
from binopos_ros.nodes.viewer_stills import Stills
from binopos_ros.nodes.viewer_surface import Surface
from binopos_ros.sides import SIDES
from binopos_ros.view.encoding import encoded_picture
from binopos_ros.view.errors import ViewError
from binopos_ros.view.options import ViewerOptions
from binopos_ros.view.screen import TOPICS, Instant
from binopos_ros.view.server import PageServer
from binopos_ros.view.source import Answer, Look
from binopos_ros.view.wire import BOARD, serialized_picture

#: Seconds between questions for the surface.
SURFACE_PERIOD = 1.0


class ViewerNode(StageNode):
    """Serves the page; it hears numbers while a page is open, and pictures while one shows them.

    The server has a thread, and so has each of the four that hear; all that is seen is touched in
    the server's alone.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('viewer', **node_options)
        options = self.declare_options(ViewerOptions, self._configure)
        self._look = Look()
        self._diagnostics = StageDiagnostics(self, 'operator', self._details)
        self._diagnostics.idle = 'nobody looks'
        folder = Path(options.folder or '.').absolute()
        self._surface = Surface(self)
        self.every(SURFACE_PERIOD, self._look_at_surface)
        self._stills = Stills(folder / 'stills')
        self._recordings = Recordings(self, folder)
        self._buttons = Buttons(self) if options.buttons else None
        if options.buttons:
            controls = {
                'start_recording': self._recordings.start,
                'stop_recording': self._recordings.stop,
                'save_still': self._stills.save,
            }
            offer_triggers(self, controls)
        self._ears = Onlooker(self, 'viewer_ears', self._hear)
        self._eyes = Onlooker(self, 'viewer_eyes', self._see)
        self._drawings = Onlooker(self, 'viewer_drawings', self._see_drawings)
        self._boards = Onlooker(self, 'viewer_boards', self._see_boards)
        self._next_raw = dict.fromkeys(SIDES, 0.0)
        self._server = PageServer(options, self)
        self._server.start()
        # Not to the log, which goes out on the network: the token is in it.
        print(f'the page is served at {self._server.address}', flush=True)

    def destroy_node(self) -> None:
        """End the threads before what they hear with goes."""
        if hasattr(self, '_server'):
            self._server.close()
            self._ears.close()
            self._eyes.close()
            self._drawings.close()
            self._boards.close()
            self._recordings.close()
        super().destroy_node()

    def about(self) -> Mapping[str, Any]:
        """As `Source`."""
        buttons = self._buttons.about() if self._buttons else []
        return {'title': self.get_namespace(), 'mode': 'live', 'buttons': buttons}

    def instant(self) -> Instant:
        """As `Source`: in the time that the stamps are of."""
        return Instant(time.monotonic(), self.get_clock().now().nanoseconds * 1e-9)

    def more(self) -> Mapping[str, Any]:
        """As `Source`: the surface."""
        return self._surface.told

    def look(self, look: Look) -> None:
        """As `Source`."""
        self._look = look
        self._diagnostics.idle = '' if look.numbers else 'nobody looks'
        self._ears.look(look.numbers)
        self._eyes.look(look.pictures)
        self._drawings.look(look.drawings)
        self._boards.look(look.boards)

    def ask(self, request: Mapping[str, Any], answer: Answer) -> None:
        """As `Source`."""
        if request['type'] != 'press' or self._buttons is None:
            answer(False, 'buttons are switched off' if self._buttons is None else 'not known')
            return
        self._buttons.press(str(request.get('name')), answer)

    def _look_at_surface(self) -> None:
        if self._look.numbers:
            self._surface.ask()

    def _configure(self, options: ViewerOptions) -> None:
        self._server.post(self._server.configure, options)

    def _hear(self, node: StageNode) -> None:
        for topic, type_name in TOPICS.items():
            message_class = installed_class(type_name)
            assert message_class is not None
            take = partial(self._take, topic)
            if message_class is CameraInfo:
                # Often said once, before anybody looked.
                node.latched_subscription(message_class, topic, take)
            else:
                node.create_subscription(message_class, topic, take, sensor_data())

    def _see(self, node: StageNode) -> None:
        def keep(message_class: type, topic: str, callback: Callable[[Any], None]) -> None:
            raw = message_class is CompressedImage
            node.create_subscription(message_class, topic, callback, sensor_data(), raw=raw)

        for side in SIDES:
            Pictures(node, side, 'auto', partial(self._picture, side), keep)

    def _see_drawings(self, node: StageNode) -> None:
        for side in SIDES:
            self._see_drawing(node, side, f'{side}/overlay/compressed')

    def _see_boards(self, node: StageNode) -> None:
        self._see_drawing(node, BOARD, 'calibration/overlay/compressed')

    def _see_drawing(self, node: StageNode, kind: str, topic: str) -> None:
        take = partial(self._drawing, kind, topic)
        node.create_subscription(CompressedImage, topic, take, sensor_data(), raw=True)

    def _take(self, topic: str, message: Any) -> None:
        self._count(topic)
        if isinstance(message, CameraInfo):
            self._stills.camera_info(topic.partition('/')[0], message)
        self._server.post(self._server.screen.take, topic, message, self.instant())

    def _picture(self, side: str, message: bytes | Image) -> None:
        self._count(f'{side}/image_raw')
        try:
            if isinstance(message, bytes):
                picture = serialized_picture(side, message)
            elif not self._is_due(side):
                return
            else:
                picture = encoded_picture(side, message)
        except (ViewError, DetectionError) as error:
            self._diagnostics.drop(f'{side}: {error}')
            return
        self._stills.picture(picture)
        self._server.post(self._server.show, picture)

    def _drawing(self, kind: str, topic: str, message: bytes) -> None:
        self._count(topic)
        try:
            picture = serialized_picture(kind, message)._replace(drawn=True)
        except ViewError as error:
            self._diagnostics.drop(f'{kind}: {error}')
            return
        self._server.post(self._server.show, picture)

    def _count(self, topic: str) -> None:
        self._diagnostics.received[topic] += 1
        self._diagnostics.published += 1

    def _is_due(self, side: str) -> bool:
        """Whether a raw picture is worth its JPEG."""
        now = time.monotonic()
        period = 1 / self._server.options.picture_rate
        if now < self._next_raw[side]:
            return False
        self._next_raw[side] = max(self._next_raw[side], now - period) + period
        return True

    def _details(self) -> dict[str, object]:
        if not hasattr(self, '_server'):
            return {}
        refused = self._server.refused.copy()
        return {
            'Port': self._server.port,
            'Pictures are looked at': self._look.pictures,
            **{f'Refused: {reason}': count for reason, count in sorted(refused.items())},
        }


def view(words: list[str], typed: list[Parameter]) -> int:
    """Run a viewer until a signal; the exit status.

    Args:
        words: those after `--ros-args`.
        typed: parameters that go over them.
    """

    def viewer(parameter_overrides: list[Parameter]) -> ViewerNode:
        return ViewerNode(parameter_overrides=[*parameter_overrides, *typed])

    return run({'viewer': viewer}, words)
