"""How long each balance takes for ten million rows on one core, its measures included, and how much memory.

Run it with `python benchmarks/curate.py`; benchmarks/README.md keeps the last table. Exits with 1 where a balance
takes longer or more memory than it may.
"""

import argparse
import json
import resource
import sys
import time
from importlib.metadata import version
from pathlib import Path

import processes
from processes import Row, run_alone

ROWS, QUICK_ROWS = 10_000_000, 1_000_000
MOST_S, MOST_BYTES = 60.0, 2e9
"""What a balance with its measures may take: CPU time, and peak memory of its whole process."""

LONGEST_S = 900
HEAD = ("balance", "rows chosen", "balance, CPU s", "measures, CPU s", "both, CPU s", "both, wall s", "peak memory, MB")


def candidates(rows: int):
    """Rows as a log has them: nine in ten near the set-point, with heavy tails, the others all over the place."""
    import numpy as np

    from maglev_offline.curate.balance import Candidates
    from maglev_offline.curate.balance.grid import bins_of, cells_of
    from maglev_offline.curate.settings import CurateSettings
    from maglev_offline.mdp import Mdp, row_cost
    from maglev_offline.streams import stream

    rng, settings, mdp = stream(0, "benchmark: candidates"), CurateSettings(), Mdp()
    values = np.empty((rows, 4))
    far = rng.random(rows) < 0.1
    for axis, (near, wide) in zip(values.T, ((2e-4, 2e-3), (5e-3, 5e-2), (0.3, 3.0), (3.0, 50.0)), strict=True):
        axis[:] = rng.standard_normal(rows)
        axis *= np.where(far, wide, near)
    np.clip(values[:, 0], -0.0075, 0.008, out=values[:, 0])
    np.clip(values[:, 3], -mdp.voltage_limit_v, mdp.voltage_limit_v, out=values[:, 3])
    started = time.process_time(), time.perf_counter()
    cell = cells_of(values, bins_of(settings), settings.edge_quantile)
    return Candidates(values, row_cost(mdp, values[:, :3], values[:, 3]), cell), started


def contender(name: str, rows: int) -> Row:
    """Balance and measure in this process."""
    import numpy  # noqa: F401
    import scipy.spatial
    import scipy.stats  # noqa: F401 - importing is not charged

    from maglev_offline.curate.balance import choose
    from maglev_offline.curate.measures import coverage_facts
    from maglev_offline.curate.measures.weights import importance_weights
    from maglev_offline.curate.settings import CurateSettings
    from maglev_offline.mdp import Mdp
    from maglev_offline.physics.parameters import Plant

    settings = CurateSettings.model_validate({"balance": name})
    found, (cpu_s, wall_s) = candidates(rows)
    chosen = choose(found, settings)
    balance_s = time.process_time() - cpu_s
    weight = importance_weights(found.cell, chosen)
    facts = coverage_facts(found, chosen, weight, settings, Plant(), Mdp())
    return {
        "balance": name,
        "chosen": len(chosen),
        "balance_s": balance_s,
        "measures_s": time.process_time() - cpu_s - balance_s,
        "cpu_s": time.process_time() - cpu_s,
        "wall_s": time.perf_counter() - wall_s,
        "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024),
        "facts": facts,
    }


def complaints(rows: list[Row | str]) -> list[str]:
    """Return a sentence for every limit that is passed."""
    found = [row for row in rows if isinstance(row, str)]
    for row in rows:
        if isinstance(row, str):
            continue
        if row["cpu_s"] > MOST_S:
            found.append(f"{row['balance']} takes {row['cpu_s']:.1f} s, at most {MOST_S:g} s are wanted")
        if row["peak_bytes"] > MOST_BYTES:
            found.append(f"{row['balance']} takes {row['peak_bytes'] / 1e6:,.0f} MB, at most {MOST_BYTES / 1e6:,.0f}")
    return found


def as_markdown(rows: list[Row | str]) -> str:
    """Return the table as benchmarks/README.md keeps it."""
    lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for row in rows:
        if isinstance(row, str):
            continue
        seconds = (f"{row[key]:.1f}" for key in ("balance_s", "measures_s", "cpu_s", "wall_s"))
        cells = (row["balance"], f"{row['chosen']:,}", *seconds, f"{row['peak_bytes'] / 1e6:,.0f}")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def options(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_ROWS:,} rows instead of {ROWS:,}")
    parser.add_argument("--rows", type=int, help="so many rows")
    parser.add_argument("--json", type=Path, help="write everything to this file as well")
    parser.add_argument("--contender", help="run this balance alone, in this process, and print JSON")
    chosen = parser.parse_args(arguments)
    chosen.rows = (QUICK_ROWS if chosen.quick else ROWS) if chosen.rows is None else chosen.rows
    if chosen.rows < 1:
        parser.error(f"--rows must be 1 or more, not {chosen.rows}")
    return chosen


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, judge; return the exit code."""
    chosen = options(arguments)
    if chosen.contender:
        print(json.dumps(contender(chosen.contender, chosen.rows)))
        return 0
    from maglev_offline.curate.balance import BALANCES

    about = processes.machine() | {name: version(name) for name in ("maglev-offline", "numpy", "scipy")}
    print("\n".join(f"{name}: {value}" for name, value in about.items()))
    print(f"\n{chosen.rows:,} rows, 10,000 wanted, one thread.\n")
    command = [sys.executable, __file__, "--rows", str(chosen.rows), "--contender"]
    rows = [run_alone([*command, name], LONGEST_S) for name in BALANCES]
    print(as_markdown(rows))
    wrong = complaints(rows)
    if chosen.json:
        text = json.dumps({"machine": about, "rows": rows, "complaints": wrong}, indent=2)
        chosen.json.write_text(text + "\n", encoding="utf-8")
    for complaint in wrong:
        print(complaint, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
