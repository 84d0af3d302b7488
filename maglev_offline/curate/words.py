"""What the facts say of rows and residuals, as people read it, and as an exit code.

Imports no pandas: an unchanged run needs none.
"""

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


def residual_lines(facts: Mapping[str, Any]) -> list[str]:
    """Say in at most two lines what the facts of a transitions manifest tell of logs and simulator; none if nothing."""
    found = facts.get("residual")
    if found is None:
        return []
    logs, regions = found["logs"], found["regions"]
    grows = f"; an error of the state grows {found['growth']:.3g}-fold in that time" if found["growth"] > 2 else ""
    lines = [
        f"{found['duration_s'] * 1e3:.4g} ms ahead the simulator explains {logs['explained']} of {logs['judged']} logs "
        f"and {regions['explained']} of {regions['judged']} regions{grows}"
    ]
    worst = [f"{log['log_id']} ({_size(log)})" for log in found["worst_logs"][:_MOST_NAMED]]
    worst += [f"{region_words(region)} ({_size(region)})" for region in found["worst_regions"][:1]]
    if worst:
        offset = "; an offset is what another plant or load makes" if logs["offset"] or regions["offset"] else ""
        lines.append(f"not explained, worst first: {', '.join(worst)}{offset}")
    return lines


_MOST_NAMED = 3
"""So many logs are named in a line."""


def region_words(region: Mapping[str, Any]) -> str:
    """Name a region of the residual facts by its ends."""
    return (
        f"gap error {_between(region['gap_from_m'], region['gap_to_m'], 'mm')} and velocity "
        f"{_between(region['velocity_from_m_s'], region['velocity_to_m_s'], 'mm/s')}"
    )


def _between(low: float | None, high: float | None, unit: str) -> str:
    """Ends in SI units, written in thousandths."""
    if low is None and high is None:
        return "anywhere"
    if low is None or high is None:
        return f"below {1e3 * high:.2g} {unit}" if high is not None else f"above {1e3 * (low or 0):.2g} {unit}"
    return f"{1e3 * low:.2g} to {1e3 * high:.2g} {unit}"


def _size(part: Mapping[str, Any]) -> str:
    share = f", {part['offset_share']:.0%} of it offset" if part["offset"] else ""
    return f"{part['rms_state_scales']:.2g} state scales{share}"


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
