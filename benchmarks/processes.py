"""Contenders in processes of their own, on one thread, which print one line of JSON as their last; and the machine."""

import json
import os
import platform
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Row = dict[str, Any]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

NOT_INSTALLED = 3
"""What a contender exits with where a package that it needs is missing."""


def run_alone(command: list[str], longest_s: float, variables: Mapping[str, str] | None = None) -> Row | str:
    """Return what the process printed, or in words why it could not; `variables` join those of the environment."""
    extra = {**ONE_THREAD, **(variables or {})}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, env=os.environ | extra, timeout=longest_s, check=False
        )
    except subprocess.TimeoutExpired:
        return f"still at it after {longest_s} s"
    if done.returncode == NOT_INSTALLED:
        return f"not installed ({done.stderr.strip()})"
    if done.returncode != 0:
        return (done.stderr.strip().splitlines() or ["no message"])[-1]
    found: Row = json.loads(done.stdout.splitlines()[-1])
    return found


def machine() -> dict[str, str]:
    """Return the processor and the system that the numbers depend on."""
    cpu, info = platform.processor(), Path("/proc/cpuinfo")
    if info.exists():
        names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line[:10] == "model name"]
        cpu = names[0] if names else cpu
    return {
        "cpu": f"{cpu}, {os.cpu_count()} cores",
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
    }
