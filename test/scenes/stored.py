"""What a bag holds, to compare."""

from __future__ import annotations

from pathlib import Path

from binopos_ros.bag import BagReader


def read(path: Path) -> list[tuple[int, str, bytes]]:
    """Each message's time of logging, topic and bytes, in the bag's order."""
    with BagReader(path) as reader:
        return [(record.stamp_ns, record.topic, record.data) for record in reader.messages()]
