"""The triangulator node: left and right centroids in, `target/position` out."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo

from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.nodes import messages
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.shell import StageNode
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.sides import SIDES
from binopos_ros.triangulation.locate import Index
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Drop, Position, Triangulator


class TriangulatorNode(StageNode):
    """Triangulates pairs of centroids along the bent rays."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('triangulator', **node_options)
        options = self.declare_options(TriangulatorOptions, self._configure, self._judge)
        self._triangulator = Triangulator(options)
        self._newest: Index | None = None
        self._diagnostics = StageDiagnostics(self, 'stereo rig', self._details)
        self._places: dict[str, Publisher] = {}
        self._offer('position', *options.parts)
        self._index = self.publisher(Vector3Stamped, 'target/refractive_index')
        for side in SIDES:
            self.latched_subscription(
                CameraInfo, f'{side}/camera_info', partial(self._on_camera_info, side)
            )
            self.subscription(
                PoseWithCovarianceStamped, f'{side}/centroid', partial(self._on_centroid, side)
            )

    def _judge(self, options: TriangulatorOptions) -> None:
        self._triangulator.check(options)

    def _configure(self, options: TriangulatorOptions) -> None:
        self._triangulator.configure(options)
        self._diagnostics.caution('rig', self._triangulator.caution)
        self._offer(*options.parts)

    def _offer(self, *names: str) -> None:
        """Be ready to publish a position, or a part of its covariance, from the first one on."""
        for name in names:
            if name not in self._places:
                topic = f'target/{name}'
                self._places[name] = self.publisher(PoseWithCovarianceStamped, topic)

    def _on_camera_info(self, side: str, message: CameraInfo) -> None:
        problem, info = '', read_camera_info_message(message, side)
        self._diagnostics.caution(f'{side}/camera_info', '; '.join(info.contradictions()))
        try:
            self._triangulator.set_camera(side, info)
        except ValueError as error:
            problem = f'cannot be used: {error}'
        self._diagnostics.judge_input(f'{side}/camera_info', problem)
        self._diagnostics.caution('rig', self._triangulator.caution)

    def _on_centroid(self, side: str, message: PoseWithCovarianceStamped) -> None:
        self._diagnostics.received[f'{side}/centroid'] += 1
        u, v, diameter = position_of(message)
        centroid = Centroid(
            stamp=stamp_of(message),
            frame_id=message.header.frame_id,
            centre=np.array([u, v]),
            covariance=covariance_of(message)[:2, :2],
            diameter=diameter,
        )
        self._hand_on(self._triangulator.add(side, centroid))

    def _hand_on(self, results: Iterable[Position | Drop]) -> None:
        for result in results:
            if isinstance(result, Drop):
                self._diagnostics.drop(result.reason)
                if result.is_pair:
                    self._diagnostics.pairs.settle(result.reason)
                continue
            # The parts first, so that nobody has to wait for them.
            for name, part in (('systematic', result.systematic), ('medium', result.medium)):
                if part is not None:
                    self._publish(name, result, part)
            self._publish('position', result, result.covariance)
            if self._index.get_subscription_count() > 0:
                index = Vector3Stamped(header=messages.header(result.stamp, result.frame_id))
                index.vector.x = result.index.mean
                index.vector.y = result.index.std
                index.vector.z = float(result.index.observed)
                self._index.publish(index)
            self._newest = result.index
            self._diagnostics.published += 1
            self._diagnostics.pairs.settle()

    def _publish(self, name: str, position: Position, covariance: NDArray[np.float64]) -> None:
        self._places[name].publish(
            messages.pose_message(position.stamp, position.frame_id, position.point, covariance)
        )

    def _details(self) -> dict[str, object]:
        details: dict[str, object] = {}
        level = self._triangulator.wave_level
        if level is not None:
            details["Waves in the rays' miss (pixel noises)"] = f'{level:.2f}'
        if self._newest is not None:
            details['Refractive index'] = f'{self._newest.mean:.5f}'
            details['Refractive index, standard deviation'] = f'{self._newest.std:.5f}'
            details['Refractive index rests on'] = (
                'observation' if self._newest.observed else 'the prior only'
            )
            details['Refractive index of the newest pair alone'] = (
                f'{self._newest.frame:.4f}'
                if math.isfinite(self._newest.frame)
                else 'not determined'
            )
        return details
