"""What the commands on the plant do: `control`, `identify`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from maglev_offline.outcomes import Done
from maglev_offline.pipeline.data import fitting_samples
from maglev_offline.progress import Progress
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Manifest, Workspace


def control(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Try the classical controllers."""
    import numpy as np
    import pandas as pd

    from maglev_offline.control.stage import run_control

    folder, fresh = run_control(
        workspace, plant=recipe.plant, mdp=recipe.mdp, settings=recipe.control, progress=progress
    )
    manifest = Manifest.read(folder)
    table = pd.read_parquet(folder / "metrics.parquet")
    start = recipe.control.reference_start_gap_m
    table = table[np.isclose(table["start_gap_m"], start)]
    rows = [
        [
            f"{row['controller']}, {row['plant_kind']}",
            _seconds(row["settling_time_s"]),
            f"{row['overshoot']:.1%}",
            f"{row['steady_state_bias_m'] * 1e3:+.3f}",
            f"{row['peak_voltage_v']:.0f}",
            f"{row['cost']:.1f}",
        ]
        for row in table.to_dict("records")
    ]
    poles = ", ".join(f"{real:+.3f}{imag:+.3f}j" for real, imag in manifest.facts["poles_rad_s"])
    return Done(
        "control",
        folder,
        fresh,
        f"open-loop poles {poles} rad/s; u_eq {manifest.facts['equilibrium']['voltage_v']:.2f} V; "
        f"{_pid_words(manifest.facts, recipe)}",
        {"facts": manifest.facts},
        f"Regulation from {start * 1e3:g} mm to {recipe.plant.set_point_m * 1e3:g} mm",
        ("controller", "settles (s)", "overshoot", "bias (mm)", "peak (V)", "cost"),
        rows,
    )


def _pid_words(facts: dict[str, Any], recipe: Recipe) -> str:
    """The linear model, and how far the PID is from the edge of stability."""
    a, b = facts["a"], facts["b"]
    model = f"A = [{', '.join(str([round(x, 4) for x in row]) for row in a)}], B = {[round(row[0], 4) for row in b]}"
    ranges = [f"{found['lowest']:.0f} to {found['highest']:.0f} ({found['sampling']})" for found in facts["kp_ranges"]]
    margins = facts["margins"]["pid"]
    edge = (
        f"phase margin {margins['phase_margin_deg']:.2f} degrees, delay margin {margins['delay_margin_s'] * 1e3:.2f} ms"
        if margins["stable"] and margins["delay_margin_s"] is not None
        else "no margins: it is unstable as given"
    )
    return f"{model}; PID with Kp = {recipe.control.pid.kp:g}: stable for Kp {', '.join(ranges) or 'none'}, {edge}"


def _seconds(value: float) -> str:
    return "never" if math.isnan(value) else f"{value:.3f}"


def control_page(recipe: Recipe, workspace: Workspace) -> Path:
    """Write the page of the plant and its classical controllers."""
    from maglev_offline.report.stage import build_control_page

    return build_control_page(workspace, recipe.plain())


def identify(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Fit the plant's parameters to those samples in the workspace that this recipe made."""
    from maglev_offline.identify.stage import COLUMNS, run_identify, summary

    folders = fitting_samples(recipe, workspace, progress)
    folder, fresh = run_identify(workspace, folders, recipe.plant, recipe.identify, progress)
    sentence, rows, facts = summary(folder)
    use = (
        f"to use it: write its values into [plant] of the recipe, or ingest again with --plant {folder / 'plant.toml'}"
    )
    return Done("identify", folder, fresh, sentence, {"facts": facts}, "Parameters of the plant", COLUMNS, rows, [use])
