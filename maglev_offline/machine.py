"""What the machine gives this process: cores and memory."""

import os
from pathlib import Path

MEMORY_FACTS = Path("/proc/meminfo")
CONTAINER_LIMIT = Path("/sys/fs/cgroup/memory.max")


def usable_cores() -> int:
    """Cores that this process may run on; all of the machine's where the system does not tell (macOS)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def total_memory_bytes() -> int:
    """Memory of the machine, or of the container where that has less."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    try:
        limit = int(CONTAINER_LIMIT.read_text())
    except (OSError, ValueError):  # no container, or one without a limit ("max")
        return machine
    return min(machine, limit)


def free_memory_bytes() -> int | None:
    """Memory that can be had without swapping, no more than the total; None where the system does not tell."""
    try:
        lines = dict(line.split(":", 1) for line in MEMORY_FACTS.read_text().splitlines())
        free = int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, ValueError, KeyError, IndexError):
        return None
    return min(free, total_memory_bytes())
