"""The answer of a study as people read it, and as an exit code."""

from collections.abc import Iterator, Mapping
from typing import Any

Facts = Mapping[str, Any]

POWER_COLUMNS = ("metric", "arm", "seeds run", "margin", "seen with them", "seeds needed")


def columns(confidence: float) -> tuple[str, ...]:
    """The columns of `effect_rows`."""
    return ("metric", "arm", "empty", "arm's", "difference", f"{confidence:.0%} interval", "p (Holm)", "verdict")


def answer(facts: Facts) -> str:
    """One sentence on the primary metric: what every arm does to every algorithm, against an empty buffer."""
    primary = facts["primary_metric"]
    parts = []
    for algorithm, found in facts["algorithms"].items():
        verdicts = [f"{arm} {effects[primary]['verdict']}" for arm, effects in _in_order(facts, found)]
        parts.append(f"{algorithm}: {', '.join(verdicts)}")
    return f"against an empty buffer, judged by {primary.replace('_', ' ')}: {'; '.join(parts)}"


def _in_order(facts: Facts, found: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """The effects of an algorithm by arm, in the order in which the recipe names the arms."""
    return [(arm, found["effects"][arm]) for arm in facts["arms"] if arm in found["effects"]]


def _effects(facts: Facts) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    for algorithm, found in facts["algorithms"].items():
        for arm, effects in _in_order(facts, found):
            for metric, effect in effects.items():
                yield f"{algorithm}: {metric.replace('_', ' ')}", arm, effect


def effect_rows(facts: Facts) -> list[list[str]]:
    """All effects, one row each."""
    return [
        [
            metric,
            arm,
            f"{effect['baseline_mean']:.4g}",
            f"{effect['arm_mean']:.4g}",
            f"{effect['difference']:+.4g}",
            "-" if effect["low"] is None else f"{effect['low']:+.4g} to {effect['high']:+.4g}",
            f"{effect['p_value_holm']:.2g}",
            effect["verdict"],
        ]
        for metric, arm, effect in _effects(facts)
    ]


def power_rows(facts: Facts) -> list[list[str]]:
    """What so many seeds can show, and how many are needed, one row for each effect."""
    return [
        [
            metric,
            arm,
            str(effect["seeds"]),
            f"{effect['margin']:.4g}",
            "-" if effect["detectable"] is None else f"{effect['detectable']:.4g}",
            "unknown" if effect["detectable"] is None else _many(effect["seeds_needed"]),
        ]
        for metric, arm, effect in _effects(facts)
    ]


def _many(seeds: int | None) -> str:
    return "more than 10,000" if seeds is None else str(seeds)


def negative_arms(facts: Facts) -> list[str]:
    """Algorithms and arms with negative transfer in the primary metric, for `--fail-on negative`.

    Only arms with rows of the logs: a control that harms, such as shuffled rows, is no negative transfer.
    """
    primary = facts["primary_metric"]
    return [
        f"{algorithm} {arm}"
        for algorithm, found in facts["algorithms"].items()
        for arm, effects in found["effects"].items()
        if effects[primary]["verdict"] == "negative" and facts["rows"].get(arm, {}).get("rows_from") == "log"
    ]


def finding_lines(facts: Facts) -> list[str]:
    """What a study found beside its answer: parts that matter, the cure, and whether the outcome was foretold."""
    lines = [
        f"{part['algorithm']}: the part {part['part']} ({part['share_of_rows']:.0%}) {part['meaning']}"
        for part in facts.get("attribution", {}).get("parts", [])
        if part["holds_after_holm"] and part["meaning"] in ("harms", "helps")
    ]
    lines += [
        f"{told['algorithm']}: {told['arm']} against {told['against']}: {told['verdict']}"
        for told in facts.get("against", {}).get("comparisons", [])
    ]
    for algorithm, cure in facts.get("cure", {}).get("algorithms", {}).items():
        if cure["confirmed"]["low"] is None:  # too few seeds are left to confirm anything
            continue
        lines.append(
            f"{algorithm}: the best cure, {cure['chosen']}, is {cure['confirmed']['verdict']} on the other seeds"
        )
    for algorithm, found in facts.get("foretelling", {}).get("algorithms", {}).items():
        told = found["error_over_advantage_std"]
        if told["rank_correlation"] is not None:
            low, high = told["interval"]
            lines.append(
                f"{algorithm}: rank correlation of the rows' target error with what they did, over {told['arms']} "
                f"arms: {told['rank_correlation']:+.2f} ({low:+.2f} to {high:+.2f})"
            )
    return lines


def period_lines(others: Mapping[str, Facts]) -> list[str]:
    """One line for each other control period (by its milliseconds)."""
    return [f"at {period} ms, {answer(facts)}" for period, facts in others.items()]
