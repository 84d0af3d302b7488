"""The same study at other control periods, side by side."""

from collections.abc import Mapping
from typing import Any

from maglev_offline.report import words
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import interval, plain, whole
from maglev_offline.report.page import Points, Section, Table
from maglev_offline.report.study.arms import arms_of
from maglev_offline.report.style import algorithm_label, arm_stroke
from maglev_offline.transfer.words import finding_lines


def periods_section(evidence: Evidence) -> Section | None:
    """The primary metric at all periods, in per cent of the empty arm's mean; None where there is one period."""
    studies = studies_of(evidence)
    if len(studies) < 2:
        return None
    first = next(iter(studies.values()))
    metric = words.METRIC_NAMES[first.facts["primary_metric"]]
    section = Section("periods", "At other control periods")
    for algorithm in first.facts["algorithms"]:
        section.blocks.append(_table(studies, algorithm, metric))
    others = list(studies.items())[1:]  # what was found at the recipe's own period has a section of its own
    lines = [f"At {period} ms, {line}." for period, study in others for line in finding_lines(study.facts)]
    return Section(section.key, section.title, [*section.blocks, *([Points(lines)] if lines else [])])


def studies_of(evidence: Evidence) -> dict[str, Artefact]:
    """The study at the recipe's own period, and those at others that judge by its metric, by milliseconds."""
    found: dict[str, Artefact] = {}
    for each in (evidence, *evidence.periods.values()):
        study = each.get("transfer")
        if study is None:
            continue
        first = next(iter(found.values()), study)
        if study.facts["primary_metric"] == first.facts["primary_metric"]:
            found.setdefault(plain(study.manifest.settings["mdp"]["control_period_ms"]), study)
    return found


def _table(studies: Mapping[str, Artefact], algorithm: str, metric: str) -> Table:
    first = next(iter(studies.values()))
    arms = [arm for arm in arms_of(first.facts) if arm != "empty"]
    rows = [
        [
            arm_stroke(arm, arms_of(first.facts)).label,
            *(_cell(study.facts, algorithm, arm) for study in studies.values()),
        ]
        for arm in arms
    ]
    runs = ", ".join(f"{_length(study.manifest.settings)} at {period} ms" for period, study in studies.items())
    caption = (
        f"{algorithm_label(algorithm)}: difference to an empty buffer in the {metric}, in per cent of the empty "
        f"buffer’s mean at the same period, with its interval and verdict; {runs}. The shorter a run, the more its "
        "beginning weighs. Positive: the arm helps. "
        "From transfer, and from transfer of each workspace below periods/."
    )
    return Table(caption, ["arm", *(f"{period} ms" for period in studies)], rows, sources=("transfer",))


def _length(settings: Mapping[str, Any]) -> str:
    training = settings["training"]
    seconds = training["steps"] * settings["mdp"]["control_period_ms"] / 1e3
    return f"{whole(training['seeds'])} seeds of {whole(training['steps'])} decisions ({plain(seconds)} s)"


def _cell(facts: Mapping[str, Any], algorithm: str, arm: str) -> str:
    found = facts["algorithms"].get(algorithm, {}).get("effects", {}).get(arm)
    if found is None:
        return "–"
    effect = found[facts["primary_metric"]]
    base = abs(effect["baseline_mean"])
    if not base or effect["low"] is None:
        return words.verdict_words(facts, arm, effect["verdict"])
    share = {key: 100 * effect[key] / base for key in ("difference", "low", "high")}
    sign = f"{share['difference']:+.0f}".replace("-", "−")
    return f"{sign} ({interval(share['low'], share['high'], 2)}) {words.verdict_words(facts, arm, effect['verdict'])}"
