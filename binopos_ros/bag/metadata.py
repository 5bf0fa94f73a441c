"""metadata.yaml as rosbag2 of ROS 2 Jazzy writes it (version 9)."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.qos import Qos, format_qos

VERSION = 9


@dataclass(frozen=True)
class FileSummary:
    """One file of a bag; times of its first and last message in nanoseconds."""

    name: str
    start_ns: int
    end_ns: int
    message_count: int


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag."""

    name: str
    type: str
    type_hash: str
    qos: tuple[Qos, ...]
    message_count: int


def write_metadata(
    path: Path, files: Sequence[FileSummary], topics: Sequence[TopicSummary]
) -> None:
    """Write the file anew; whoever reads it meanwhile sees the old one or the new one.

    Raises:
        BagError: it cannot be written.
    """
    # A reader that meets the folder during the first messages must not find the year 1970.
    filled = [file for file in files if file.message_count] or list(files[:1])
    start_ns = min(file.start_ns for file in filled)
    end_ns = max(file.end_ns for file in filled)
    lines = [
        'rosbag2_bagfile_information:',
        f'  version: {VERSION}',
        '  storage_identifier: mcap',
        *_span('  ', start_ns, end_ns),
        f'  message_count: {sum(file.message_count for file in files)}',
        f'  topics_with_message_count:{"" if topics else " []"}',
    ]
    for topic in topics:
        lines += [
            '    - topic_metadata:',
            f'        name: {_quoted(topic.name)}',
            f'        type: {_quoted(topic.type)}',
            '        serialization_format: cdr',
            '        offered_qos_profiles:' + _nested_qos(topic.qos),
            f'        type_description_hash: {_quoted(topic.type_hash)}',
            f'      message_count: {topic.message_count}',
        ]
    lines += ['  compression_format: ""', '  compression_mode: ""', '  relative_file_paths:']
    lines += [f'    - {_quoted(file.name)}' for file in files]
    lines.append('  files:')
    for file in files:
        lines += [
            f'    - path: {_quoted(file.name)}',
            *_span('      ', file.start_ns, file.end_ns),
            f'      message_count: {file.message_count}',
        ]
    lines += ['  custom_data: ~', '  ros_distro: jazzy']
    temporary = path.with_suffix('.yaml.new')
    try:
        temporary.write_text('\n'.join(lines) + '\n', encoding='utf-8')
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        message = f'{path} cannot be written: {error.strerror}'
        raise BagError(message) from error


def _span(indent: str, start_ns: int, end_ns: int) -> list[str]:
    return [
        f'{indent}duration:',
        f'{indent}  nanoseconds: {end_ns - start_ns}',
        f'{indent}starting_time:',
        f'{indent}  nanoseconds_since_epoch: {start_ns}',
    ]


def _nested_qos(qos: tuple[Qos, ...]) -> str:
    if not qos:
        return ' []'
    indent = ' ' * 10
    return f'\n{indent}' + format_qos(qos, indent)


def _quoted(text: str) -> str:
    return json.dumps(text)
