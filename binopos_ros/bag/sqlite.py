"""Bags in rosbag2's older format, one sqlite3 database per file (`.db3`)."""

from __future__ import annotations

import heapq
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from binopos_ros.bag.chunks import LARGEST
from binopos_ros.bag.definitions import Definition, full_name
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.qos import parse_qos
from binopos_ros.bag.records import Record, TopicInfo


class SqliteStorage:
    """The databases of a bag, in any version of their schema.

    Args:
        paths: the databases.
        names: what messages call them, where a path is a temporary copy.

    Raises:
        BagError: no such database, or damaged.
    """

    def __init__(self, paths: Collection[Path], names: Collection[Path]) -> None:
        self.topics: dict[str, TopicInfo] = {}
        self._files = [_Database(*each) for each in zip(paths, names, strict=True)]
        for file in self._files:
            for topic, info in file.topics.items():
                known = self.topics.setdefault(topic, info)
                if known is not info:
                    known.count += info.count
        spans = [file.span for file in self._files if file.span is not None]
        self.start_ns = min((start for start, _ in spans), default=0)
        self.end_ns = max((end for _, end in spans), default=0)

    def messages(self, wanted: Collection[str] | None, start_ns: int | None) -> Iterator[Record]:
        """Messages in the order of their log time; `wanted` None: all."""
        return heapq.merge(
            *(file.messages(wanted, start_ns) for file in self._files),
            key=lambda record: record.stamp_ns,
        )

    def close(self) -> None:
        """Close the databases."""
        for file in self._files:
            file.connection.close()


class _Database:
    def __init__(self, path: Path, name: Path) -> None:
        self.name = name
        self.names: dict[int, str] = {}
        try:
            # Messages may be read ahead by another thread.
            self.connection = sqlite3.connect(
                f'{path.resolve().as_uri()}?immutable=1', uri=True, check_same_thread=False
            )
            self.topics = self._topics()
            ((first, last),) = self._rows('SELECT MIN(timestamp), MAX(timestamp) FROM messages')
            self.span = None if first is None else (int(first), int(last))
        except (sqlite3.Error, OverflowError, TypeError, ValueError) as error:
            raise self._damaged(error) from error

    def messages(self, wanted: Collection[str] | None, start_ns: int | None) -> Iterator[Record]:
        ids = [key for key, topic in self.names.items() if wanted is None or topic in wanted]
        try:
            with closing(self.connection.cursor()) as cursor:
                cursor.execute(
                    'SELECT topic_id, timestamp, data FROM messages WHERE timestamp >= ? '
                    f'AND topic_id IN ({",".join("?" * len(ids))}) '
                    f"AND typeof(data) = 'blob' AND length(data) <= {LARGEST} "
                    'ORDER BY timestamp, id',
                    (0 if start_ns is None else start_ns, *ids),
                )
                for key, stamp, data in cursor:
                    yield Record(self.names[key], int(stamp), bytes(data))
        except (sqlite3.Error, OverflowError, TypeError, ValueError) as error:
            raise self._damaged(error) from error

    def _topics(self) -> dict[str, TopicInfo]:
        counts = dict(self._rows('SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id'))
        columns = [row[1] for row in self._rows('PRAGMA table_info(topics)')]
        qos = 'offered_qos_profiles' if 'offered_qos_profiles' in columns else "''"
        definitions = {
            str(name): Definition(str(encoding), str(text), str(type_hash))
            for name, encoding, text, type_hash in self._definitions()
        }
        topics: dict[str, TopicInfo] = {}
        for key, topic, kind, encoding, offered in self._rows(
            f'SELECT id, name, type, serialization_format, {qos} FROM topics'
        ):
            self.names[int(key)] = str(topic)
            topics[str(topic)] = TopicInfo(
                type=full_name(str(kind)),
                count=int(counts.get(key, 0)),
                encoding=str(encoding),
                definition=definitions.get(str(kind), Definition('ros2msg', '', '')),
                qos=parse_qos(str(offered)),
            )
        return topics

    def _definitions(self) -> list[tuple[Any, ...]]:
        if not self._rows("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'"):
            return []
        return self._rows(
            'SELECT topic_type, encoding, encoded_message_definition, type_description_hash '
            'FROM message_definitions'
        )

    def _rows(self, query: str) -> list[tuple[Any, ...]]:
        return self.connection.execute(query).fetchall()

    def _damaged(self, error: Exception) -> BagError:
        return BagError(f'{self.name}: no sqlite3 bag of rosbag2, or damaged: {error}')
