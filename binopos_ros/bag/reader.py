"""Reading a bag message by message, in the order of their times, in memory that stays the same.

with BagReader('bags/washbowl') as reader:
    for record in reader.messages(topics=['/stereo/left/image_raw/compressed']):
        message = reader.decode(record)
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from binopos_ros.bag.chunks import LARGEST, unpack_file, unpacked_zstd
from binopos_ros.bag.definitions import store_for
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.layout import Files, find_files
from binopos_ros.bag.mcap_storage import McapStorage
from binopos_ros.bag.records import Record, Storage

_log = logging.getLogger('binopos.bag')

#: What a message compressed by zstd begins with; no CDR does.
_ZSTD = b'\x28\xb5\x2f\xfd'


class BagReader:
    """A bag opened for reading: folder or file, whole, split, compressed, or cut off.

    A bag that is damaged is read as far as it goes: what is lost is said in one line through the
    logger `binopos.bag`, and kept in `warnings`.

    Attributes:
        topics: by name, those without any message too.
        start_ns, end_ns: times of the first and the last message, 0 in a bag without messages.
        message_count: number of messages.
        warnings: what is wrong with the bag, a line each.

    Raises:
        BagError: missing, empty, not an MCAP bag.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.warnings: list[str] = []
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._stores: dict[str, Any] = {}
        try:
            self._storage = self._open(find_files(self.path))
        except BaseException:
            self.close()
            raise
        self.topics = self._storage.topics
        self.message_count = sum(topic.count for topic in self.topics.values())
        self.start_ns, self.end_ns = self._storage.start_ns, self._storage.end_ns

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the bag, and remove what was unpacked for reading."""
        if hasattr(self, '_storage'):
            self._storage.close()
        if self._temporary is not None:
            self._temporary.cleanup()
            self._temporary = None

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Messages in the order of their log time, from `start_ns` on; `topics` None: all.

        Messages of the same time come in the order of the file.

        Raises:
            BagError: more messages overlap in time than can wait, or a file is damaged.
        """
        for record in self._storage.messages(topics, start_ns):
            yield self._unpacked_message(record) if record.data.startswith(_ZSTD) else record

    def decode(self, record: Record) -> Any:
        """The message as `rosbags` builds it; arrays are views of the record's bytes.

        Raises:
            BagError: the encoding is not CDR, the definition unreadable, or the bytes damaged.
        """
        info = self.topics[record.topic]
        store = self._stores.get(record.topic)
        if store is None:
            if info.encoding != 'cdr':
                message = (
                    f"{self.path}: topic {record.topic} is encoded as '{info.encoding}', "
                    "which is unknown: only 'cdr' is read"
                )
                raise BagError(message)
            try:
                store = store_for(info.type, info.definition)
            except BagError as error:
                message = f'{self.path}: topic {record.topic}: {error}'
                raise BagError(message) from error
            self._stores[record.topic] = store
        try:
            return store.deserialize_cdr(record.data, info.type)
        except Exception as error:
            # rosbags generates its readers; damaged bytes surface as whatever they run into.
            message = (
                f'{self.path}: topic {record.topic}: message at {record.stamp_ns} ns '
                f'is no {info.type}: {" ".join(str(error).split())}'
            )
            raise BagError(message) from error

    def _open(self, files: Files) -> Storage:
        paths: dict[Path, Path] = {}
        problems: list[BagError] = []
        for file in files:
            try:
                paths[file] = self._unpacked(file)
            except BagError as error:
                problems.append(error)
        if not paths:
            raise problems[0]
        for problem in problems:
            self._warn(f'{problem}; this part of the bag is left out')
        suffix = next(iter(paths.values())).suffix
        if suffix == '.db3':
            # Not every Python has SQLite.
            from binopos_ros.bag.sqlite import SqliteStorage

            return SqliteStorage(paths.values(), paths)
        if suffix == '.bag':
            from binopos_ros.bag.ros1 import Ros1Storage

            return Ros1Storage(paths)
        return McapStorage(paths.values(), paths, self._warn)

    def _unpacked(self, file: Path) -> Path:
        if file.suffix != '.zstd':
            return file
        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix='binopos_bag_')
        unpacked = Path(self._temporary.name) / file.stem
        unpack_file(file, unpacked)
        return unpacked

    def _unpacked_message(self, record: Record) -> Record:
        try:
            data = bytes(unpacked_zstd(record.data, LARGEST, 'message'))
        except BagError as error:
            # As it stands it is refused by who decodes it, and costs only itself.
            self._warn(f'{self.path}: topic {record.topic}: at {record.stamp_ns} ns: {error}')
            return record
        return record._replace(data=data)

    def _warn(self, line: str) -> None:
        self.warnings.append(line)
        _log.warning('%s', line)
