"""How fast agents are trained on one core, against other libraries, and what the published study takes.

Run it with `python benchmarks/training.py`; benchmarks/README.md says what is compared and keeps the last table.
Exits with 1 where someone does not do the work that is compared and, with `--quick`, where a ratio is missed.
"""

import argparse
import json
import os
import statistics
import sys
import time
from pathlib import Path
from typing import NamedTuple

import processes
from processes import Row, run_alone
from training_peers import (
    BATCH,
    ENVIRONMENT,
    HIDDEN,
    LOOP,
    NATIVE,
    PEAK,
    PEAK_SIZE,
    SB3,
    SBX,
    SCALING,
    STUDY,
    STUDY_ROWS,
    TORCH,
    TORCH_SEEDS,
)

ROOT = Path(__file__).parents[1]
PEERS = Path(__file__).with_name("training_peers.py")
ISA_VARIABLE = "MAGLEV_OFFLINE_ISA"
WARM_UP_STEPS = 200
LONGEST_S = 1800
"""A contender that takes longer is said to hang."""

ALGORITHMS = ("ddpg", "td3")
OTHERS = (SB3, SBX, LOOP, ENVIRONMENT)
"""They run with `--peer-python`."""

RATIOS = {
    (f"{NATIVE} avx512", SB3): 50,
    (f"{NATIVE} avx512", SBX): 15,
    (f"{NATIVE} avx2", SB3): 30,
    (f"{NATIVE} avx2", SBX): 9,
    (TORCH, SB3): 10,
}
"""By contender and peer: how many times as many gradient steps a second of CPU time gives, at the least."""

STUDY_RUNS, STUDY_STEPS, STUDY_MOST_MIN = 200, 500_000, 45
"""2 algorithms, 2 arms, 50 seeds; wanted: not more minutes than this on two cores, evaluation included."""


class Contender(NamedTuple):
    """A way to train: its name in tables and in `training_peers.py`, steps on the clock, and what else it is told."""

    title: str
    name: str
    steps: int
    isa: str = ""
    rows: int = 0


class Runner(NamedTuple):
    """Runs contenders in processes of their own."""

    peer_python: str

    def run(self, one: Contender, algorithm: str) -> Row | str:
        """Return what it took, or why it could not."""
        python = self.peer_python if one.name in OTHERS else sys.executable
        command = [python, str(PEERS), one.name, algorithm, "--steps", str(one.steps), "--rows", str(one.rows)]
        command += ["--warm-up", str(min(one.steps, WARM_UP_STEPS))]
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        extra = {"PYTHONPATH": path, **({ISA_VARIABLE: one.isa} if one.isa else {})}
        found = run_alone(command, LONGEST_S, extra)
        if isinstance(found, str):
            return found
        wanted = 0 if one.name == ENVIRONMENT else one.steps
        if one.name != PEAK and found["updates"] != wanted:
            return f"{found['updates']:,} gradient steps instead of {wanted:,}"
        return found


def multiply_adds(algorithm: str) -> int:
    """Multiply-adds of the matrix products of one gradient step, for one row of the batch.

    Forward, an actor has 3 h + h h + h of them and a critic, whose second layer sees the action, h more. Backward,
    gradients of the weights cost as much as the way forward, and gradients of the activations as much without the
    first layer. The actor's gradient goes through a critic down to the action only. Adam, tanh, batch statistics, the
    environment and the random numbers are not counted.
    """
    h = HIDDEN
    actor, critic, below = 3 * h + h * h + h, 3 * h + (h + 1) * h + h, h * h + h
    critics, delay = (2, 2) if algorithm == "td3" else (1, 1)
    target = actor + critics * critic
    descend_critics = critics * (2 * critic + below)
    descend_actor = actor + critic + (h + h) + actor + below
    return target + descend_critics + descend_actor // delay


def flops(algorithm: str) -> int:
    """Floating-point operations of one gradient step of one seed."""
    return 2 * BATCH * multiply_adds(algorithm)


def contenders(isas: list[str], steps: int, peer_steps: int) -> list[Contender]:
    """Return everyone who competes; of `isas`, slowest first, the last is also run on a full buffer."""
    native = [Contender(f"{NATIVE} {isa}", NATIVE, steps, isa) for isa in isas]
    if isas:
        title = f"{NATIVE} {isas[-1]}, {STUDY_ROWS:,} rows in the buffer"
        native.append(Contender(title, NATIVE, steps, isas[-1], STUDY_ROWS))
    return [
        *native,
        Contender(TORCH, TORCH, max(1, peer_steps // 4)),
        Contender(LOOP, LOOP, peer_steps),
        Contender(SB3, SB3, peer_steps),
        Contender(SBX, SBX, peer_steps),
        Contender(ENVIRONMENT, ENVIRONMENT, peer_steps),
    ]


def measure(runner: Runner, field: list[Contender], algorithms: list[str], rounds: int) -> list[Row]:
    """Return one row for each contender and algorithm; they take turns, each is charged its process's CPU time."""
    pairs = [(algorithm, one) for algorithm in algorithms for one in field]
    spent: dict[tuple[str, Contender], list[Row]] = {pair: [] for pair in pairs}
    failed: dict[tuple[str, Contender], str] = {}
    for _ in range(rounds):
        for algorithm, one in pairs:
            if (algorithm, one) in failed:
                continue
            done = runner.run(one, algorithm)
            if isinstance(done, str):
                failed[algorithm, one] = done
            else:
                spent[algorithm, one].append(done)
    rows = []
    for algorithm, one in pairs:
        row: Row = {
            "algorithm": algorithm,
            "contender": one.title,
            "name": one.name,
            "failure": failed.get((algorithm, one), ""),
        }
        if not row["failure"]:
            runs = spent[algorithm, one]
            rates = [run["seeds"] * run["steps"] / run["cpu_s"] for run in runs]
            row |= {
                "steps": one.steps * runs[0]["seeds"],
                "steps_per_s": statistics.median(rates),
                "slowest_per_s": min(rates),
                "fastest_per_s": max(rates),
                "versions": runs[0]["versions"],
                "about": runs[0]["more"],
            }
        rows.append(row)
    return rows


def with_ratios(rows: list[Row], peak_flops: float | None) -> list[Row]:
    """Add to every row how many times as fast as each peer it is, and its share of the core's peak."""
    rates = {(row["algorithm"], row["contender"]): row.get("steps_per_s") for row in rows}
    found = []
    for row in rows:
        own = row.get("steps_per_s")
        peers = {peer: rates.get((row["algorithm"], peer)) for peer in (SB3, SBX, LOOP)}
        share = (
            own * flops(row["algorithm"]) / peak_flops if own and peak_flops and row["name"] != ENVIRONMENT else None
        )
        found.append(
            row
            | {
                "times": {peer: own / rate if own and rate else None for peer, rate in peers.items()},
                "share_of_peak": share,
            }
        )
    return found


def missed_ratios(rows: list[Row]) -> list[str]:
    """Return a sentence for every ratio that is not reached or could not be measured."""
    complaints = []
    for row in rows:
        for (contender, peer), wanted in RATIOS.items():
            if row["contender"] != contender or row["failure"]:
                continue
            times = row["times"][peer]
            if times is None:
                complaints.append(f"{row['algorithm']}: {contender} has no {peer} to be held against")
            elif times < wanted:
                complaints.append(
                    f"{row['algorithm']}: {contender} is {times:.3g} times as fast as {peer}, wanted: {wanted}"
                )
    return complaints


def failures(rows: list[Row]) -> list[str]:
    """Return a sentence for everyone who failed, but for peers that are not installed."""
    return [
        f"{row['algorithm']}: {row['contender']}: {row['failure']}"
        for row in rows
        if row["failure"] and not (row["name"] in OTHERS and row["failure"].startswith("not installed"))
    ]


def scale(runner: Runner, isa: str, steps: int, rounds: int) -> Row | str:
    """Return how much faster two seeds are on two threads than on one, in wall time; the best round of each counts."""
    runs = []
    for _ in range(rounds):
        done = runner.run(Contender(SCALING, SCALING, steps, isa), "td3")
        if isinstance(done, str):
            return done
        runs.append(done["more"])
    one, two = (min(run[key] for run in runs) for key in ("one_thread_s", "two_threads_s"))
    return {"one_thread_s": one, "two_threads_s": two, "times": one / two}


def extrapolate(runner: Runner, steps: int, rounds: int) -> Row | str:
    """Return minutes for the published study from a part of it, runs of so many steps, made several times.

    Wall time is that of two processes on two cores, median and least. Least CPU time, halved, is what they take where
    nothing else is on the machine or its host: what shares a core or its caches makes a CPU second worth less, never
    more.
    """
    runs = []
    for _ in range(rounds):
        done = runner.run(Contender(STUDY, STUDY, steps, rows=STUDY_ROWS), ALGORITHMS[0])
        if isinstance(done, str):
            return done
        runs.append(done)
    times = STUDY_RUNS * STUDY_STEPS / (runs[0]["seeds"] * steps) / 60
    start_min = statistics.median(run["more"]["start_s"] for run in runs) / 60
    wall_min = [start_min + times * run["wall_s"] for run in runs]
    return {
        "steps": steps,
        "seeds": runs[0]["seeds"],
        "about": runs[0]["more"],
        "runs": [{"wall_s": run["wall_s"], "cpu_s": run["cpu_s"]} for run in runs],
        "study_min": statistics.median(wall_min),
        "study_least_min": min(wall_min),
        "study_undisturbed_min": start_min + times * min(run["cpu_s"] for run in runs) / 2,
    }


def peak_of_core(runner: Runner, rounds: int) -> float | None:
    """Return floating-point operations a second of one core in numpy's sgemm, the best of several runs."""
    runs = [runner.run(Contender(PEAK, PEAK, 10), ALGORITHMS[0]) for _ in range(rounds)]
    rates = [run["more"]["flops"] / run["cpu_s"] for run in runs if not isinstance(run, str)]
    return max(rates, default=None)


def instruction_sets() -> list[str]:
    """Return the names of the kernel's instruction sets that this processor has, slowest first; none without it."""
    sys.path.insert(0, str(ROOT))
    try:
        from maglev_offline.agents.native_library import isas
    finally:
        sys.path.remove(str(ROOT))
    return [isa.name for isa in isas() if isa.runs_here]


def machine() -> dict[str, str]:
    """Return the processor and the system that the numbers depend on."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {**processes.machine(), "load average at the start": load}


def all_versions(rows: list[Row]) -> dict[str, str]:
    """Return the versions that the contenders ran with; where they differ, both."""
    found: dict[str, list[str]] = {}
    for row in rows:
        for name, number in row.get("versions", {}).items():
            found.setdefault(name, []).append(number)
        if row["name"] == NATIVE and row.get("about"):
            found.setdefault("kernel", []).append(row["about"]["compiler"])
    return {name: " and ".join(dict.fromkeys(numbers)) for name, numbers in found.items()}


def as_markdown(rows: list[Row]) -> str:
    """Return the table as benchmarks/README.md keeps it."""
    lines = [
        "| algorithm | contender | steps run | gradient steps per CPU second (slowest to fastest run) "
        f"| of the core's peak | {SB3}, times | {SBX}, times | {LOOP}, times |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [row["algorithm"], row["contender"]]
        if row["failure"]:
            cells += [row["failure"], *[""] * 5]
        else:
            rates = (row["steps_per_s"], row["slowest_per_s"], row["fastest_per_s"])
            median, slowest, fastest = (f"{rate:,.0f}" for rate in rates)
            share = f"{row['share_of_peak']:.1%}" if row["share_of_peak"] else ""
            cells += [f"{row['steps']:,}", f"{median} ({slowest} to {fastest})", share]
            cells += [_times(row, peer) for peer in (SB3, SBX, LOOP)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _times(row: Row, peer: str) -> str:
    times, wanted = row["times"][peer], RATIOS.get((row["contender"], peer))
    if times is None or row["contender"] == peer:
        return ""
    return f"{times:.3g}" + (f" (wanted: {wanted})" if wanted else "")


def in_words(scaled: Row | str, study: Row | str, peak_flops: float | None) -> list[str]:
    """Return what there is to say beside the table."""
    work = ", ".join(f"{name} {flops(name) / 1e6:.2f} million" for name in ALGORITHMS)
    lines = [f"Floating-point operations of the matrix products of a gradient step: {work}."]
    if peak_flops:
        lines.append(
            f"The core's peak: {peak_flops / 1e9:.0f} GFLOP/s (numpy's float32 product of {PEAK_SIZE} x {PEAK_SIZE})."
        )
    if isinstance(scaled, str):
        lines.append(f"Two threads: {scaled}.")
    else:
        lines.append(f"Two seeds of td3 on two threads take 1/{scaled['times']:.2f} of the wall time of one thread.")
    if isinstance(study, str):
        lines.append(f"The published study: {study}.")
    else:
        lines.append(
            f"The published study ({STUDY_RUNS} runs of {STUDY_STEPS:,} steps, native engine with "
            f"{study['about']['instruction_set']}, evaluation and checkpoints included) would take "
            f"{study['study_min']:.0f} min of wall time on two cores (median; least: "
            f"{study['study_least_min']:.0f}), and "
            f"{study['study_undisturbed_min']:.0f} min (half its least CPU time) if nothing else ran; extrapolated "
            f"from {study['seeds']} runs of {study['steps']:,} steps, made {len(study['runs'])} times, buffers holding "
            f"{STUDY_ROWS:,} rows more. "
            f"Wanted: under {STUDY_MOST_MIN} min."
        )
    return lines


def missed_study(scaled: Row | str, study: Row | str) -> list[str]:
    """Return a sentence where the study takes too long, or could not be tried. Half the least CPU time is judged:
    a busy machine makes any wall time."""
    complaints = [f"two threads: {scaled}"] if isinstance(scaled, str) else []
    if isinstance(study, str):
        complaints.append(f"the study: {study}")
    elif not study["study_undisturbed_min"] < STUDY_MOST_MIN:
        complaints.append(f"the study takes {study['study_undisturbed_min']:.0f} min, wanted: under {STUDY_MOST_MIN}")
    return complaints


def options(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line; sizes that are given win over those of `--quick`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="shorter runs, and the ratios must be reached")
    parser.add_argument("--steps", type=int, help="gradient steps of the native engine on the clock")
    parser.add_argument("--peer-steps", type=int, help="gradient steps of everyone else on the clock")
    parser.add_argument("--study-steps", type=int, help="steps of a run in the part of the study; 0 leaves it out")
    parser.add_argument("--algorithms", nargs="+", choices=ALGORITHMS, default=list(ALGORITHMS))
    parser.add_argument("--only", nargs="+", default=[""], help="contenders by the beginning of their names")
    parser.add_argument("--rounds", type=int, help="how often each contender runs, in turn with the others")
    parser.add_argument("--peer-python", default=sys.executable, help="an interpreter with the peers in it")
    parser.add_argument("--json", type=Path, help="write everything to this file as well")
    chosen = parser.parse_args(arguments)
    defaults = {
        "steps": (20_000, 100_000),
        "peer_steps": (1_000, 5_000),
        "study_steps": (25_000, 100_000),
        "rounds": (3, 5),
    }
    for name, (quick, thorough) in defaults.items():
        if getattr(chosen, name) is None:
            setattr(chosen, name, quick if chosen.quick else thorough)
    for name, least in (("steps", 100), ("peer_steps", 100), ("study_steps", 0), ("rounds", 1)):
        if getattr(chosen, name) < least:
            parser.error(f"--{name.replace('_', '-')} must be {least} or more, not {getattr(chosen, name)}")
    return chosen


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, judge; return the exit code."""
    chosen = options(arguments)
    began = time.monotonic()
    runner, isas = Runner(chosen.peer_python), instruction_sets()
    about = machine()
    peak_flops = peak_of_core(runner, chosen.rounds)
    everyone = contenders(isas, chosen.steps, chosen.peer_steps)
    field = [one for one in everyone if one.title.startswith(tuple(chosen.only))]
    rows = with_ratios(measure(runner, field, chosen.algorithms, chosen.rounds), peak_flops)
    scaled: Row | str = "left out" if isas else "the native engine is not there"
    study: Row | str = scaled
    if isas and NATIVE in {one.name for one in field}:
        scaled = scale(runner, isas[-1], chosen.steps, chosen.rounds)
    if not isinstance(scaled, str) and chosen.study_steps:
        study = extrapolate(runner, chosen.study_steps, chosen.rounds)
    about |= all_versions(rows)
    print("\n".join(f"{name}: {value}" for name, value in about.items()))
    print(
        f"\nOne environment step with a control period of 10 ms and one gradient step of {BATCH} rows on networks of "
        f"{HIDDEN} and {HIDDEN}; median of {chosen.rounds} runs,\neach in a process of its own on one core, in turn. "
        f"The torch engine steps {TORCH_SEEDS} seeds at once, everyone else one.\n"
    )
    print(as_markdown(rows), "", *in_words(scaled, study, peak_flops), sep="\n")
    print(f"\nTook {time.monotonic() - began:.0f} s in all.")
    complaints = failures(rows)
    if chosen.quick:
        complaints += ([] if isas else ["the native engine is not there"]) + missed_ratios(rows)
        complaints += missed_study(scaled, study) if chosen.study_steps else []
    if chosen.json:
        content = {"machine": about, "rows": rows, "scaling": scaled, "study": study, "complaints": complaints}
        chosen.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
