"""The verdict on the rows, as people read it and as an exit code. Imports no pandas: an unchanged run needs none."""

from collections.abc import Mapping
from typing import Any

VERDICTS = ("fit", "doubtful", "harmful")
"""From good to bad."""

_MEANINGS = {
    "fit": "fit to be learned from",
    "doubtful": "doubtful",
    "harmful": "harmful, they teach what the simulator contradicts",
}


def verdict_words(facts: Mapping[str, Any]) -> str:
    """Say in one clause what the facts of a transitions manifest tell of its rows."""
    found = facts.get("diagnostic")
    if found is None:
        return "whether the rows teach the truth was not judged"
    error = _quantity(found, "error_over_advantage_std", ".2f")
    correlation = _quantity(found, "correlation_with_advantage", "+.2f")
    return (
        f"{facts['construction']} rows are {_MEANINGS[found['verdict']]}: error of their targets {error} of the "
        f"advantage's spread, correlation with the advantage {correlation}"
    )


def balance_words(facts: Mapping[str, Any]) -> str:
    """Say in one clause what balance did."""
    before, after = facts["occupancy_before"], facts["occupancy_after"]
    visited = facts["visited_states"]
    lqr = visited["policies"]["lqr"]
    return (
        f"balance {facts['balance']}: effective cells {before['effective_cells']:.0f} -> "
        f"{after['effective_cells']:.0f} of {before['occupied_cells']} occupied, "
        f"{facts['low_cost_share_kept']:.0%} of the low-cost rows kept, a row near {lqr['before']:.0%} -> "
        f"{lqr['after']:.0%} of the states that the LQR visits"
    )


def _quantity(found: Mapping[str, Any], name: str, form: str) -> str:
    value, interval = found[name], found[f"{name}_interval"]
    if value is None:
        return "unknown"
    between = "no interval" if interval is None else f"{interval[0]:{form}} to {interval[1]:{form}}"
    return f"{value:{form}} ({between})"


def exit_code(verdict: str, fail_on: str) -> int:
    """0 where the verdict is not as bad as `fail_on` (or that is `never`), else 1 for doubtful and 2 for harmful."""
    if fail_on == "never" or VERDICTS.index(verdict) < VERDICTS.index(fail_on):
        return 0
    return 2 if verdict == "harmful" else 1
