"""Who else is on this domain: second publishers of a topic, and nodes of the same name.

The middleware keeps a node that was killed in its graph until the node's lease runs out, so that
one which is started again stands there twice. What is left of a killed one is told from a live
second one by its process: Fast DDS writes it into the identity of every publisher. Where that
cannot be read (another machine, another middleware), two publishers of the same full name are
taken for one that was started again until they have stood together for longer than a lease.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

#: Seconds that DDS keeps a participant which it does not hear any more: Fast DDS's default, the
#: longest of the middlewares of ROS.
LEASE = 20.0
#: What Fast DDS's identities begin with; the machine, the process and a random number follow, of
#: two bytes each.
_EPROSIMA = b'\x01\x0f'


def publishers_of(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish a topic, in order; one that does twice stands twice."""
    return sorted(map(_name, node.get_publishers_info_by_topic(topic)))


class Neighbours:
    """What is wrong with a node's neighbours.

    Args:
        node: the node that looks about; it publishes on `own_topic`.
        own_topic: full name.
    """

    def __init__(self, node: Node, own_topic: str) -> None:
        self._node = node
        self._own_topic = own_topic
        self._doubted: dict[bytes, float] = {}

    def intruders(self, sole_topics: Iterable[str]) -> dict[str, str]:
        """What is wrong, by what it is about; empty where all is well.

        Args:
            sole_topics: full names of the topics that only one node should publish.
        """
        found = {}
        doubted: set[bytes] = set()
        for topic in sole_topics:
            endpoints = self._node.get_publishers_info_by_topic(topic)
            if len(endpoints) > 1:
                ghosts = set(self._ghosts(endpoints))
                doubted |= ghosts
                names = sorted(_name(each) for each in endpoints if _identity(each) not in ghosts)
                if len(names) > 1:
                    found[topic] = f'{topic} has {len(names)} publishers: {" and ".join(names)}'
        self._doubted = {each: since for each, since in self._doubted.items() if each in doubted}
        own = (self._node.get_name(), self._node.get_namespace())
        namesakes = self._node.get_node_names_and_namespaces().count(own)
        if namesakes > 1:
            found['name'] = (
                f'{namesakes} nodes are called {self._node.get_fully_qualified_name()}: is a '
                'second suite running? Stop one, or give it another namespace or ROS_DOMAIN_ID'
            )
        return found

    def _ghosts(self, endpoints: Iterable[TopicEndpointInfo]) -> Iterator[bytes]:
        """Identities of the publishers that may be left of killed nodes."""
        now = time.monotonic()
        known = self._known_prefix()
        running = _running() if known else set()
        names = set()
        for each in sorted(endpoints, key=_identity):
            identity, name = _identity(each), _name(each)
            if known and identity.startswith(known):
                is_doubtful = _process(identity) not in running
            else:
                is_doubtful = name in names
                names.add(name)
            if is_doubtful and now - self._doubted.setdefault(identity, now) < LEASE:
                yield identity

    def _known_prefix(self) -> bytes:
        """What identities of this machine begin with, where they tell the process; else b''."""
        own = os.getpid() & 0xFFFF
        for each in self._node.get_publishers_info_by_topic(self._own_topic):
            identity = _identity(each)
            is_own = _name(each) == self._node.get_fully_qualified_name()
            if is_own and identity.startswith(_EPROSIMA) and _process(identity) == own:
                return identity[:4]
        return b''


def _name(endpoint: TopicEndpointInfo) -> str:
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _identity(endpoint: TopicEndpointInfo) -> bytes:
    return bytes(endpoint.endpoint_gid)


def _process(identity: bytes) -> int:
    return int.from_bytes(identity[4:6], 'little')


def _running() -> set[int]:
    """The lower 16 bits of the numbers of all processes that run on this machine."""
    found = set()
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            state = path.read_bytes().rpartition(b') ')[2][:1]
        except OSError:
            continue
        # One that has ended stays a zombie until its parent looks.
        if state not in (b'Z', b'X'):
            found.add(int(path.parent.name) & 0xFFFF)
    return found
