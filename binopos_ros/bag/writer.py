"""Writing a bag that `ros2 bag`, `rosbags` and Foxglove read.

    with BagWriter('bags/washbowl') as writer:
        writer.add_topic('/stereo/left/camera_info', 'sensor_msgs/msg/CameraInfo')
        writer.write('/stereo/left/camera_info', stamp_ns, message)

The same input gives the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from binopos_ros import __version__
from binopos_ros.bag.definitions import Definition, definition_of, jazzy
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.layout import METADATA
from binopos_ros.bag.mcap_file import McapFile
from binopos_ros.bag.metadata import FileSummary, TopicSummary, write_metadata
from binopos_ros.bag.qos import Qos, format_qos

CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class _Topic:
    type: str
    definition: Definition
    qos: tuple[Qos, ...]


class BagWriter:
    """A bag opened for writing.

    Args:
        path: a name that ends in `.mcap` makes a single file, any other a folder with
            `metadata.yaml`, as `ros2 bag record` does. It must not exist yet.
        compression: of the chunks: 'none', 'zstd' or 'lz4'. JPEG images hardly shrink.
        split_bytes: begin a new file where one would grow beyond this; 0: never.
        split_ns: begin a new file where one would span more than this time; 0: never.
        chunk_bytes: messages go to the disk in chunks of about this size, or at `flush`.
        crash_safe: keep the bag whole after every chunk, so that a killed writer costs only
            what was not flushed.

    Raises:
        BagError: the path exists or cannot be created, or (any method) the disk is full.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        compression: str = 'none',
        split_bytes: int = 0,
        split_ns: int = 0,
        chunk_bytes: int = CHUNK_BYTES,
        crash_safe: bool = False,
    ) -> None:
        self.path = Path(path)
        self._single = self.path.suffix == '.mcap'
        if self._single and (split_bytes or split_ns):
            message = f'{self.path}: a single .mcap file cannot be split: name a folder instead'
            raise BagError(message)
        self._compression = compression
        self._split_bytes = split_bytes
        self._split_ns = split_ns
        self._chunk_bytes = chunk_bytes
        self._crash_safe = crash_safe
        self._topics: dict[str, _Topic] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._finished: list[FileSummary] = []
        self._finished_counts: dict[str, int] = {}
        self._closed = False
        self._make_folder()
        self._file = self._next_file()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add_topic(
        self,
        topic: str,
        type: str,
        *,
        qos: tuple[Qos, ...] = (),
        definition: Definition | None = None,
    ) -> None:
        """Declare a topic; `definition` only for types that ROS 2 Jazzy itself does not have.

        Raises:
            BagError: the type is unknown, or the topic is declared already.
        """
        if topic in self._topics:
            message = f'{self.path}: topic {topic} is declared twice'
            raise BagError(message)
        self._topics[topic] = _Topic(type, definition or definition_of(type), tuple(qos))
        self._declare(topic)

    def write(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Append a message, given as CDR bytes or as `rosbags` builds it.

        `stamp_ns` is the log time, by which readers order and players pace the messages.
        """
        channel = self._channels.get(topic)
        if channel is None:
            error = f'{self.path}: topic {topic} was not declared by add_topic'
            raise BagError(error)
        if not isinstance(message, bytes):
            message = bytes(jazzy().serialize_cdr(message, self._topics[topic].type))
        if self._is_full(stamp_ns, len(message)):
            self._split()
            channel = self._channels[topic]
        self._file.add_message(channel, stamp_ns, message)

    def split(self) -> None:
        """Begin a new file, unless the current one is empty.

        Raises:
            BagError: the bag is a single file.
        """
        if self._single:
            message = f'{self.path}: a single .mcap file cannot be split: name a folder instead'
            raise BagError(message)
        if self._file.message_count:
            self._split()

    def flush(self) -> None:
        """Bring everything given so far to the disk."""
        self._file.flush()
        if self._crash_safe:
            self._write_metadata()

    def close(self) -> None:
        """Finish the bag; a second call does nothing."""
        if not self._closed:
            self._closed = True
            try:
                self._file.close()
            finally:
                self._write_metadata()

    def _make_folder(self) -> None:
        folder = self.path.parent if self._single else self.path
        try:
            folder.mkdir(parents=True, exist_ok=self._single)
        except FileExistsError as error:
            message = f'{self.path} exists already: choose another name, or remove it'
            raise BagError(message) from error
        except OSError as error:
            message = f'{self.path} cannot be created: {error.strerror}'
            raise BagError(message) from error

    def _next_file(self) -> McapFile:
        path = self.path
        if not self._single:
            path = path / f'{path.resolve().name}_{len(self._finished)}.mcap'
        return McapFile(
            path,
            library=f'binopos_ros {__version__}',
            compression=self._compression,
            chunk_bytes=self._chunk_bytes,
            always_whole=self._crash_safe,
        )

    def _declare(self, topic: str) -> None:
        entry = self._topics[topic]
        schema = self._schemas.get(entry.type)
        if schema is None:
            schema = self._file.add_schema(
                entry.type, entry.definition.encoding, entry.definition.text
            )
            self._schemas[entry.type] = schema
        metadata = {
            'offered_qos_profiles': format_qos(entry.qos) if entry.qos else '',
            'topic_type_hash': entry.definition.type_hash,
        }
        self._channels[topic] = self._file.add_channel(topic, schema, metadata)

    def _is_full(self, stamp_ns: int, length: int) -> bool:
        times = self._file.times_ns
        if times is None:
            return False
        too_large = self._split_bytes > 0 and self._file.size + length > self._split_bytes
        too_long = self._split_ns > 0 and stamp_ns - times[0] >= self._split_ns
        return too_large or too_long

    def _split(self) -> None:
        self._file.close()
        for topic, count in self._file_counts().items():
            self._finished_counts[topic] = self._finished_counts.get(topic, 0) + count
        self._finished.append(self._file_summary())
        self._file = self._next_file()
        self._schemas.clear()
        for topic in self._topics:
            self._declare(topic)
        self._write_metadata()

    def _file_counts(self) -> dict[str, int]:
        return {topic: self._file.count(channel) for topic, channel in self._channels.items()}

    def _file_summary(self) -> FileSummary:
        start_ns, end_ns = self._file.times_ns or (0, 0)
        return FileSummary(self._file.path.name, start_ns, end_ns, self._file.message_count)

    def _write_metadata(self) -> None:
        if self._single:
            return
        counts = self._file_counts()
        topics = [
            TopicSummary(
                topic,
                entry.type,
                entry.definition.type_hash,
                entry.qos,
                self._finished_counts.get(topic, 0) + counts[topic],
            )
            for topic, entry in self._topics.items()
        ]
        write_metadata(self.path / METADATA, [*self._finished, self._file_summary()], topics)
