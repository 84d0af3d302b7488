"""How fast the suspension is simulated on one core, in plant steps per second, against ways to do without a batch.

Run it with `python benchmarks/simulation.py`; benchmarks/README.md says what is compared and keeps the last table.
Exits with 1 where contenders disagree about the physics and, with `--quick`, where a floor is missed.
"""
# ruff: noqa: E402

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_name] = "1"  # read once, when numpy and torch are loaded

import argparse
import json
import statistics
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import processes
import torch
from contenders import Array, Simulate, Task, batch, ivp_one_by_one, ivp_one_system, one_env, raw

from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import Integrator

Row = dict[str, Any]

PERIODS_MS = (1, 10)
BATCH, ENV, IVP, SYSTEM = "SuspensionBatch", "gymnasium, one env", "solve_ivp, one by one", "solve_ivp, one system"
NUMPY, TORCH = "step, numpy", "step, torch"

AGREEMENT_STEPS = 30
AGREEMENT_GAPS_M = np.linspace(0.005, 0.015, 8)
"""Contenders are compared while the magnets still move (after a whole episode all of them are at rest), clear of the
stops: half a millimetre from the rail RK4 itself is off by 1e-3."""

TOLERANCE = {ENV: 0.0, NUMPY: 1e-5, TORCH: 1e-5, IVP: 1e-5, SYSTEM: 1e-5}
"""Largest difference from the batch with the same integrator, in the scales of the observation.

The environment's actions are in single precision and so are the batch's here; the others compute voltages in double.
"""

FLOOR_STEPS_PER_S = {1: 20e6, 10: 35e6}
"""By control period in ms: what the batch with euler reaches at the least."""

FLOOR_RATIOS = {(1, ENV): 1000, (1, IVP): 500, (10, ENV): 1000, (10, IVP): 500}
"""By control period in ms and contender: how many times as fast as that the batch is at the least."""


@dataclass(frozen=True)
class Contender:
    """A way to simulate, and on how many of the episodes it is tried."""

    name: str
    integrator: Integrator
    episodes: int
    simulate: Simulate


def contenders(period_ms: int, steps: int, episodes: int, peer_episodes: int) -> list[Contender]:
    """Return everyone who competes at one control period; `solve_ivp` is held against the batch with rk4."""
    euler, rk4 = Task.of(period_ms, steps, "euler"), Task.of(period_ms, steps, "rk4")
    return [
        Contender(BATCH, "euler", episodes, batch(euler)),
        Contender(BATCH, "rk4", episodes, batch(rk4)),
        Contender(NUMPY, "euler", episodes, raw(euler, "numpy")),
        Contender(TORCH, "euler", episodes, raw(euler, "torch")),
        Contender(ENV, "euler", peer_episodes, one_env(euler)),
        Contender(IVP, "rk4", peer_episodes, ivp_one_by_one(rk4)),
        Contender(SYSTEM, "rk4", episodes, ivp_one_system(rk4)),
    ]


def starts(count: int) -> Array:
    """Return gaps over the whole range of starts, in an order of which every beginning is spread as well."""
    return np.random.default_rng(0).permutation(np.linspace(*Mdp().start_gap_m, count))


def differences(period_ms: int) -> dict[tuple[str, str], float]:
    """Return, by name and integrator, the largest difference in scaled states from the batch of that integrator.

    The batch with rk4 is held against the one with euler, which says how much the integrator is worth.
    """
    size = AGREEMENT_GAPS_M.size
    finals = {
        (one.name, one.integrator): one.simulate(AGREEMENT_GAPS_M)
        for one in contenders(period_ms, AGREEMENT_STEPS, size, size)
    }
    scale = Mdp().state_scale[:, None]
    return {
        (name, integrator): float(
            np.abs((final - finals[BATCH, "euler" if name == BATCH else integrator]) / scale).max()
        )
        for (name, integrator), final in finals.items()
    }


def measure(period_ms: int, steps: int, episodes: int, peer_episodes: int, rounds: int) -> list[Row]:
    """Return one row for each contender; they take turns, and each is charged the CPU time of this process."""
    gaps, apart = starts(episodes), differences(period_ms)
    field = contenders(period_ms, steps, episodes, min(episodes, peer_episodes))
    for one in field:
        one.simulate(gaps[:2])  # warm up
    spent: list[list[float]] = [[] for _ in field]
    for _ in range(rounds):
        for one, times in zip(field, spent, strict=True):
            before = time.process_time()
            one.simulate(gaps[: one.episodes])
            times.append(time.process_time() - before)
    return [
        {
            "period_ms": period_ms,
            "contender": one.name,
            "integrator": one.integrator,
            "episodes": one.episodes,
            "steps_per_s": one.episodes * steps / statistics.median(times),
            "slowest_per_s": one.episodes * steps / max(times),
            "fastest_per_s": one.episodes * steps / min(times),
            "all_episodes_s": statistics.median(times) * episodes / one.episodes,
            "difference": apart[one.name, one.integrator],
        }
        for one, times in zip(field, spent, strict=True)
    ]


def with_ratios(rows: list[Row]) -> list[Row]:
    """Add to every row how many times as fast the batch with the same integrator is."""
    rates = {(row["period_ms"], row["contender"], row["integrator"]): row["steps_per_s"] for row in rows}
    return [
        row | {"batch_over_it": rates[row["period_ms"], BATCH, row["integrator"]] / row["steps_per_s"]} for row in rows
    ]


def disagreements(rows: list[Row]) -> list[str]:
    """Return a sentence for every contender that does not simulate the same thing."""
    return [
        f"{row['contender']} at {row['period_ms']} ms ends {row['difference']:.2g} scales from the batch, "
        f"allowed: {TOLERANCE[row['contender']]:g}"
        for row in rows
        if row["contender"] in TOLERANCE and not row["difference"] <= TOLERANCE[row["contender"]]
    ]


def missed_floors(rows: list[Row]) -> list[str]:
    """Return a sentence for every floor that is not reached."""
    missed = []
    for row in rows:
        name, period, rate, ratio = row["contender"], row["period_ms"], row["steps_per_s"], row["batch_over_it"]
        floor = FLOOR_STEPS_PER_S[period] if (name, row["integrator"]) == (BATCH, "euler") else 0.0
        if rate < floor:
            missed.append(f"{name} at {period} ms makes {rate:,.0f} plant steps per second, floor: {floor:,.0f}")
        if ratio < FLOOR_RATIOS.get((period, name), 0):
            missed.append(
                f"the batch at {period} ms is {ratio:,.3g} times as fast as {name}, floor: {FLOOR_RATIOS[period, name]}"
            )
    return missed


def machine() -> dict[str, str]:
    """Return the processor and the versions that the numbers depend on."""
    found = processes.machine()
    return {
        **found,
        "cpu": f"{found['cpu']}, one thread used",
        **{name: version(name) for name in ("maglev-offline", "numpy", "scipy", "torch", "gymnasium")},
    }


def three_digits(number: float) -> str:
    """Return the number with three significant digits, never as a power of ten."""
    return f"{float(f'{number:.3g}'):,.{0 if number >= 100 else 2}f}"


def as_markdown(rows: list[Row]) -> str:
    """Return the table as benchmarks/README.md keeps it."""
    lines = [
        "| control period | contender | integrator | episodes run | plant steps per second (slowest to fastest run) "
        "| all episodes, CPU s | batch is faster, times | difference |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        name, integrator = row["contender"], "RK45" if "solve_ivp" in row["contender"] else row["integrator"]
        median, low, high = (three_digits(row[key]) for key in ("steps_per_s", "slowest_per_s", "fastest_per_s"))
        speed, ratio = f"{median} ({low} to {high})", "" if name == BATCH else three_digits(row["batch_over_it"])
        cells = (f"{row['period_ms']} ms", name, integrator, f"{row['episodes']:,}", speed)
        lines.append(f"| {' | '.join(cells)} | {row['all_episodes_s']:.3g} | {ratio} | {row['difference']:.1e} |")
    return "\n".join(lines)


def options(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line; sizes that are given win over those of `--quick`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three rounds instead of nine, and the floors must hold")
    parser.add_argument("--episodes", type=int, default=10_000)
    parser.add_argument("--steps", type=int, default=500, help="plant steps of 1 ms in an episode, a multiple of 10")
    parser.add_argument("--peer-episodes", type=int, default=10, help="how many of the episodes the slow peers run")
    parser.add_argument("--rounds", type=int, help="how often each contender runs, in turn with the others")
    parser.add_argument("--json", type=Path, help="write everything to this file as well")
    chosen = parser.parse_args(arguments)
    chosen.rounds = (3 if chosen.quick else 9) if chosen.rounds is None else chosen.rounds
    for name in ("episodes", "steps", "peer_episodes", "rounds"):
        if getattr(chosen, name) < 1:
            parser.error(f"--{name.replace('_', '-')} must be 1 or more, not {getattr(chosen, name)}")
    if chosen.steps % max(PERIODS_MS):
        parser.error(f"--steps must be a multiple of {max(PERIODS_MS)}, not {chosen.steps}")
    return chosen


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, judge; return the exit code."""
    chosen = options(arguments)
    torch.set_num_threads(1)
    about = machine()
    print("\n".join(f"{name}: {value}" for name, value in about.items()))
    print(
        f"\n{chosen.episodes:,} episodes of {chosen.steps} plant steps of 1 ms; median CPU time of {chosen.rounds} "
        "runs, the contenders in turn.\nWho ran fewer episodes is scaled per step. Difference: after "
        f"{AGREEMENT_STEPS} ms from the batch of the same\nintegrator, in scales of the observation "
        "(batch with rk4: from the one with euler).\n"
    )
    sizes = (chosen.steps, chosen.episodes, chosen.peer_episodes, chosen.rounds)
    rows = with_ratios([row for period_ms in PERIODS_MS for row in measure(period_ms, *sizes)])
    print(as_markdown(rows))
    complaints = disagreements(rows) + (missed_floors(rows) if chosen.quick else [])
    if chosen.json:
        text = json.dumps({"machine": about, "rows": rows, "complaints": complaints}, indent=2)
        chosen.json.write_text(text + "\n", encoding="utf-8")
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
