"""The pictures of one camera, from whichever of its topics the driver fills."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CompressedImage, Image

from binopos_ros.nodes.shell import LOOK_PERIOD, StageNode

FORMS: dict[str, tuple[type, str]] = {
    'compressed': (CompressedImage, 'image_raw/compressed'),
    'raw': (Image, 'image_raw'),
}


class Pictures:
    """Subscribes to one form of a camera's pictures.

    With the transport 'auto' that is the compressed one, until two looks in a row have found
    only the other: a driver that sends both may offer them one after the other. A subscription
    that was made stays, as it cannot be taken away while the node runs; it costs nothing while
    nobody publishes there.

    Args:
        node: makes the subscriptions.
        side: 'left' or 'right'.
        transport: 'auto', 'compressed' or 'raw'.
        take: gets each picture.
        keep: gets a subscription's topic, callback and type, and makes it.
    """

    def __init__(
        self,
        node: StageNode,
        side: str,
        transport: str,
        take: Callable[[CompressedImage | Image], None],
        keep: Callable[..., Any],
    ) -> None:
        self._node = node
        self._side = side
        self._take = take
        self._keep = keep
        self._made: set[str] = set()
        self._seen = ''
        self.form = 'compressed' if transport == 'auto' else transport
        self._ask(self.form)
        if transport == 'auto':
            node.every(LOOK_PERIOD, self._look)

    def topic(self, form: str) -> str:
        """The topic of a form, relative to the node's namespace."""
        return f'{self._side}/{FORMS[form][1]}'

    def _ask(self, form: str) -> None:
        self.form = form
        if form in self._made:
            return
        self._made.add(form)

        def on_picture(message: CompressedImage | Image) -> None:
            if self.form == form:
                self._take(message)

        self._keep(FORMS[form][0], self.topic(form), on_picture)

    def _look(self) -> None:
        offered = [
            form
            for form in FORMS
            if self._node.count_publishers(self._node.resolve_topic_name(self.topic(form)))
        ]
        # What is there already stays, or else what is there first in the order of forms.
        seen = '' if not offered or self.form in offered else offered[0]
        if seen and seen == self._seen:
            self._ask(seen)
        self._seen = seen
