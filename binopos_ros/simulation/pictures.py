"""A scene's pictures in the order of time, rendered by several threads."""

from __future__ import annotations

import collections
import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from binopos_ros.simulation.render import Renderer
from binopos_ros.simulation.scene import Scene


def encoded_pairs(
    scene: Scene, pairs: int, seed: int, threads: int | None
) -> Iterator[tuple[bytes, bytes]]:
    """Encoded pictures of each pair in order, rendered a few pairs ahead.

    Args:
        scene: what to render.
        pairs: how many.
        seed: of the noise; the same seed gives the same bytes, whatever the number of threads.
        threads: that render at once; None: one per processor.
    """
    threads = threads or os.cpu_count() or 1
    times = scene.times(pairs)
    with ThreadPoolExecutor(threads) as pool:
        renderers = tuple(pool.map(lambda side: Renderer(scene, side), range(2)))

        def render(number: int, side: int) -> bytes:
            # A stream of its own for each picture: the order of rendering cannot matter.
            noise = np.random.Generator(np.random.SFC64([seed, number, side]))
            picture = renderers[side].picture(float(times[number]), noise)
            return scene.sensor.encode(picture)

        waiting: collections.deque[tuple[Future[bytes], Future[bytes]]] = collections.deque()
        try:
            for number in range(pairs):
                waiting.append((pool.submit(render, number, 0), pool.submit(render, number, 1)))
                if len(waiting) > threads + 1:
                    left, right = waiting.popleft()
                    yield left.result(), right.result()
            while waiting:
                left, right = waiting.popleft()
                yield left.result(), right.result()
        finally:
            for left, right in waiting:
                left.cancel()
                right.cancel()
