"""What `binopos process` writes: a bag with the topics of the live nodes, and a table."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from binopos_ros.bag import BagWriter, messages
from binopos_ros.bag.results import (
    odometry,
    pose,
    pose_covariance,
    pose_with_covariance,
    vector3,
)
from binopos_ros.pipeline import Event, Judged, Located, Seen
from binopos_ros.smoothing.health import LEVELS
from binopos_ros.triangulation.stage import Position

CSV_COLUMNS = (
    'stamp',
    *('x', 'y', 'z'),
    *('sx', 'sy', 'sz'),
    *('raw_x', 'raw_y', 'raw_z'),
    *('index', 'index_std'),
    *('vx', 'vy', 'vz'),
    *('cxy', 'cxz', 'cyz'),
)
#: Columns before those of the velocity.
MORE = CSV_COLUMNS.index('vx')
#: The covariance's terms beside its diagonal: xy, xz, yz.
TERMS = (0, 0, 1), (1, 2, 2)
Row = list[float | str]
TOPICS = {
    'left/centroid': messages.POSE_WITH_COVARIANCE,
    'right/centroid': messages.POSE_WITH_COVARIANCE,
    'target/position': messages.POSE_WITH_COVARIANCE,
    'target/refractive_index': messages.VECTOR3,
    'target/pose': messages.POSE_WITH_COVARIANCE,
    'target/odometry': messages.ODOMETRY,
    'target/pose_stamped': messages.POSE,
    'target/health': messages.STATUS,
}


class Output:
    """Writes events as the messages that the live nodes would have sent.

    Args:
        writer: of the bag.
        namespace: of the topics.
        child_frame: the target's own.
    """

    def __init__(self, writer: BagWriter, namespace: str, child_frame: str) -> None:
        self._writer = writer
        self._namespace = namespace
        self._child_frame = child_frame
        self._parts: set[str] = set()
        for topic, message_type in TOPICS.items():
            writer.add_topic(f'{namespace}/{topic}', message_type)

    def write(self, event: Event) -> None:
        """Write one event; drops leave no message."""
        if isinstance(event, Seen):
            centroid = event.centroid
            place = (*centroid.centre, centroid.diameter)
            self._pose(f'{event.side}/centroid', centroid, place, centroid.covariance)
        elif isinstance(event, Located):
            self._located(event)
        elif isinstance(event, Judged):
            health = event.health
            name = f'{self._namespace.lstrip("/")}/smoother: target'.lstrip('/')
            values = health.values(event.frame_id)
            message = messages.status(name, 'target', LEVELS[health.word], health.word, values)
            self._write('target/health', event.stamp, message)

    def _located(self, event: Located) -> None:
        position = event.position
        for name, part in (('systematic', position.systematic), ('medium', position.medium)):
            if part is not None:
                self._part(f'target/{name}', position, part)
        self._pose('target/position', position, position.point, position.covariance)
        index = (position.index.mean, position.index.std, float(position.index.observed))
        vector = vector3(position.stamp, position.frame_id, index)
        self._write('target/refractive_index', position.stamp, vector)
        if event.pose is None:
            return
        state = event.pose.state
        covariance = pose_covariance(state.covariance[:3, :3])
        filtered = pose_with_covariance(position.stamp, event.frame_id, state.position, covariance)
        self._write('target/pose', position.stamp, filtered)
        plain = pose(position.stamp, event.frame_id, state.position)
        self._write('target/pose_stamped', position.stamp, plain)
        moving = odometry(
            position.stamp,
            (event.frame_id, self._child_frame),
            state.position,
            covariance,
            state.velocity,
            pose_covariance(state.covariance[3:, 3:]),
        )
        self._write('target/odometry', position.stamp, moving)

    def _part(self, topic: str, position: Position, part: NDArray[np.float64]) -> None:
        """Write a part of a position's covariance, on a topic that is there if parts are."""
        if topic not in self._parts:
            self._parts.add(topic)
            full_name = f'{self._namespace}/{topic}'
            self._writer.add_topic(full_name, messages.POSE_WITH_COVARIANCE)
        self._pose(topic, position, position.point, part)

    def _pose(self, topic: str, source: Any, place: Any, known: NDArray[np.float64]) -> None:
        """Write a place with the covariance (k, k) of its first k coordinates."""
        full = pose_covariance(known)
        data = pose_with_covariance(source.stamp, source.frame_id, place, full)
        self._write(topic, source.stamp, data)

    def _write(self, topic: str, stamp: int, message: Any) -> None:
        self._writer.write(f'{self._namespace}/{topic}', stamp, message)


class Table:
    """The CSV of the contract: a row per pair that gave a position, or per pair.

    Args:
        stream: to write to.
        every_pair: rows of pairs that gave no pose too, with the reason; all are written at the
            end, in the order of their stamps.
    """

    def __init__(self, stream: TextIO, every_pair: bool = False) -> None:
        self._rows = csv.writer(stream, lineterminator='\n')
        self._kept: dict[int, Row] | None = {} if every_pair else None
        self._rows.writerow([*CSV_COLUMNS, *(['reason'] if every_pair else [])])

    def write(self, event: Located) -> None:
        """Take one row in; the filtered columns stay empty where the filter gave no pose."""
        position = event.position
        filtered: Row = [''] * 6
        more: Row = [''] * (len(CSV_COLUMNS) - MORE)
        if event.pose is not None:
            state = event.pose.state
            deviations = np.sqrt(np.diag(state.covariance)[:3])
            filtered = [*state.position.tolist(), *deviations.tolist()]
            more = [*state.velocity.tolist(), *state.covariance[TERMS].tolist()]
        row: Row = [
            seconds_text(position.stamp),
            *filtered,
            *position.point.tolist(),
            float(position.index.mean),
            float(position.index.std),
            *more,
        ]
        if self._kept is None:
            self._rows.writerow(row)
        else:
            self._kept[position.stamp] = row

    def end(self, lost: Iterable[tuple[int, str]]) -> None:
        """Write what was kept, and the pairs that were lost: stamps (ns) and reasons."""
        if self._kept is None:
            return
        for stamp, reason in lost:
            empty: Row = [seconds_text(stamp), *[''] * (len(CSV_COLUMNS) - 1)]
            self._kept.setdefault(stamp, empty).append(reason)
        for _, row in sorted(self._kept.items()):
            self._rows.writerow([*row, *[''] * (len(CSV_COLUMNS) + 1 - len(row))])


def seconds_text(stamp: int) -> str:
    """A stamp of nanoseconds in seconds, to the nanosecond."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    return f'{seconds}.{rest:09d}'
