"""How fast logs are read and ingested on one core, against other readers, and how that grows with the log.

Run it with `python benchmarks/ingest.py`; benchmarks/README.md says what is compared and keeps the last table.
Exits with 1 where two readers disagree about a log and, with `--quick`, where a ratio is missed.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import processes
from ingest_logs import ENCODINGS, write_log
from ingest_peers import FLOOR, MCAP, MCAP_DEFAULT, MCAP_PARQUET, OURS, OURS_INGEST, RERUN, ROSBAGS
from processes import Row, run_alone

PEERS = Path(__file__).with_name("ingest_peers.py")
WARM_UP_MESSAGES = 6000
LONGEST_S = 1800
"""A reader that takes longer is said to hang."""

OURS_FOR = {MCAP: OURS, MCAP_DEFAULT: OURS, ROSBAGS: OURS, RERUN: OURS, FLOOR: OURS, MCAP_PARQUET: OURS_INGEST}
"""What each is held against."""

READS = {
    "cdr": (FLOOR, OURS, MCAP, MCAP_DEFAULT, ROSBAGS, RERUN, OURS_INGEST, MCAP_PARQUET),
    "protobuf": (FLOOR, OURS, MCAP, MCAP_DEFAULT, RERUN, OURS_INGEST, MCAP_PARQUET),
    "json": (FLOOR, OURS, MCAP, MCAP_DEFAULT, OURS_INGEST, MCAP_PARQUET),
}
"""Who can read what. rosbags knows ROS only, and rerun-sdk makes no row of JSON."""

SLOW = (MCAP, MCAP_DEFAULT, MCAP_PARQUET, ROSBAGS)
"""They run on fewer messages where `--peer-messages` says so."""

RATIOS = {
    ("cdr", MCAP): 40,
    ("protobuf", MCAP): 15,
    ("json", MCAP): 6,
    ("cdr", MCAP_PARQUET): 20,
    ("protobuf", MCAP_PARQUET): 10,
    ("json", MCAP_PARQUET): 5,
}
"""By encoding and peer: how many times as fast as that ours is at the least, in CPU time for a message."""

GROWTH = (1, 4, 16)
GROWTH_TIME, GROWTH_MEMORY, MOST_BYTES = 1.25, 1.25, 500e6
"""From 4x to 16x the CPU time for a message and the peak memory grow by these factors at most; the most of memory."""


class Sizes(NamedTuple):
    """Numbers of messages and of rounds."""

    messages: int
    peer_messages: int
    growth_messages: int
    rounds: int


class Runner(NamedTuple):
    """Runs readers in processes of their own; `logs` is where the logs lie."""

    logs: Path
    peer_python: str

    def log(self, encoding: str, messages: int) -> Path:
        """Return a log of so many messages; it is written where it is not there yet."""
        path = self.logs / f"{encoding}-{messages}.mcap"
        write_log(path, encoding, messages)
        return path

    def run(self, name: str, encoding: str, messages: int) -> Row | str:
        """Return what one reader took for one log, or why it could not."""
        python = self.peer_python if name in (ROSBAGS, RERUN) else sys.executable
        log, warm_up = self.log(encoding, messages), self.log(encoding, WARM_UP_MESSAGES)
        command = [python, str(PEERS), name, str(log), "--warm-up", str(warm_up)]
        found = run_alone(command, LONGEST_S)
        if not isinstance(found, str) and found["messages"] != messages:
            return f"{found['messages']:,} of {messages:,} messages"
        return found


def measure(runner: Runner, encoding: str, sizes: Sizes) -> list[Row]:
    """Return one row for each reader of an encoding; they take turns, each is charged the CPU time of its process."""
    of = {name: sizes.peer_messages if name in SLOW else sizes.messages for name in READS[encoding]}
    spent: dict[str, list[Row]] = {name: [] for name in of}
    failed: dict[str, str] = {}
    for _ in range(sizes.rounds):
        for name, messages in of.items():
            if name in failed:
                continue
            done = runner.run(name, encoding, messages)
            if isinstance(done, str):
                failed[name] = done
            else:
                spent[name].append(done)
    rows = []
    for name, messages in of.items():
        row: Row = {"encoding": encoding, "reader": name, "messages": messages, "failure": failed.get(name, "")}
        if not row["failure"]:
            times = [one["cpu_s"] for one in spent[name]]
            row |= {
                "ns_per_message": statistics.median(times) / messages * 1e9,
                "slowest_ns": max(times) / messages * 1e9,
                "fastest_ns": min(times) / messages * 1e9,
                "all_messages_s": statistics.median(times) / messages * sizes.messages,
                "peak_bytes": max(one["peak_bytes"] for one in spent[name]),
                "digest": spent[name][0]["digest"],
            }
        rows.append(row)
    return rows


def with_ratios(rows: list[Row]) -> list[Row]:
    """Add to every row how many times as fast ours is; below 1 it is slower."""
    took = {(row["encoding"], row["reader"]): row.get("ns_per_message") for row in rows}
    found = []
    for row in rows:
        ours = took.get((row["encoding"], OURS_FOR.get(row["reader"], "")))
        own = row.get("ns_per_message")
        found.append(row | {"ours_is_faster": own / ours if own and ours else None})
    return found


def grow(runner: Runner, sizes: Sizes) -> list[Row]:
    """Return CPU time and peak memory of an ingest of 1x, 4x and 16x the messages; of the times, the median."""
    spent: dict[int, list[Row]] = {times: [] for times in GROWTH}
    for _ in range(sizes.rounds):
        for times in GROWTH:
            done = runner.run(OURS_INGEST, "cdr", times * sizes.growth_messages)
            if isinstance(done, str):
                return [{"times": times, "failure": done}]
            spent[times].append(done)
    return [
        {
            "times": times,
            "messages": times * sizes.growth_messages,
            "file_bytes": runner.log("cdr", times * sizes.growth_messages).stat().st_size,
            "cpu_s": statistics.median(one["cpu_s"] for one in spent[times]),
            "peak_bytes": max(one["peak_bytes"] for one in spent[times]),
            "failure": "",
        }
        for times in GROWTH
    ]


def disagreements(rows: list[Row]) -> list[str]:
    """Return a sentence for every reader that makes other numbers of a log than most do, or fails without excuse."""
    complaints = []
    for encoding in dict.fromkeys(row["encoding"] for row in rows):
        digests = {row["reader"]: row["digest"] for row in rows if row["encoding"] == encoding and row.get("digest")}
        most = statistics.mode(digests.values()) if digests else ""
        complaints += [
            f"{name} reads other numbers from the {encoding} log than the others"
            for name, own in digests.items()
            if own != most
        ]
    complaints += [
        f"{row['reader']} on {row['encoding']}: {row['failure']}"
        for row in rows
        if row["failure"] and row["reader"] not in (ROSBAGS, RERUN)
    ]
    return complaints


def missed_ratios(rows: list[Row]) -> list[str]:
    """Return a sentence for every ratio that is not reached."""
    return [
        f"{OURS_FOR[row['reader']]} on {row['encoding']} is {row['ours_is_faster']:.3g} times as fast as "
        f"{row['reader']}, wanted: {RATIOS[row['encoding'], row['reader']]}"
        for row in rows
        if row.get("ours_is_faster") and row["ours_is_faster"] < RATIOS.get((row["encoding"], row["reader"]), 0)
    ]


def missed_growth(rows: list[Row]) -> list[str]:
    """Return a sentence where an ingest takes more than linear time, or memory that grows."""
    failures = [f"ingest of {row['times']}x: {row['failure']}" for row in rows if row["failure"]]
    if failures or not rows:
        return failures
    complaints = []
    _, some, most = rows
    time_grows = most["cpu_s"] / most["messages"] / (some["cpu_s"] / some["messages"])
    if time_grows > GROWTH_TIME:
        complaints.append(f"a message of 16x takes {time_grows:.3g} times as long as one of 4x, at most: {GROWTH_TIME}")
    memory_grows = most["peak_bytes"] / some["peak_bytes"]
    if memory_grows > GROWTH_MEMORY:
        complaints.append(f"16x takes {memory_grows:.3g} times the memory of 4x, at most: {GROWTH_MEMORY}")
    if most["peak_bytes"] > MOST_BYTES:
        complaints.append(f"16x takes {most['peak_bytes'] / 1e6:.0f} MB of memory, at most: {MOST_BYTES / 1e6:.0f}")
    return complaints


def machine(peer_python: str) -> dict[str, str]:
    """Return the processor and the versions that the numbers depend on."""
    own = ("maglev-offline", "mcap", "mcap-ros2-support", "mcap-protobuf-support", "numpy", "pyarrow", "zstandard")
    return {
        **processes.machine(),
        **{name: _version(name, sys.executable) for name in own},
        **{name: _version(name, peer_python) for name in ("rosbags", "rerun-sdk")},
    }


def _version(name: str, python: str) -> str:
    if python == sys.executable:
        try:
            return version(name)
        except PackageNotFoundError:
            return "not installed"
    code = f"from importlib.metadata import version; print(version({name!r}))"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else "not installed"


def as_markdown(rows: list[Row]) -> str:
    """Return the table of readers as benchmarks/README.md keeps it."""
    lines = [
        "| log | reader | messages run | ns per message (fastest to slowest run) | all messages, CPU s "
        "| peak memory, MB | ours is faster, times | wanted |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [row["encoding"], row["reader"], f"{row['messages']:,}"]
        if row["failure"]:
            cells += [row["failure"], "", "", "", ""]
        else:
            speed = f"{row['ns_per_message']:,.0f} ({row['fastest_ns']:,.0f} to {row['slowest_ns']:,.0f})"
            ratio = f"{row['ours_is_faster']:.3g}" if row["ours_is_faster"] else ""
            wanted = str(RATIOS.get((row["encoding"], row["reader"]), ""))
            cells += [speed, f"{row['all_messages_s']:.3g}", f"{row['peak_bytes'] / 1e6:.0f}", ratio, wanted]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def growth_as_markdown(rows: list[Row]) -> str:
    """Return the table of growth."""
    lines = [
        "| size | messages | file, MB | CPU s | ns per message | peak memory, MB |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        if row["failure"]:
            lines.append(f"| {row['times']}x | {row['failure']} | | | | |")
        else:
            cells = (
                f"{row['times']}x",
                f"{row['messages']:,}",
                f"{row['file_bytes'] / 1e6:.0f}",
                f"{row['cpu_s']:.3g}",
                f"{row['cpu_s'] / row['messages'] * 1e9:,.0f}",
                f"{row['peak_bytes'] / 1e6:.0f}",
            )
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def options(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line; sizes that are given win over those of `--quick`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="slow peers on a tenth, and the ratios must be reached")
    parser.add_argument("--messages", type=int, default=2_160_000, help="default: an hour of 60 points at 10 Hz")
    parser.add_argument("--peer-messages", type=int, help="how many messages the slow peers read")
    parser.add_argument("--growth-messages", type=int, help="messages of the 1x log of the growth; 0 leaves it out")
    parser.add_argument("--rounds", type=int, help="how often each reader runs, in turn with the others")
    parser.add_argument("--encodings", nargs="+", choices=ENCODINGS, default=list(ENCODINGS))
    parser.add_argument("--peer-python", default=sys.executable, help="an interpreter with rosbags and rerun-sdk")
    parser.add_argument("--logs", type=Path, help="keep the logs in this folder, and use those that are there")
    parser.add_argument("--json", type=Path, help="write everything to this file as well")
    chosen = parser.parse_args(arguments)
    if chosen.peer_messages is None:
        chosen.peer_messages = chosen.messages // 10 if chosen.quick else chosen.messages
    if chosen.growth_messages is None:
        chosen.growth_messages = 120_000 if chosen.quick else 1_200_000
    if chosen.rounds is None:
        chosen.rounds = 3 if chosen.quick else 5
    for name, least in (("messages", 600), ("peer_messages", 600), ("growth_messages", 0), ("rounds", 1)):
        if getattr(chosen, name) < least:
            parser.error(f"--{name.replace('_', '-')} must be {least} or more, not {getattr(chosen, name)}")
    return chosen


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, judge; return the exit code."""
    chosen = options(arguments)
    began = time.monotonic()
    about = machine(chosen.peer_python)
    print("\n".join(f"{name}: {value}" for name, value in about.items()))
    sizes = Sizes(chosen.messages, chosen.peer_messages, chosen.growth_messages, chosen.rounds)
    print(
        f"\n{sizes.messages:,} messages of 7 float64, a stamp and a uint32 on 60 topics; median CPU time of "
        f"{sizes.rounds} runs, each in a process of its own, the readers in turn."
    )
    if sizes.peer_messages != sizes.messages:
        names = ", ".join(f"«{name}»" for name in SLOW)
        print(f"{names} read {sizes.peer_messages:,} messages and are scaled per message.")
    print(flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        logs = chosen.logs or Path(scratch)
        logs.mkdir(parents=True, exist_ok=True)
        runner = Runner(logs, chosen.peer_python)
        rows = with_ratios([row for encoding in chosen.encodings for row in measure(runner, encoding, sizes)])
        growth = grow(runner, sizes) if sizes.growth_messages else []
    print(as_markdown(rows))
    if growth:
        print(f"\nGrowth of «{OURS_INGEST}» on cdr:\n\n{growth_as_markdown(growth)}")
    print(f"\nTook {time.monotonic() - began:.0f} s in all.")
    complaints = disagreements(rows)
    if chosen.quick:
        complaints += missed_ratios(rows) + missed_growth(growth)
    if chosen.json:
        content = {"machine": about, "rows": rows, "growth": growth, "complaints": complaints}
        chosen.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
