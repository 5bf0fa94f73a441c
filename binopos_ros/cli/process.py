"""`binopos process`: a bag through the stages of the live nodes, offline and deterministic."""

from __future__ import annotations

import argparse
import gc
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from binopos_ros.bag.by_stamp import by_stamp
from binopos_ros.bag.platform_topics import TYPES, with_platform
from binopos_ros.bag.rig_topics import BOTH, RigTopics
from binopos_ros.cli.config import (
    add_calibration_argument,
    add_config_argument,
    parameters_of,
    told_sources,
)
from binopos_ros.cli.output import Output, Table
from binopos_ros.cli.outputs import OutputError, add_force_argument, written
from binopos_ros.cli.progress import progress
from binopos_ros.cli.recorded_calibration import calibrations, camera_info_of
from binopos_ros.cli.stereo_topics import add_remap_argument, add_topic_arguments, rig_of
from binopos_ros.cli.terminal import fitted
from binopos_ros.detection import DetectionError, Frame, JpegImage, RawImage, decode
from binopos_ros.detection.heap import keep_freed_pictures
from binopos_ros.detection.images import halves, image_of
from binopos_ros.node_options import STAGES
from binopos_ros.optics import CameraInfo, OpticsError
from binopos_ros.pipeline import Event, Located, Pipeline
from binopos_ros.reasons import count_reason
from binopos_ros.report import Fates, Report
from binopos_ros.sides import SIDES

#: Pictures that are decoded ahead, by one thread: decoding gives the interpreter's lock free, but
#: a second one would only get in the way of the stages more often.
READ_AHEAD = 8
#: A bound for slips of the keyboard; each job takes a processor and 200 MB.
MOST_JOBS = 256
GARBAGE_THRESHOLD = 50_000


class _Images(NamedTuple):
    sides: Sequence[str]
    stamp: int
    frame_id: str
    decoded: Future[Sequence[Frame | DetectionError]]


class _Calibration(NamedTuple):
    side: str
    info: CameraInfo


class _Motion(NamedTuple):
    kind: str
    message: Any


_Item = _Images | _Calibration | _Motion


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'bags', type=Path, nargs='+', metavar='BAG', help='bag of a stereo rig, or several'
    )
    parser.add_argument(
        '--jobs',
        type=int,
        choices=range(1, MOST_JOBS + 1),
        metavar='N',
        help='bags at a time, a process each (default: 1); outputs then are folders, as they are '
        'for several bags',
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        required=True,
        metavar='OUT.mcap',
        help='bag to write; a folder for several',
    )
    parser.add_argument(
        '--csv',
        type=Path,
        metavar='FILE',
        help='table of positions to write; a folder for several bags',
    )
    parser.add_argument(
        '--csv-all',
        action='store_true',
        help='with a row for every pair in it, and the reason of those that gave no pose',
    )
    add_force_argument(parser)
    add_config_argument(parser)
    add_calibration_argument(parser)
    add_topic_arguments(parser)
    add_remap_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run the verb; the exit status."""
    if arguments.csv_all and arguments.csv is None:
        raise OutputError('--csv-all says what is in the table: give --csv FILE too')
    if arguments.jobs or len(arguments.bags) > 1:
        # Processes of its own need a good deal of the library.
        from binopos_ros.cli.dives import process_all

        return process_all(process_one, arguments)
    (arguments.bag,) = arguments.bags
    report = process_one(arguments)
    print(f'{arguments.bag} -> {arguments.output}')
    print(fitted(report))
    if not report.raw.stamps:
        print(f'binopos process: {arguments.bag} gave no position', file=sys.stderr)
        return 1
    return 0


def process_one(arguments: argparse.Namespace) -> Report:
    """Process one bag; what came of it.

    Raises:
        BagError, ParameterError, OutputError, or the error of a room: the bag cannot be read, the
        parameters cannot be used, or the output cannot be written.
    """
    report = Report()
    _keep_memory()
    with ExitStack() as stack:
        reader = stack.enter_context(BagReader(arguments.bag))
        topics, calibration = rig_of(reader, arguments)
        for note in topics.notes:
            report.note(note)
        parameters = parameters_of(arguments, arguments.bag, topics.namespace or '/')
        report.parameters = told_sources(arguments, parameters)
        values = {name: parameters.of_node(name) for name in STAGES}
        pipeline = Pipeline(values)
        report.fates = Fates.within(values['triangulator'].get('pair_tolerance'))
        report.fixed_frame = pipeline.platform.options.fixed_frame
        topics = with_platform(topics, reader, pipeline.platform.source, arguments.remap)
        for side in SIDES:
            info = calibration.get(side)
            if info is None:
                info = next(calibrations(reader, topics, side))
                for line in info.contradictions():
                    report.note(line)
            pipeline.set_camera(side, info)
        if pipeline.caution:
            report.note(pipeline.caution)
        bag = stack.enter_context(written(arguments.output, arguments.force))
        writer = stack.enter_context(BagWriter(bag))
        output = Output(writer, topics.namespace, pipeline.child_frame)
        table = None
        if arguments.csv:
            path = stack.enter_context(written(arguments.csv, arguments.force))
            table = Table(stack.enter_context(_opened(path)), arguments.csv_all)
        pool = stack.enter_context(ThreadPoolExecutor(1))
        total = sum(reader.topics[topic].count for topic in topics.roles)
        tick = stack.enter_context(progress('processing', total))
        for event in _events(reader, topics, pipeline, pool, report, tick):
            report.add(event)
            output.write(event)
            if table is not None and isinstance(event, Located):
                table.write(event)
        report.conclude()
        if table is not None:
            table.end(report.fates.lost_pairs(report.filtered.stamps))
    return report


def _keep_memory() -> None:
    """Spend less on memory: keep freed pictures, and look for garbage less often.

    The stages leave no cycles, and what the imports made stays to the end.
    """
    gc.freeze()
    gc.set_threshold(GARBAGE_THRESHOLD)
    keep_freed_pictures()


def _opened(path: Path) -> TextIO:
    return path.open('w', newline='', encoding='utf-8')


def _events(
    reader: BagReader,
    topics: RigTopics,
    pipeline: Pipeline,
    pool: ThreadPoolExecutor,
    report: Report,
    tick: Callable[[], None],
) -> Iterator[Event]:
    """Everything the bag leads to, by its stamps, with the images decoded ahead in a thread."""
    waiting: deque[_Item] = deque()
    calibrations: dict[str, bytes] = {}
    for record in by_stamp(reader, topics):
        tick()
        role = topics.roles[record.topic]
        if role.kind == 'camera_info':
            # Cameras repeat it with every image; only the stamp in front differs.
            body = record.data[messages.STAMP_END :]
            if calibrations.get(role.side) == body:
                continue
            calibrations[role.side] = body
        try:
            message = reader.decode(record)
        except BagError as error:
            count_reason(report.others, str(error))
            continue
        if role.kind == 'truth':
            report.truth.add(messages.stamp_of(message), messages.position_of(message))
        elif role.kind == 'fixed truth':
            report.fixed_truth.add(messages.stamp_of(message), messages.position_of(message))
        elif role.kind in TYPES:
            waiting.append(_Motion(role.kind, message))
        elif role.kind == 'camera_info':
            try:
                info = camera_info_of(message, role.side, rectified=topics.rectified)
            except OpticsError as error:
                report.note(f'a camera_info of the {role.side} camera is left out: {error}')
                continue
            waiting.append(_Calibration(role.side, info))
        else:
            sides = SIDES if role.side == BOTH else (role.side,)
            stamp = messages.stamp_of(message)
            for side in sides:
                report.fates.saw(side, stamp)
            if not message.header.frame_id:
                report.note(f'{record.topic}: frame_id is empty, so that positions have no frame')
            decoded = pool.submit(_prepared, pipeline, sides, image_of(message))
            waiting.append(_Images(sides, stamp, message.header.frame_id, decoded))
        while len(waiting) > READ_AHEAD:
            yield from _finish(waiting.popleft(), pipeline)
    while waiting:
        yield from _finish(waiting.popleft(), pipeline)
    yield from pipeline.flush()


def _finish(item: _Item, pipeline: Pipeline) -> Iterator[Event]:
    if isinstance(item, _Calibration):
        pipeline.set_camera(item.side, item.info)
        return
    if isinstance(item, _Motion):
        yield from _moved(item, pipeline)
        return
    for side, decoded in zip(item.sides, item.decoded.result(), strict=True):
        yield from pipeline.add(side, item.stamp, item.frame_id, decoded)


def _moved(item: _Motion, pipeline: Pipeline) -> Iterator[Event]:
    """Tell the pipeline how the robot moves."""
    message = item.message
    if item.kind == 'odometry':
        yield from pipeline.add_odometry(messages.odometry_of(message))
        return
    for transform in messages.transforms_of(message):
        yield from pipeline.add_transform(transform, static=item.kind == 'static transforms')


def _prepared(
    pipeline: Pipeline, sides: Sequence[str], image: JpegImage | RawImage
) -> Sequence[Frame | DetectionError]:
    """The frames of the views that an image shows, or why there are none."""
    if len(sides) == 1:
        return [pipeline.prepare(sides[0], image, READ_AHEAD // len(SIDES))]
    try:
        return halves(decode(image))
    except DetectionError as error:
        return [error] * len(sides)
