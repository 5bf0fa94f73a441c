"""Bags of ROS 1 (`.bag`), their messages turned into those of ROS 2."""

from __future__ import annotations

import bz2
import heapq
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from binopos_ros.bag.chunks import LARGEST, refuse_too_large
from binopos_ros.bag.definitions import Definition, definition_of, jazzy
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.records import Record, TopicInfo

ENCODING = 'ros1'


class Ros1Storage:
    """The files of a bag of ROS 1.

    A topic whose type ROS 2 Jazzy does not have is listed with the encoding 'ros1'.

    Raises:
        BagError: no such bag, without an index, or damaged.
    """

    def __init__(self, paths: Collection[Path]) -> None:
        self._files = [_File(path) for path in paths]
        self.topics: dict[str, TopicInfo] = {}
        for file in self._files:
            for topic, info in file.topics.items():
                known = self.topics.setdefault(topic, info)
                if known is not info:
                    known.count += info.count
        filled = [file.reader for file in self._files if file.reader.message_count]
        self.start_ns = min((reader.start_time for reader in filled), default=0)
        # The library gives the first moment after the last message.
        self.end_ns = max((reader.end_time - 1 for reader in filled), default=0)

    def messages(self, wanted: Collection[str] | None, start_ns: int | None) -> Iterator[Record]:
        """Messages in the order of their log time; `wanted` None: all."""
        return heapq.merge(
            *(file.messages(wanted, start_ns) for file in self._files),
            key=lambda record: record.stamp_ns,
        )

    def close(self) -> None:
        """Close the files."""
        for file in self._files:
            file.reader.close()


class _File:
    def __init__(self, path: Path) -> None:
        from rosbags.rosbag1 import Reader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.path = path
        self.reader = Reader(path)
        self._convert: dict[str, Callable[[bytes], bytes]] = {}
        self._store = get_typestore(Stores.EMPTY)
        self.topics: dict[str, TopicInfo] = {}
        try:
            self.reader.open()
            self._bound_the_chunks()
            types: dict[str, Any] = {}
            for connection in self.reader.connections:
                types.update(get_types_from_msg(connection.msgdef.data, connection.msgtype))
            self._store.register(types)
            for connection in self.reader.connections:
                self._add_topic(connection)
        except BagError:
            raise
        except Exception as error:
            # Damaged bytes surface in the library as whatever they run into.
            raise self._damaged(error) from error

    def messages(self, wanted: Collection[str] | None, start_ns: int | None) -> Iterator[Record]:
        connections = [
            each for each in self.reader.connections if wanted is None or each.topic in wanted
        ]
        if not connections:
            return
        try:
            for connection, stamp, data in self.reader.messages(connections, start=start_ns):
                convert = self._convert.get(connection.msgtype, bytes)
                yield Record(connection.topic, stamp, convert(data))
        except BagError:
            raise
        except Exception as error:
            raise self._damaged(error) from error

    def _add_topic(self, connection: Any) -> None:
        kind = connection.msgtype
        known = self.topics.get(connection.topic)
        if known is not None:
            known.count += connection.msgcount
            return
        readable = kind in jazzy().types
        if readable:
            self._convert[kind] = self._converter(kind)
        self.topics[connection.topic] = TopicInfo(
            type=kind,
            count=connection.msgcount,
            encoding='cdr' if readable else ENCODING,
            definition=definition_of(kind) if readable else Definition('', '', ''),
        )

    def _converter(self, kind: str) -> Callable[[bytes], bytes]:
        from rosbags.convert.converter import is_same_wireformat, migrate_bytes

        if is_same_wireformat(self._store, jazzy(), kind, kind):
            return lambda data: bytes(jazzy().ros1_to_cdr(data, kind))
        cache: dict[str, object] = {}
        return lambda data: bytes(
            migrate_bytes(
                self._store, jazzy(), kind, kind, cache, data, src_is2=False, dst_is2=True
            )
        )

    def _bound_the_chunks(self) -> None:
        """Let no chunk unpack to more than is taken into memory at a time."""
        for position, chunk in self.reader.chunks.items():
            refuse_too_large(chunk.datasize, f'{self.path}: a chunk')
            bounded = _BOUNDED.get(getattr(chunk.decompressor, '__module__', ''))
            if bounded is not None:
                self.reader.chunks[position] = chunk._replace(decompressor=bounded)

    def _damaged(self, error: Exception) -> BagError:
        reason = ' '.join(str(error).split()) or type(error).__name__
        return BagError(
            f'{self.path}: no bag of ROS 1, or damaged ({reason[:200]}): mend it with '
            '`rosbag reindex`'
        )


def _bounded_lz4(data: bytes) -> bytes:
    import lz4.frame

    decompressor = lz4.frame.LZ4FrameDecompressor()
    content = decompressor.decompress(data, LARGEST)
    if not decompressor.eof:
        refuse_too_large(len(content) + 1, 'a chunk')
    return bytes(content)


def _bounded_bz2(data: bytes) -> bytes:
    decompressor = bz2.BZ2Decompressor()
    content = decompressor.decompress(data, LARGEST)
    if not decompressor.eof:
        refuse_too_large(len(content) + 1, 'a chunk')
    return content


_BOUNDED = {'bz2': _bounded_bz2, 'lz4.frame': _bounded_lz4}
