"""Many points in blocks that fit the cache, shared out between the processor's cores."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

BLOCK = 4096  # points; some thirty arrays of as many doubles lie in a core's second-level cache
Result = TypeVar('Result')


def in_blocks(work: Callable[[slice], Result], count: int) -> list[Result]:
    """Call `work` on slices that cover range(count), on several threads where that pays.

    NumPy lets go of the interpreter's lock in its loops, so two threads do nearly twice the work.
    """
    blocks = [slice(start, start + BLOCK) for start in range(0, count, BLOCK)]
    workers = min(os.cpu_count() or 1, len(blocks) // 4)
    if workers < 2:
        return [work(block) for block in blocks]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, blocks))
