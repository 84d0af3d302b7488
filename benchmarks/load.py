"""A day of a train, 60 suspension points and 650,000 samples of each, ingested and curated: as one log, and as 2,000.

Run it with `python benchmarks/load.py --folder DIR`, on a disk with 30 GB free. It takes an hour; logs that are in the
folder already are not written again. `--share 0.01` does it with a hundredth of the day. Prints the table of
docs/scale.md: time, memory and disk of a sixteenth, a quarter and all of the day, against what the first foretells.
Exits with 1 where a message is lost, where the whole takes more than 1.3 times the CPU time that the first part
foretells, or where the processes hold more than 6 GB together.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import processes
from ingest_logs import POINTS
from load_logs import write_day
from processes import Row

TICKS = 650_000
"""Samples of a point in a day of 18 hours."""

LOGS = 2_000
PARTS = (1 / 16, 1 / 4, 1.0)
MOST_TIMES = 1.3
"""What the whole may take for a message, over what the first part takes."""

MOST_BYTES = 6e9

MB = 1e6
WATCH_S = 0.25
HEAD = ("logs", "messages", "logs, MB", "processes", "wall s", "CPU s", "ns of CPU per message", "over the prediction",
        "peak memory, MB", "workspace, MB", "peak disk, MB")  # fmt: skip


def written(folder: Path, part: float, ticks: int, logs: int) -> tuple[list[Path], int]:
    """The first part of the day, as one log or in many; the logs and how many messages they hold."""
    folder.mkdir(parents=True, exist_ok=True)
    if logs == 1:
        mine = round(ticks * part)
        path = folder / f"day-{mine}.mcap"
        write_day(path, mine)
        return [path], mine * POINTS
    each, count = max(1, ticks // logs), max(1, round(logs * part))
    paths = [folder / f"part-{each}-{number:04d}.mcap" for number in range(count)]
    for number, path in enumerate(paths):
        write_day(path, each, number * each)
    return paths, count * each * POINTS


def watched(command: list[str], workspace: Path) -> Row:
    """Run a command; wall and CPU time of it and its workers, and the most memory and disk that they took at once."""
    peaks = {"memory": 0, "disk": 0}
    started, before = time.perf_counter(), os.times()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    done = threading.Event()

    def watch() -> None:
        while not done.wait(WATCH_S):
            peaks["memory"] = max(peaks["memory"], sum(map(_memory_of, _family(process.pid))))
            peaks["disk"] = max(peaks["disk"], _size_of(workspace))

    watcher = threading.Thread(target=watch)
    watcher.start()
    out, err = process.communicate()
    done.set()
    watcher.join()
    after = os.times()
    if process.returncode != 0:
        sys.exit(f"{' '.join(command[:6])} ... ended with {process.returncode}: {err[-500:]}")
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    wall_s = time.perf_counter() - started
    return {"wall_s": wall_s, "cpu_s": cpu_s, **peaks, "said": json.loads(out)}


def _family(process: int) -> list[int]:
    """A process and all that it started."""
    found = [process]
    for one in found:
        try:
            for thread in Path(f"/proc/{one}/task").iterdir():
                found += [int(child) for child in (thread / "children").read_text().split()]
        except OSError:  # it has ended
            continue
    return found


def _memory_of(process: int) -> int:
    """Bytes of a process; what it shares with others counts by its share."""
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in text.splitlines() if line.startswith("Pss:")), 0)


def _size_of(folder: Path) -> int:
    total = 0
    for home, _, names in os.walk(folder):
        for name in names:
            try:
                total += (Path(home) / name).stat().st_size
            except OSError:
                continue
    return total


def ingest(logs: list[Path], messages: int, workspace: Path, jobs: int) -> Row:
    """Ingest logs into a new workspace, and look whether every message is used: nothing is wrong with any."""
    shutil.rmtree(workspace, ignore_errors=True)
    command = [sys.executable, "-m", "maglev_offline", "ingest", *map(str, logs), "--workspace", str(workspace)]
    row = watched([*command, "--jobs", str(jobs), "--json"], workspace)
    manifests = [json.loads(path.read_text()) for path in workspace.glob("samples/*/manifest.json")]
    counts = [manifest["counts"] for manifest in manifests]
    used = sum(count["messages_used"] for count in counts)
    row |= {
        "logs": len(logs),
        "messages": messages,
        "jobs": jobs,
        "log_bytes": sum(path.stat().st_size for path in logs),
        "workspace_bytes": _size_of(workspace),
        "whole": len(manifests) == len(logs) and sum(count["messages"] for count in counts) == used == messages,
        "rows": sum(count["rows"] for count in counts),
    }
    return row


def table(rows: list[Row]) -> list[str]:
    """The rows as Markdown."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    for row in rows:
        cells = (
            f"{row['logs']:,}", f"{row['messages']:,}", f"{row['log_bytes'] / MB:,.0f}", f"{row['jobs']}",
            f"{row['wall_s']:,.1f}", f"{row['cpu_s']:,.1f}", f"{1e9 * row['cpu_s'] / row['messages']:,.0f}",
            f"{row['times']:.2f}", f"{row['memory'] / MB:,.0f}", f"{row['workspace_bytes'] / MB:,.0f}",
            f"{row['disk'] / MB:,.0f}",
        )  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def complaints(rows: list[Row]) -> list[str]:
    """What the rows do not fulfil, in words."""
    found = []
    for row in rows:
        name = f"{row['logs']:,} logs, {row['messages']:,} messages, {row['jobs']} processes"
        if not row["whole"]:
            found.append(f"{name}: not every message is used")
        if row["times"] > MOST_TIMES:
            found.append(f"{name}: {row['times']:.2f} times the predicted time")
        if row["memory"] > MOST_BYTES:
            found.append(f"{name}: {row['memory'] / MB:,.0f} MB of memory")
    return found


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="where logs and workspaces go")
    parser.add_argument("--share", type=float, default=1.0, help="of the day's samples, and of the 2,000 logs")
    parser.add_argument("--jobs", type=int, nargs="+", default=[2])
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows: list[Row] = []
    for logs in (1, max(2, round(LOGS * given.share))):
        first: dict[int, Row] = {}
        for part in PARTS:
            started = time.perf_counter()
            paths, messages = written(given.folder / "logs", part, round(TICKS * given.share), logs)
            print(
                f"{len(paths)} logs, {messages:,} messages, written in {time.perf_counter() - started:.0f} s",
                flush=True,
            )
            for jobs in given.jobs:
                row = ingest(paths, messages, given.folder / "workspace", jobs)
                alone = first.setdefault(jobs, row)
                row["times"] = row["cpu_s"] / row["messages"] / (alone["cpu_s"] / alone["messages"])
                rows.append(row)
                print(f"  {jobs} processes: {row['wall_s']:.1f} s, {row['rows']:,} rows", flush=True)
    print("\n".join(["", *(f"{k}: {v}" for k, v in processes.machine().items()), "", *table(rows)]))
    if given.json:
        given.json.write_text(json.dumps([{k: v for k, v in row.items() if k != "said"} for row in rows], indent=1))
    wrong = complaints(rows)
    print(*wrong, sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
