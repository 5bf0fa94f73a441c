"""A killed run's shared memory and unpacked bags go at the next start, a living one's stay."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from binopos_ros.cli.leftovers import SHARED_MEMORY, YOUNG, clear_leftovers

NODE = """
import time, rclpy
rclpy.init(args=[])
node = rclpy.create_node('kept')
lines = open('/proc/self/maps').read().splitlines()
print(*{line.split()[-1] for line in lines if '/dev/shm/fastrtps_' in line}, flush=True)
time.sleep(60)
"""


def age(path: Path) -> None:
    then = time.time() - 2 * YOUNG
    os.utime(path, (then, then))


@pytest.mark.live
def test_the_segment_of_a_killed_node_goes_and_that_of_a_living_one_stays(ros_domain, tmp_path):
    node = subprocess.Popen([sys.executable, '-c', NODE], stdout=subprocess.PIPE, text=True)
    try:
        segments = [
            Path(word) for word in node.stdout.readline().split() if 'fastrtps_port' not in word
        ]
        if not segments:
            pytest.skip('the middleware does not use shared memory here')
        locks = [Path(f'{segment}_el') for segment in segments]
        for path in locks:
            age(path)
        clear_leftovers(SHARED_MEMORY, tmp_path)
        assert all(path.exists() for path in (*segments, *locks))
    finally:
        node.kill()
        node.wait()
    assert all(path.exists() for path in segments)
    clear_leftovers(SHARED_MEMORY, tmp_path)
    assert not any(path.exists() for path in (*segments, *locks))


def test_an_unpacked_bag_goes_when_nobody_reads_it(tmp_path):
    held, left, other = (tmp_path / name for name in ('binopos_bag_a', 'binopos_bag_b', 'mine'))
    for folder in (held, left, other):
        folder.mkdir()
        (folder / 'bag.mcap').touch()
        age(folder)
    young = tmp_path / 'binopos_bag_c'
    young.mkdir()
    with (held / 'bag.mcap').open():
        clear_leftovers(tmp_path, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [held.name, young.name, 'mine']
