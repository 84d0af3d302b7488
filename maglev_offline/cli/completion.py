"""What a shell may put in the place of a half-typed value: recipes, algorithms, arms, and other names of options.

It runs at each press of the tab key, so it reads files with the standard library alone, and no failure is told.
"""

import json
import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

ALGORITHMS = ("ddpg", "td3")
ENGINES = ("auto", "native", "torch")
ARMS = ("empty", "prefill", "uncurated", "shuffled", "random_policy", "pid")
CONSTRUCTIONS = ("raw", "semi_markov", "interpolated", "consistent", "reconstructed", "simulated_next")
BALANCES = ("cells", "quantiles", "inverse_density", "coverage", "low_cost", "none")
CONTROLLERS = ("policy", "pid", "cascade", "lqr", "lqr_held", "lqi", "lqi_ekf")
"""Names as the settings know them: to import those would take a second. A test holds them to each other."""


def one_of(names: tuple[str, ...]) -> Callable[[str], list[str]]:
    """Complete one of some names."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return complete


def recipes(incomplete: str) -> list[str]:
    """Complete a recipe: TOML files in the folder that is typed, and one below. Where there is none: any file."""
    typed = incomplete.rpartition("/")
    folder = Path(typed[0] + typed[1])
    try:
        found = sorted([*folder.glob("*.toml"), *folder.glob("*/*.toml")])
    except OSError:
        return []
    names = [f"{typed[0]}{typed[1]}{path.relative_to(folder).as_posix()}" for path in found]
    return [name for name in names if name.startswith(incomplete) and not Path(name).name.startswith(".")]


def arms(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete an arm: the built-in ones, and those that the recipe describes, which is given or remembered."""
    tables = _recipe(ctx.params)
    transfer = tables.get("transfer", {}) if isinstance(tables, dict) else {}
    own = transfer.get("arm", {}) if isinstance(transfer, dict) else {}
    names = [*ARMS, *(own if isinstance(own, dict) else ())]
    return [name for name in names if name.startswith(incomplete)]


def _recipe(params: dict[str, Any]) -> Any:
    try:
        if params.get("recipe"):
            return tomllib.loads(Path(params["recipe"]).read_text(encoding="utf-8"))
        where = params.get("workspace") or os.environ.get("MAGLEV_OFFLINE_WORKSPACE") or "workspace"
        return json.loads((Path(where) / "recipe.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
