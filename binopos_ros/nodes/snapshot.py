"""What a recording needs to be processed again: the nodes' parameters, the calibrations."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo

from binopos_ros.node_options import LIVE, OF_ROS
from binopos_ros.nodes.shell import StageNode, is_empty_list
from binopos_ros.optics.camera_info_files import write_camera_info
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.parameters import QOS_OVERRIDES

COVARIANCE = 'calibration_covariance'
#: Seconds between looks for nodes whose parameters are not known, or have changed.
PERIOD = 0.5
HEADER = '# What the nodes ran with while this was recorded. Made by the recorder.\n'


class Snapshot:
    """Keeps `binopos.yaml`, `left.yaml` and `right.yaml` beside a recording.

    The parameters are those of the nodes in the recorder's namespace, asked for when a node is
    seen, and again whenever it says that one has changed.

    Args:
        node: the recorder.
        bag: the recording: a folder, or a file NAME.mcap, whose names then begin with `NAME.`.
    """

    def __init__(self, node: StageNode, bag: Path) -> None:
        single = bag.suffix == '.mcap'
        self._folder, self._prefix = (bag.parent, f'{bag.stem}.') if single else (bag, '')
        self._node = node
        self._namespace = node.get_namespace().rstrip('/')
        self._values: dict[str, dict[str, Any]] = {}
        self._asked: set[str] = set()
        self._calibrated: set[str] = set()
        self._clients: dict[str, tuple[Any, Any]] = {}
        node.create_subscription(
            ParameterEvent, '/parameter_events', self._on_event, QoSProfile(depth=100)
        )
        node.every(PERIOD, self._look)

    def calibration(self, side: str, data: bytes) -> None:
        """Keep the first camera_info of a side that can be used."""
        if side in self._calibrated:
            return
        try:
            info = read_camera_info_message(deserialize_message(data, CameraInfo), side)
            write_camera_info(self._path(f'{side}.yaml'), info)
        except (ValueError, OSError):
            # It is in the bag all the same.
            return
        self._calibrated.add(side)

    def _on_event(self, event: ParameterEvent) -> None:
        self._asked.discard(event.node)

    def _look(self) -> None:
        present = {
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self._node.get_node_names_and_namespaces()
        }
        for name in LIVE:
            full_name = f'{self._namespace}/{name}'
            if full_name in present and full_name not in self._asked:
                self._ask(full_name)

    def _ask(self, full_name: str) -> None:
        if full_name not in self._clients:
            self._clients[full_name] = (
                self._node.create_client(ListParameters, f'{full_name}/list_parameters'),
                self._node.create_client(GetParameters, f'{full_name}/get_parameters'),
            )
        names_of, values_of = self._clients[full_name]
        if not (names_of.service_is_ready() and values_of.service_is_ready()):
            return
        self._asked.add(full_name)

        def on_names(answer: ListParameters.Response) -> None:
            names = [
                name
                for name in answer.result.names
                if name not in OF_ROS and not name.startswith(QOS_OVERRIDES)
            ]

            def on_values(answer: GetParameters.Response) -> None:
                values = [parameter_value_to_python(value) for value in answer.values]
                self._keep(full_name, dict(zip(names, values, strict=False)))

            _then(values_of.call_async(GetParameters.Request(names=names)), on_values)

        _then(names_of.call_async(ListParameters.Request()), on_names)

    def _keep(self, full_name: str, values: dict[str, Any]) -> None:
        covariance = Path(values.get(COVARIANCE) or '')
        if covariance.is_file():
            kept = self._path('covariance.yaml')
            shutil.copyfile(covariance, kept)
            values[COVARIANCE] = kept.name
        self._values[full_name] = {
            name: list(value) if hasattr(value, '__iter__') and value != str(value) else value
            for name, value in values.items()
            if value is not None and not is_empty_list(value)
        }
        blocks = {name: {'ros__parameters': each} for name, each in sorted(self._values.items())}
        text = HEADER + yaml.safe_dump(blocks, sort_keys=False, default_flow_style=None)
        part = self._path('binopos.yaml.part')
        part.write_text(text, encoding='utf-8')
        os.replace(part, self._path('binopos.yaml'))

    def _path(self, name: str) -> Path:
        return self._folder / f'{self._prefix}{name}'


def _then(future: Any, callback: Callable[[Any], None]) -> None:
    """Hand on what a service answers; nothing where it has gone."""

    def done(future: Any) -> None:
        answer = future.result()
        if answer is not None:
            callback(answer)

    future.add_done_callback(done)
