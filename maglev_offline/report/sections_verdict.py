"""The section on the verdict: what the prefill changed, metric by metric, and how the runs of each arm end."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from maglev_offline.report import figures_learning, words
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import interval, listing, number, percent, whole
from maglev_offline.report.page import Plot, Points, Section, Table, not_yet
from maglev_offline.report.sections_learning import TRANSFER
from maglev_offline.report.study.arms import arms_of, judged_arms
from maglev_offline.report.style import algorithm_label, arm_stroke

MOST_NAMED = 6
"""A sentence that names more than so many arms is not read."""


def verdict_section(evidence: Evidence, *, trains: bool = True) -> Section:
    """What prefill changed."""
    section = Section("verdict", "Verdict: does the prefill help or harm?")
    study = evidence.get("transfer")
    if study is None:
        section.blocks.append(not_yet("The arms have not been compared yet.", TRANSFER, wanted=trains))
        return section
    facts, settings = study.facts, study.manifest.settings["transfer"]
    arms = judged_arms(facts)
    rows = figures_learning.forest_rows(facts, arms)
    if rows:
        caption = (
            f"Difference between the arms, paired by seed (empty minus the other), with its "
            f"{percent(settings['confidence'])} bootstrap interval, in per cent of the mean with an empty buffer; on "
            f"the right in the metric’s own unit. "
            f"Grey: the margin within which a difference does not matter, {percent(settings['equivalence_share'])} of "
            f"the held LQR’s cost, or of the length of a run. Filled: the interval decides; hollow: it does not, or "
            f"the arms are equivalent. From transfer."
        )
        label = f"Forest plot of {len(rows)} differences: " + "; ".join(
            f"{row['label'].replace('  ', ' ')} {row['verdict']}" for row in rows
        )
        section.blocks.append(
            Plot("forest", partial(figures_learning.forest_figure, rows), caption, label, (TRANSFER,))
        )
    for algorithm, found in facts["algorithms"].items():
        section.blocks += [_effects_table(algorithm, arm, facts) for arm in arms if arm in found["effects"]]
    section.blocks += [_arms_table(facts), Points(_notes(study))]
    return section


def _effects_table(algorithm: str, arm: str, facts: Mapping[str, Any]) -> Table:
    rows, marks = [], []
    found = facts["algorithms"][algorithm]
    for metric, effect in figures_learning.sorted_metrics(found["effects"][arm]):
        rows.append(
            [
                figures_learning.METRIC_LABELS.get(metric, metric),
                number(effect["baseline_mean"]),
                number(effect["arm_mean"]),
                number(effect["difference"]),
                interval(effect["low"], effect["high"]),
                percent(effect["probability_better"]),
                number(effect["p_value_holm"]),
                number(effect["detectable"]),
                number(effect["margin"]),
                words.verdict_words(facts, arm, effect["verdict"]),
            ]
        )
        marks.append(effect["verdict"])
    seeds = next(iter(found["effects"][arm].values()))["seeds"]
    head = ["metric", "empty: mean", f"{arm}: mean", "difference", "interval", "seeds better", "p"]
    head += ["detectable", "margin", "verdict"]
    caption = (
        f"{algorithm_label(algorithm)}, {words.seeds_words(seeds)} in each arm. Jumpstart, asymptote and area are "
        "costs, the time to the threshold is in steps; of all, less is better. Seeds better: their share, "
        "ties counted half. p: by changes of sign, after Holm’s correction over all comparisons of the study. "
        "Detectable: the smallest difference that so "
        "many seeds show with a power of 80 %. From the manifest of transfer."
    )
    return Table(caption, head, rows, marks=marks, sources=(TRANSFER,))


def _arms_table(facts: Mapping[str, Any]) -> Table:
    rows = []
    for algorithm, found in facts["algorithms"].items():
        for name in arms_of(facts):
            arm = found["arms"][name]
            n = arm["seeds"]
            rows.append(
                [
                    f"{algorithm_label(algorithm)}, {arm_stroke(name, arms_of(facts)).label}",
                    *(
                        f"{round(arm[key] * n)} of {n}"
                        for key in ("share_reached", "share_within_half_mm", "share_settled")
                    ),
                    number(
                        None if arm["median_final_worst_error_m"] is None else 1e3 * arm["median_final_worst_error_m"]
                    ),
                    number(arm["mean_drift"]),
                    whole(arm["diverged"]),
                ]
            )
    head = [
        "arm",
        "reach the threshold",
        "within 0.5 mm at the end",
        "settle",
        "median worst error, mm",
        "drift",
        "diverged",
    ]
    caption = (
        "The runs of each arm. Within 0.5 mm: the largest gap error over the last 20 % of the episode, over all "
        "evaluation starts; settle: from the reference start; drift: change of the cost along the last evaluations "
        "(negative: still improving). From transfer."
    )
    return Table(caption, head, rows, sources=(TRANSFER,))


def _notes(study: Artefact) -> list[str]:
    facts = study.facts
    notes = [f"Direction: {facts['direction']}."]
    censored, moving = [], []
    for algorithm, found in facts["algorithms"].items():
        margin = {
            effect["margin"] for arm in found["effects"].values() for m, effect in arm.items() if m == "asymptote"
        }
        for name in arms_of(facts):
            arm = found["arms"][name]
            label = f"{algorithm_label(algorithm)} with {arm_stroke(name, arms_of(facts)).label}"
            missing = arm["seeds"] - round(arm["share_reached"] * arm["seeds"])
            if missing:
                censored.append(f"{missing} of {arm['seeds']} ({label})")
            if margin and abs(arm["mean_drift"]) > max(margin):
                moving.append(f"{label} (drift {number(arm['mean_drift'])}, margin {number(max(margin))})")
    if censored:
        notes.append(
            "Censored: runs that never hold the threshold count with the whole length of the training, so that the "
            f"time to threshold is a restricted mean: {_some(censored)}."
        )
    else:
        notes.append("Nothing is censored: every run reached the threshold.")
    if moving:
        notes.append(f"Not converged: {_some(moving)}. The asymptote is a snapshot there.")
    else:
        notes.append("Converged: no arm drifts by more than the margin of the asymptote over the last evaluations.")
    few = min((arm["seeds"] for found in facts["algorithms"].values() for arm in found["arms"].values()), default=0)
    if few < 8:
        notes.append(f"{words.seeds_words(few).capitalize()} in each arm are few: read the intervals, not the means.")
    notes.append(
        "The intervals, and so the verdicts, are those of single comparisons; p is corrected for their number "
        f"({whole(_comparisons(facts))} in all)."
    )
    return notes


def _comparisons(facts: Mapping[str, Any]) -> int:
    return sum(len(metrics) for found in facts["algorithms"].values() for metrics in found["effects"].values())


def _some(parts: Sequence[str]) -> str:
    """A list that ends where a table says it better."""
    many = len(parts) - MOST_NAMED
    return listing(parts) if many < 2 else f"{', '.join(parts[:MOST_NAMED])}, and {many} more in the table above"
