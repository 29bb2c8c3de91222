"""Tuning of glibc's allocator: freed memory is kept in the process."""

import ctypes
from functools import cache

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # names of glibc's mallopt
KEPT_BYTES = 128 * 2**20
LARGEST_KEPT_BYTES = 32 * 2**20  # the most that glibc admits


@cache
def keep_freed_memory() -> bool:
    """Have glibc keep up to ``KEPT_BYTES`` that were freed; whether it does, for other C libraries have no such switch.

    A lost robot's batches are megabytes that are freed and asked for again in the next call. Where their pages go back
    to the system in between, faulting them in costs a tenth of the keyframe.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(TRIM_THRESHOLD, KEPT_BYTES) and mallopt(MMAP_THRESHOLD, LARGEST_KEPT_BYTES))
