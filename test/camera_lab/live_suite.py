"""Runs in the guest: the whole suite live on two virtual cameras, and every fault in turn.

    python live_suite.py SCENE OUT PROCESS ...

SCENE is what scene.py made, each PROCESS the number of a `binopos run` that is already up. OUT
receives `results.json` (each fault with its times to recovery and what the diagnostics said of it)
and `messages.pickle` (topic, type, stamp, CDR of an undisturbed stretch).
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from scene import RATE, SERIALS, SIZE
from sensor_msgs.msg import CameraInfo, CompressedImage
from std_srvs.srv import SetBool
from virtual_camera.camera import VirtualCamera
from virtual_camera.usbip import free_ports

from binopos_ros.capture.usb import find_cameras

TOPICS = {
    'left/image_raw/compressed': CompressedImage,
    'right/image_raw/compressed': CompressedImage,
    'left/camera_info': CameraInfo,
    'right/camera_info': CameraInfo,
    'target/position': PoseWithCovarianceStamped,
    'target/pose': PoseWithCovarianceStamped,
}
IMAGES = {side: f'{side}/image_raw/compressed' for side in SERIALS}
POSE = 'target/pose'
UNDISTURBED = 10.0
PATIENCE = 20.0
START = 180.0
STAGES = 4


class Observer:
    """Hears all that the suite says."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node('observer', namespace='stereo')
        self.executor = rclpy.executors.SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.kept: list[tuple[str, str, int, bytes]] | None = None
        self.newest: dict[str, tuple[float, Any]] = {}
        self.counts = dict.fromkeys(TOPICS, 0)
        self.status: dict[str, str] = {}
        self.stages: dict[str, dict[str, str]] = {}
        self.said = ''
        for topic, kind in TOPICS.items():
            self.node.create_subscription(
                kind, topic, self._keeper(topic, kind), qos_profile_sensor_data, raw=True
            )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 20)

    def _keeper(self, topic: str, kind: type) -> Callable[[bytes], None]:
        name = f'sensor_msgs/msg/{kind.__name__}'
        if kind is PoseWithCovarianceStamped:
            name = f'geometry_msgs/msg/{kind.__name__}'

        def keep(data: bytes) -> None:
            self.newest[topic] = (time.monotonic(), data)
            self.counts[topic] += 1
            if self.kept is not None:
                stamp = deserialize_message(data, kind).header.stamp
                self.kept.append((topic, name, stamp.sec * 10**9 + stamp.nanosec, data))

        return keep

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if 'camera' in status.name:
                self.said = status.message
                self.status = {item.key: item.value for item in status.values}
            self.stages[status.name] = {item.key: item.value for item in status.values}

    def spin(self, until: Callable[[], bool], patience: float = PATIENCE) -> bool:
        """Listen until the condition holds; False where it does not in time."""
        deadline = time.monotonic() + patience
        while not until():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def next(self, topic: str, after: float) -> float | None:
        """Seconds from `after` until the next message of a topic; None where none comes."""
        came = self.spin(lambda: self.newest.get(topic, (0.0,))[0] > after)
        return self.newest[topic][0] - after if came else None

    def capture(self, start: bool) -> None:
        """Have the camera node start or stop."""
        client = self.node.create_client(SetBool, 'start_capture')
        self.spin(client.service_is_ready)
        self.spin(client.call_async(SetBool.Request(data=start)).done)
        self.node.destroy_client(client)


class Lab:
    """The cameras, the suite, and what is done to them."""

    def __init__(self, scene: Path, out: Path, processes: list[int]) -> None:
        self.out = out
        self.processes = processes
        self.results: dict[str, dict[str, Any]] = {}
        self.cameras = {
            side: VirtualCamera(
                [path.read_bytes() for path in sorted((scene / side).iterdir())],
                SIZE,
                (RATE,),
                serial,
            )
            for side, serial in SERIALS.items()
        }
        self.observer = Observer()

    @property
    def alive(self) -> bool:
        """Whether every process of the suite is up."""
        return all(Path(f'/proc/{process}').exists() for process in self.processes)

    def recover(
        self,
        fault: str,
        side: str,
        inject: Callable[[], object],
        mend: Callable[[], object],
        words: str = '',
    ) -> None:
        """Bring a fault about, wait until the suite says so, mend it, and time the recovery.

        A camera that was unplugged is back once the kernel shows it: how long an emulated machine
        takes over that is told apart.
        """
        observer = self.observer
        inject()
        told = observer.spin(lambda: words in observer.said) if words else True
        said = observer.said
        began = time.monotonic()
        mend()
        observer.spin(self._all_shown, PATIENCE)
        mended = time.monotonic()
        to_image = observer.next(IMAGES[side], mended)
        to_pose = observer.next(POSE, mended)
        self.results[fault] = {
            'told': told,
            'said': said,
            'seconds_to_mend': mended - began,
            'seconds_to_image': to_image,
            'seconds_to_pose': to_pose,
            'suite_alive': self.alive,
        }
        self._save()
        # All is well before the next fault.
        observer.spin(lambda: not words or words not in observer.said, 5.0)

    def _all_shown(self) -> bool:
        shown = {camera.serial for camera in find_cameras() if Path(camera.node).exists()}
        return all(one.serial in shown for one in self.cameras.values() if one.port is not None)

    def missing_at_start(self) -> None:
        left, right = self.cameras.values()
        left.plug()
        observer = self.observer
        observer.spin(
            lambda: observer.counts[IMAGES['left']] > 0 and len(observer.stages) == STAGES, START
        )
        self.recover('missing at start', 'right', lambda: None, right.plug, 'right: camera')
        observer.spin(lambda: observer.counts[POSE] > 0, START)

    def undisturbed(self) -> None:
        observer = self.observer
        observer.kept = []
        observer.spin(lambda: False, UNDISTURBED)
        # What is on its way through the suite still counts; further images do not.
        last = max(stamp for topic, _, stamp, _ in observer.kept if topic in IMAGES.values())
        observer.spin(
            lambda: any(
                topic == POSE and stamp >= last for topic, _, stamp, _ in observer.kept or ()
            )
        )
        kept, observer.kept = observer.kept, None
        kept = [one for one in kept if one[2] <= last]
        with (self.out / 'messages.pickle').open('wb') as file:
            pickle.dump(kept, file)
        self.results['undisturbed'] = {
            'seconds': UNDISTURBED,
            'status': self.observer.status,
            'links': [camera.by_id for camera in find_cameras()],
            'suite_alive': self.alive,
        }
        self._save()

    def unplugged(self) -> None:
        left, right = self.cameras.values()
        port = right.port
        unplugged = 'is unplugged; plug it in again'
        self.recover('unplug', 'right', right.unplug, lambda: right.plug(port), unplugged)
        other = free_ports()[-1]
        self.recover('other port', 'right', right.unplug, lambda: right.plug(other), unplugged)
        ports = left.port, right.port

        def exchange() -> None:
            left.plug(ports[1])
            right.plug(ports[0])

        def unplug_both() -> None:
            left.unplug()
            right.unplug()

        self.recover('exchanged ports', 'left', unplug_both, exchange, unplugged)
        self.results['exchanged ports']['sides_kept'] = self._sides_are_kept()

    def _sides_are_kept(self) -> bool:
        kept = []
        for side, camera in self.cameras.items():
            arrived = self.observer.next(IMAGES[side], time.monotonic())
            message = deserialize_message(self.observer.newest[IMAGES[side]][1], CompressedImage)
            kept.append(arrived is not None and bytes(message.data) in camera.frames)
        return all(kept)

    def frozen(self) -> None:
        left = self.cameras['left']

        def freeze(state: bool) -> None:
            left.frozen = state

        self.recover('freeze', 'left', lambda: freeze(True), lambda: freeze(False), 'no frame for')
        left.faults['stall'] = 1 << 30
        self.recover('stall', 'left', lambda: None, left.faults.clear, 'no frame for')

    def damaged(self) -> None:
        right = self.cameras['right']
        for kind, count in (('corrupt', 2), ('short', 2), ('error', 2), ('drop', 2)):
            before = self._dropped()

            def spoil(kind: str = kind, count: int = count) -> None:
                right.faults[kind] = count
                self.observer.spin(lambda: right.faults[kind] <= 0, 10.0)

            self.recover(kind, 'right', spoil, lambda: None)
            whole = sum(before.values()) + count
            self.observer.spin(lambda whole=whole: sum(self._dropped().values()) >= whole, 4.0)
            after = self._dropped()
            self.results[kind]['dropped'] = {
                reason: after[reason] - before.get(reason, 0) for reason in after
            }

    def _dropped(self) -> dict[str, int]:
        return {
            f'{stage.partition(":")[0]} {key.partition(": ")[2]}': int(value)
            for stage, values in self.observer.stages.items()
            for key, value in values.items()
            if key.startswith('Dropped: right')
        }

    def busy(self) -> None:
        """Another program takes the left camera while capture is stopped."""
        self.observer.capture(False)
        thief = subprocess.Popen(
            ['v4l2-ctl', '-d', self._node('left'), '--stream-mmap'],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.observer.spin(lambda: False, 1.0)

        def release() -> None:
            thief.terminate()
            thief.wait()

        self.recover(
            'busy', 'left', lambda: self.observer.capture(True), release, 'another program uses it'
        )

    def _node(self, side: str) -> str:
        camera = self.observer.status[f'{side}: camera']
        return camera.split()[0]

    def end(self) -> None:
        for camera in self.cameras.values():
            camera.unplug()
        self.results['end'] = {'suite_alive': self.alive}
        self._save()

    def _save(self) -> None:
        # After each step: what was seen outlasts a machine that is stopped half-way.
        seen = {**self.results, 'stages': self.observer.stages}
        (self.out / 'results.json').write_text(json.dumps(seen, indent=1))


def main(scene: Path, out: Path, processes: list[int]) -> None:
    """Go through it all."""
    lab = Lab(scene, out, processes)
    try:
        for act in (
            lab.missing_at_start,
            lab.undisturbed,
            lab.unplugged,
            lab.frozen,
            lab.damaged,
            lab.busy,
        ):
            act()
            print(f'{act.__name__} done at {time.monotonic():.0f} s', flush=True)
    finally:
        lab.end()
        os._exit(0)


if __name__ == '__main__':
    main(Path(sys.argv[1]), Path(sys.argv[2]), [int(word) for word in sys.argv[3:]])
