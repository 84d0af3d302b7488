"""The result of a study in three sentences: the prefill, the cure, and whether the outcome was foretold."""

from collections.abc import Mapping
from typing import Any

from maglev_offline.report import words
from maglev_offline.report.numbers import interval, listing, number, percent
from maglev_offline.report.style import algorithm_label

OUTCOMES = {
    "positive": "helps",
    "negative": "harms",
    "equivalent": "makes no difference that matters",
    "inconclusive": "shows no effect that so many seeds could establish",
}


def abstract(facts: Mapping[str, Any], confidence: float) -> list[str]:
    """The sentences, from the facts alone; those that the study has nothing to say on are left out."""
    parts = [words.headline(facts), cure_sentence(facts, confidence), foretelling_sentence(facts, confidence)]
    return [part for part in parts if part]


def cure_sentence(facts: Mapping[str, Any], confidence: float) -> str:
    """What the cure that half of the seeds chose did on the other half."""
    cure = facts.get("cure")
    if not cure or not cure["algorithms"]:
        return ""
    parts = []
    for algorithm, found in cure["algorithms"].items():
        effect = found["confirmed"]
        if effect["low"] is None:  # too few seeds are left to confirm anything
            continue
        span = interval(effect["low"], effect["high"])
        parts.append(
            f"{algorithm_label(algorithm)} “{found['chosen']}” {OUTCOMES[effect['verdict']]} (difference "
            f"{number(effect['difference'])}, {percent(confidence)} interval {span}, "
            f"{words.seeds_words(effect['seeds'])})"
        )
    if not parts:
        return ""
    return (
        f"Of the {len(cure['candidates'])} arms that were tried as cures, the best on half of the seeds was held "
        f"against an empty buffer on the other half: for {listing(parts)}."
    )


def foretelling_sentence(facts: Mapping[str, Any], confidence: float) -> str:
    """How well the target error of the rows, known before any training, ranks what they do."""
    parts = []
    for algorithm, found in facts.get("foretelling", {}).get("algorithms", {}).items():
        told = found["error_over_advantage_std"]
        if told["rank_correlation"] is not None:
            low, high = told["interval"]
            parts.append(
                f"{number(told['rank_correlation'], 2)} for {algorithm_label(algorithm)} ({interval(low, high, 2)}, "
                f"{told['arms']} arms in {told['groups']} groups)"
            )
    if not parts:
        return ""
    return _met(facts["foretelling"]["calibration"]) + (
        "Rows whose targets err more, as is known before any training, did worse where this rank correlation is "
        f"negative: {listing(parts)}, {percent(confidence)} intervals over groups of arms that share their rows."
    )


def _met(calibration: Mapping[str, Mapping[str, int]]) -> str:
    """What became of the verdicts that were given before any training: how many of them met harm."""
    parts = [
        f"{sum(outcomes.values())} times “{before}”, {outcomes.get('negative', 0)} of which did harm"
        for before, outcomes in calibration.items()
        if outcomes
    ]
    return f"Before any training the rows of an arm were judged {listing(parts)}. " if parts else ""
