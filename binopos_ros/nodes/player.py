"""The player node: plays a bag, and takes orders as services."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from binopos_ros.bag import BagError, BagReader
from binopos_ros.bag.playback import PlayerOptions
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.playing import Player
from binopos_ros.nodes.shell import StageNode
from binopos_ros.nodes.triggers import offer_triggers


class PlayerNode(StageNode):
    """Plays a bag once or in a loop, and ends the process at its end."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('player', **node_options)
        options = self.declare_options(PlayerOptions, self._configure)
        if not options.bag:
            message = "no bag given: set the parameter 'bag'"
            raise BagError(message)
        self._reader = BagReader(options.bag)
        self._player = Player(self, self._reader, options)
        self._diagnostics = StageDiagnostics(self, str(self._reader.path), self._details)
        offer_controls(self, self._player)
        self.every(0.1, self._follow)
        self._player.start()

    def destroy_node(self) -> None:
        """End the player's thread before its publishers go."""
        if hasattr(self, '_player'):
            self._player.stop()
            self._reader.close()
        super().destroy_node()

    def _configure(self, options: PlayerOptions) -> None:
        self._player.set_rate(options.rate)

    def _follow(self) -> None:
        published = self._player.published
        self._diagnostics.received['bag'] = self._diagnostics.published = published
        self._diagnostics.errors['bag'] = self._player.error
        if self._player.finished.is_set():
            self.get_logger().info(f'{published} messages played')
            self.context.try_shutdown()

    def _details(self) -> dict[str, object]:
        return {
            'State': 'paused' if self._player.paused else 'playing',
            'Farthest behind schedule (ms)': f'{self._player.latest * 1e3:.1f}',
            **{f'Skipped {topic}': why for topic, why in self._player.skipped.items()},
        }


def offer_controls(node: Node, player: Player) -> None:
    """Offer the services ~/pause, ~/resume and so on, named as rosbag2 names them."""
    offer_triggers(node, {name: partial(control, player) for name, control in CONTROLS.items()})


def _pause(player: Player) -> tuple[bool, str]:
    player.pause()
    return True, 'paused'


def _resume(player: Player) -> tuple[bool, str]:
    player.resume()
    return True, 'playing'


def _toggle_paused(player: Player) -> tuple[bool, str]:
    return _resume(player) if player.paused else _pause(player)


def _is_paused(player: Player) -> tuple[bool, str]:
    return True, 'paused' if player.paused else 'playing'


def _play_next(player: Player) -> tuple[bool, str]:
    stepped = player.play_next()
    return stepped, 'one message played' if stepped else 'only a paused bag can be stepped'


def _stop(player: Player) -> tuple[bool, str]:
    player.stop()
    return True, 'stopped'


CONTROLS: dict[str, Callable[[Player], tuple[bool, str]]] = {
    'pause': _pause,
    'resume': _resume,
    'toggle_paused': _toggle_paused,
    'is_paused': _is_paused,
    'play_next': _play_next,
    'stop': _stop,
}
