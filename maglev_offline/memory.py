"""How this process asks the system for memory."""

import ctypes
import sys
from functools import cache

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGEST_MMAP_THRESHOLD = 32 * 2**20  # glibc takes no larger one
_TRIM_BYTES = 64 * 2**20


@cache
def keep_freed_memory() -> bool:
    """Let the process keep arrays' memory for the next arrays instead of giving it back at once; True where it could.

    glibc maps every block of 128 KiB or more anew and returns it when it is freed, so that each chunk of a log touches
    fresh pages: the faults cost more than the decoding. Only where glibc is; nothing else changes.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # another C library
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD) and mallopt(_M_TRIM_THRESHOLD, _TRIM_BYTES))


def give_back() -> None:
    """Return what is free to the system, for instance between two kinds of work."""
    if keep_freed_memory():
        ctypes.CDLL(None).malloc_trim(0)
