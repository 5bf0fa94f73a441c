"""A scene as a bag: pictures, calibration and truth, and the parameter file for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from binopos_ros.bag import BagWriter, messages
from binopos_ros.bag.results import pose_with_covariance
from binopos_ros.bag.rig_topics import NAMESPACE
from binopos_ros.cli.simulated_platform import SimulatedPlatform
from binopos_ros.optics import CameraInfo
from binopos_ros.optics.rig_files import camera_infos_from_stereo
from binopos_ros.platform.quaternions import quaternion_of
from binopos_ros.sides import SIDES
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.parameters import write_calibration
from binopos_ros.simulation.pictures import encoded_pairs
from binopos_ros.simulation.rig_motion import SeenFromRobot
from binopos_ros.simulation.scene import Scene
from binopos_ros.simulation.sensor import bytes_per_pixel

Array = NDArray[np.float64]

FRAMES = ('left_camera_optical_frame', 'right_camera_optical_frame')
#: Part of the seed that is the odometry's.
ODOMETRY = 99
#: Stamp of the first pair, ns: a fixed moment, so that the same scene gives the same bytes.
START_NS = 1_700_000_000 * 10**9


def record(
    scene: Scene,
    path: str | Path,
    pairs: int,
    *,
    seed: int = 0,
    threads: int | None = None,
    on_pair: Callable[[], None] = lambda: None,
    given: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> None:
    """Render pairs of a scene into a new bag.

    Topics under /stereo: `left/` and `right/` with `image_raw/compressed` (or `image_raw`) and
    `camera_info`, and `truth/pose`, the target's place in the rig's frame, covariance zero. Where
    a robot carries the rig, `platform/odometry` and `truth/fixed_pose` too, and `/tf` and
    `/tf_static`.
    Beside the messages lie `binopos.yaml`, `left.yaml` and `right.yaml`: the interface and the
    calibration, as the nodes take them.

    Args:
        scene: what to render.
        path: of the bag, a folder or a single .mcap file, which must not exist yet.
        pairs: how many.
        seed: of the noise; the same seed gives the same bytes, whatever the number of threads.
        threads: that render at once; default one per processor.
        on_pair: called after each pair that was written.
        given: parameters by node that go over those that follow from the scene.

    Raises:
        SimulationError: nothing to render.
        BagError: the path exists or cannot be written.
    """
    if pairs < 1:
        msg = f'{pairs} pairs make no bag: give 1 or more'
        raise SimulationError(msg)
    if threads is not None and threads < 1:
        msg = f'{threads} threads render nothing: give 1 or more'
        raise SimulationError(msg)
    rig = scene.rig
    infos = camera_infos_from_stereo(rig.left, rig.right, rig.rotation, rig.translation)
    times = scene.times(pairs)
    stamps = START_NS + np.rint(times * 1e9).astype(np.int64)
    positions = scene.path.poses(times)[0]
    quaternions = [quaternion_of(rotation) for rotation in scene.target_rotations(times)]
    raw = scene.sensor.encoding != 'jpeg'
    picture_topic = 'image_raw' if raw else 'image_raw/compressed'
    picture_type = messages.IMAGE if raw else messages.COMPRESSED_IMAGE
    with BagWriter(path) as writer:
        for side in SIDES:
            writer.add_topic(f'{NAMESPACE}/{side}/{picture_topic}', picture_type)
            writer.add_topic(f'{NAMESPACE}/{side}/camera_info', messages.CAMERA_INFO)
        writer.add_topic(f'{NAMESPACE}/truth/pose', messages.POSE_WITH_COVARIANCE)
        robot = None
        if isinstance(scene.path, SeenFromRobot):
            rng = np.random.default_rng([seed, ODOMETRY])
            robot = SimulatedPlatform(writer, NAMESPACE, scene.path, scene.odometer, stamps, rng)
            robot.write_mounting(FRAMES, np.asarray(rig.rotation), np.asarray(rig.translation))
        write_calibration(scene, infos, Path(path), _blocks(given))
        for number, pictures in enumerate(encoded_pairs(scene, pairs, seed, threads)):
            stamp = int(stamps[number])
            if robot is not None:
                robot.write_until(stamp)
                robot.write_truth(number, stamp)
            for side, frame, info, data in zip(SIDES, FRAMES, infos, pictures, strict=True):
                calibration = messages.camera_info(stamp, frame, info)
                writer.write(f'{NAMESPACE}/{side}/camera_info', stamp, calibration)
                picture = _picture_message(scene, stamp, frame, data, info)
                writer.write(f'{NAMESPACE}/{side}/{picture_topic}', stamp, picture)
            pose = pose_with_covariance(
                stamp, FRAMES[0], positions[number], np.zeros((3, 3)), quaternions[number]
            )
            writer.write(f'{NAMESPACE}/truth/pose', stamp, pose)
            on_pair()
        if robot is not None:
            robot.write_until(None)


def _blocks(given: Mapping[str, Mapping[str, Any]]) -> str:
    """Blocks of a parameter file."""
    blocks = {
        f'{NAMESPACE}/{node}': {
            'ros__parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in values.items()
            }
        }
        for node, values in given.items()
    }
    return yaml.safe_dump(blocks, sort_keys=False, default_flow_style=None) if blocks else ''


def _picture_message(
    scene: Scene, stamp: int, frame: str, data: bytes, info: CameraInfo
) -> object:
    encoding = scene.sensor.encoding
    if encoding == 'jpeg':
        return messages.compressed_image(stamp, frame, data)
    step = info.width * bytes_per_pixel(encoding)
    return messages.image(stamp, frame, data, (info.width, info.height), encoding, step)
