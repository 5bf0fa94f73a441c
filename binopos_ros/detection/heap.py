"""What becomes of the memory of pictures that have been looked at."""

from __future__ import annotations

import ctypes

#: Of the C library's malloc.h; and more bytes than any picture has.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8
PLENTY = 1 << 30


def keep_freed_pictures() -> None:
    """Let this process keep the memory of freed pictures for the next ones.

    To give it back to the system costs a page fault per 4 KiB when the next one comes: of two raw
    pictures of 1280 x 960, more than to find the target in them. Nothing happens where the C
    library knows no such thing.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, 'mallopt'):
        library.mallopt(M_MMAP_THRESHOLD, PLENTY)
        library.mallopt(M_TRIM_THRESHOLD, PLENTY)
        # A heap per thread would grow with the time, as pictures wander between them.
        library.mallopt(M_ARENA_MAX, 1)
