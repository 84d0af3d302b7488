"""Which arms of a study are told in full, and which in a table."""

from collections.abc import Mapping, Sequence
from typing import Any

FEW = 4
"""So many arms can be told one by one."""


def arms_of(facts: Mapping[str, Any]) -> list[str]:
    """The arms that the recipe names, in its order; arms of an attribution are none of them."""
    return list(facts["arms"])


def judged_arms(facts: Mapping[str, Any]) -> list[str]:
    """The arms that are told metric by metric: all where they are few, else the prefill, or the first."""
    others = [arm for arm in arms_of(facts) if arm != "empty"]
    if len(others) < FEW:
        return others
    return ["prefill"] if "prefill" in others else others[:1]


def drawn_arms(facts: Mapping[str, Any]) -> list[str]:
    """The arms that are drawn before a reader chooses: all where they are few, else empty, prefill and the best one."""
    arms = arms_of(facts)
    if len(arms) <= FEW:
        return arms
    best = max((arm for arm in arms if arm != "empty"), key=lambda arm: (mean_difference(facts, arm), arm))
    return [arm for arm in arms if arm in ("empty", "prefill", best)]


def mean_difference(facts: Mapping[str, Any], arm: str) -> float:
    """Mean difference of an arm in the primary metric over the algorithms; minus infinity where there is none."""
    metric = facts["primary_metric"]
    found: Sequence[Any] = [a["effects"][arm][metric]["difference"] for a in facts["algorithms"].values()]
    known = [value for value in found if value is not None]
    return sum(known) / len(known) if len(known) == len(found) and known else float("-inf")
