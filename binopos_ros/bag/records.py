"""What every kind of bag gives: messages, and what it says of their topics."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from binopos_ros.bag.definitions import Definition
from binopos_ros.bag.qos import Qos


class Record(NamedTuple):
    """One message, still serialised."""

    topic: str
    stamp_ns: int  #: log time: when it was recorded
    data: bytes  #: CDR, its 4-byte encapsulation header included


@dataclass
class TopicInfo:
    """What the bag says about a topic."""

    type: str  #: as `package/msg/Name`
    count: int  #: messages in the bag
    encoding: str  #: of the messages: 'cdr' in a bag of ROS 2
    definition: Definition
    qos: list[Qos] = field(default_factory=list)  #: what its publishers offered


class Storage(Protocol):
    """The files of a bag in one format."""

    topics: dict[str, TopicInfo]
    start_ns: int  #: of the first message, 0 where there is none
    end_ns: int  #: of the last message, 0 where there is none

    def messages(self, wanted: Collection[str] | None, start_ns: int | None) -> Iterator[Record]:
        """Messages in the order of their log time; `wanted` None: all."""
        ...

    def close(self) -> None:
        """Let go of what was opened."""
        ...
