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

from observer import POSE, Observer, StuckError
from rclpy.serialization import deserialize_message
from scene import RATE, SERIALS, SIZE
from sensor_msgs.msg import CompressedImage
from timing import Result, shortest
from virtual_camera.camera import VirtualCamera
from virtual_camera.usbip import free_ports

from binopos_ros.capture.usb import find_cameras

IMAGES = {side: f'{side}/image_raw/compressed' for side in SERIALS}
UNDISTURBED = 20
"""Poses in the undisturbed stretch."""

START = 240.0
"""Seconds that the suite is given to start."""

STAGES = 4


class Lab:
    """The cameras, the suite, and what is done to them."""

    def __init__(self, scene: Path, out: Path, processes: list[int]) -> None:
        self.out = out
        self.processes = processes
        self.results: dict[str, Result] = {}
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
        **options: Any,
    ) -> None:
        """Bring a fault about, wait until the suite says so, mend it, and time the recovery."""
        self.results[fault] = shortest(
            lambda: self._recover(side, inject, mend, words), 'seconds_to_pose', **options
        )
        self._save()

    def _recover(
        self,
        side: str,
        inject: Callable[[], object],
        mend: Callable[[], object],
        words: str,
    ) -> Result:
        observer = self.observer
        inject()
        observer.expect(f'the word "{words}"', lambda: words in observer.said)
        said = observer.said
        began = time.monotonic()
        mend()
        # A camera that was unplugged is back once the kernel shows it.
        observer.expect('the camera in sysfs', self._all_shown)
        mended, after = time.monotonic(), time.time_ns()
        image, pose = (observer.next(topic, after) for topic in (IMAGES[side], POSE))
        # All is well before the next fault.
        if words:
            observer.expect('the all-clear', lambda: words not in observer.said)
        return {
            'said': said,
            'seconds_to_mend': mended - began,
            'seconds_to_image': image.arrived - mended,
            'seconds_to_pose': pose.arrived - mended,
            'suite_alive': self.alive,
        }

    def _all_shown(self) -> bool:
        shown = {camera.serial for camera in find_cameras() if Path(camera.node).exists()}
        return all(one.serial in shown for one in self.cameras.values() if one.port is not None)

    def missing_at_start(self) -> None:
        left, right = self.cameras.values()
        observer = self.observer
        observer.kept = []
        left.plug()
        observer.expect(
            'the suite',
            lambda: 'left/centroid' in observer.newest and len(observer.stages) == STAGES,
            START,
        )
        missing = 'right: camera'
        self.recover('missing at start', 'right', lambda: None, right.plug, missing, tries=1)

    def undisturbed(self) -> None:
        """From the first pair on: a filter's state depends on all that it has seen."""
        observer = self.observer
        kept = observer.kept or []
        observer.expect(
            'the poses', lambda: sum(topic == POSE for topic, *_ in kept) >= UNDISTURBED, START
        )
        # What is on its way through the suite still counts; further images do not.
        last = max(stamp for topic, _, stamp, _ in kept if topic == IMAGES['left'])
        observer.spin(lambda: any(topic == POSE and stamp >= last for topic, _, stamp, _ in kept))
        observer.kept = None
        with (self.out / 'messages.pickle').open('wb') as file:
            pickle.dump([one for one in kept if one[2] <= last], file)
        self.results['undisturbed'] = {
            'status': observer.status,
            'links': [camera.by_id for camera in find_cameras()],
            'suite_alive': self.alive,
        }
        self._save()

    def controls(self) -> None:
        """The left camera's gain is set, and the right one's follows."""
        left, right = self.cameras.values()
        observer = self.observer
        refused = observer.set_parameter('left.controls.gain', 101)
        for name, value in (('lock_exposure', True), ('left.controls.gain', 40)):
            observer.set_parameter(name, value)
        observer.expect('the same gain on both', lambda: left.gain == right.gain == 40)
        observer.set_parameter('lock_exposure', False)
        self.results['controls'] = {'refused': refused}

    def unplugged(self) -> None:
        left, right = self.cameras.values()
        port = right.port
        unplugged = 'is unplugged; plug it in again'
        self.recover('unplug', 'right', right.unplug, lambda: right.plug(port), unplugged)
        self.results['controls']['gain_after_replugging'] = right.gain
        self.recover(
            'other port',
            'right',
            right.unplug,
            lambda: right.plug(free_ports()[-1]),
            unplugged,
        )
        ports: list[int | None] = []

        def unplug_both() -> None:
            ports[:] = left.port, right.port
            left.unplug()
            right.unplug()

        def exchange() -> None:
            left.plug(ports[1])
            right.plug(ports[0])

        self.recover('exchanged ports', 'left', unplug_both, exchange, unplugged)
        self.results['exchanged ports']['sides_kept'] = self._sides_are_kept()
        self._save()

    def _sides_are_kept(self) -> bool:
        kept = []
        for side, camera in self.cameras.items():
            heard = self.observer.next(IMAGES[side], time.time_ns())
            message = deserialize_message(heard.data, CompressedImage)
            kept.append(bytes(message.data) in camera.frames)
        return all(kept)

    def frozen(self) -> None:
        left = self.cameras['left']

        def freeze(state: bool) -> None:
            left.frozen = state

        def stall() -> None:
            left.faults['stall'] = 1 << 30

        self.recover('freeze', 'left', lambda: freeze(True), lambda: freeze(False), 'no frame for')
        self.recover('stall', 'left', stall, left.faults.clear, 'gave all buffers back empty')

    def damaged(self) -> None:
        right, count = self.cameras['right'], 2
        for kind, counted in (
            # Damage inside a JPEG bears no mark: the decoder may find it, or make a picture of it.
            ('corrupt', ''),
            ('short', 'Dropped: right: JPEG cut short'),
            # The kernel's driver keeps what the device flags as damaged to itself.
            ('error', 'Dropped: right: lost by the driver'),
            ('drop', ''),
        ):
            before = self._count(counted)

            def spoil(kind: str = kind) -> None:
                right.faults[kind] = count
                self.observer.expect('the damage', lambda: right.faults[kind] <= 0)

            self.recover(kind, 'right', spoil, lambda: None)
            if counted:
                self.observer.spin(lambda: self._count(counted) >= before + count)  # noqa: B023
                self.results[kind]['dropped'] = self._count(counted) - before
                self._save()

    def _count(self, reason: str) -> int:
        return int(self.observer.status.get(reason, 0))

    def busy(self) -> None:
        """Another program takes the left camera while capture is stopped."""
        left, observer = self.cameras['left'], self.observer
        thieves: list[subprocess.Popen[bytes]] = []

        def steal() -> None:
            node = observer.status['left: camera'].split()[0]
            observer.capture(False)
            sent = left.sent
            thieves.append(
                subprocess.Popen(
                    ['v4l2-ctl', '-d', node, '--stream-mmap'],
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
            )
            observer.expect('the frames of the other program', lambda: left.sent > sent)
            observer.capture(True)

        def release() -> None:
            thieves[-1].terminate()
            thieves[-1].wait()

        self.recover('busy', 'left', steal, release, 'another program uses it')

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
            lab.controls,
            lab.unplugged,
            lab.frozen,
            lab.damaged,
            lab.busy,
        ):
            act()
            print(f'{act.__name__} done at {time.monotonic():.0f} s', flush=True)
    except StuckError as error:
        # Told by the test that misses what should have come after.
        lab.results['stuck'] = {'why': str(error)}
        print(f'stuck: {error}', flush=True)
    lab.end()
    # The threads of the virtual cameras are not waited for.
    sys.stdout.flush()
    os._exit(0)


if __name__ == '__main__':
    main(Path(sys.argv[1]), Path(sys.argv[2]), [int(word) for word in sys.argv[3:]])
