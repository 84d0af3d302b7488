"""The sections on the logged data: origin, trajectories, coverage, prefill."""

from collections import Counter
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.report import figures_data
from maglev_offline.report.coverage_table import coverage_table
from maglev_offline.report.evidence import Artefact, Evidence, quarantine_of, samples_of_a_point
from maglev_offline.report.numbers import NO_BREAK, NOTHING, interval, number, percent, plain, whole
from maglev_offline.report.page import Block, Paragraph, Plot, Section, Table, not_yet
from maglev_offline.report.settings import ReportSettings
from maglev_offline.report.style import algorithm_label
from maglev_offline.report.words import reason

INGEST, CURATE, PREFILL = "ingest LOGS...", "curate", "prefill --algo td3"

_VELOCITY = {"logged": "logged", "central_difference": "from the gap"}


def origin_section(evidence: Evidence) -> Section:
    """Where the data came from: every log, what was used of it, and what was put aside and why."""
    section = Section("origin", "Where the data came from")
    logs = evidence.under("samples")
    if not logs:
        section.blocks.append(not_yet("No log has been ingested into this workspace.", INGEST))
        return section
    transitions = evidence.get("transitions")
    curated = None if transitions is None else set(transitions.manifest.inputs)
    section.blocks += [_logs_table(logs, curated), _timing_table(logs), *_sums(logs)]
    unused = [log.name for log in logs if curated is not None and log.name not in curated]
    if unused:
        text = f"In the workspace, but not in the transitions that this page is about: {', '.join(unused)}."
        section.blocks.append(Paragraph(text, "warning"))
    left_out = _left_out_table(evidence, logs)
    if left_out.rows:
        section.blocks.append(left_out)
    else:
        section.blocks.append(Paragraph("Nothing was put aside."))
    return section


def _logs_table(logs: list[Artefact], curated: set[str] | None) -> Table:
    """Every log; `curated` names the artefacts that the transitions were made from."""
    rows = []
    for log in logs:
        facts, counts = log.facts, log.manifest.counts
        origin = "simulated" if facts.get("simulated") else "not marked"
        rows.append(
            [
                str(facts.get("file", log.folder.name)),
                str(facts.get("sha256", ""))[:10],
                origin,
                *(whole(counts.get(name)) for name in ("messages", "messages_used", "messages_quarantined")),
                *(whole(counts.get(name)) for name in ("rows", "rows_quarantined", "points", "segments")),
                "yes" if curated is not None and log.name in curated else "no",
            ]
        )
    if len(logs) > 1:
        names = ("messages", "messages_used", "messages_quarantined", "rows", "rows_quarantined", "points", "segments")
        total = [whole(sum(log.manifest.counts.get(name, 0) for log in logs)) for name in names]
        rows.append(["all logs", "", "", *total, ""])
    head = ["file", "SHA-256", "origin", "messages", "used", "quarantined"]
    head += ["samples", "put aside", "points", "segments", "curated"]
    caption = (
        "The logs, how many of their messages became samples, and whether the transitions were made from them. "
        "Simulated: the log says so itself; not marked: it does not say. From the manifests of samples and transitions."
    )
    return Table(caption, head, rows, labels=3)


def _timing_table(logs: list[Artefact]) -> Table:
    rows = []
    for log in logs:
        facts = log.facts
        topics: list[dict[str, Any]] = list(facts.get("topics", {}).values())
        periods = [topic["period_ms"] for topic in topics if topic.get("period_ms") is not None]
        jitter = [topic["jitter_ms"] for topic in topics if topic.get("jitter_ms") is not None]
        rows.append(
            [
                str(facts.get("file", log.folder.name)),
                _instant(facts.get("first_t_ns")),
                _instant(facts.get("last_t_ns")),
                _VELOCITY.get(str(facts.get("velocity")), str(facts.get("velocity", NOTHING))),
                "logged" if facts.get("set_point") == "logged" else "the plant’s",
                number(float(np.median(periods)) if periods else None),
                number(max(jitter) if jitter else None, 2),
                whole(max((topic.get("resets", 0) for topic in topics), default=0)),
            ]
        )
    head = ["file", "first sample (UTC)", "last sample (UTC)", "velocity", "set-point"]
    head += ["period, ms", "jitter, ms", "clock resets"]
    caption = (
        "Times of the logs. Period: median over topics of the median step between messages; jitter: largest standard "
        "deviation of it; velocity and set-point: where they were taken from."
    )
    return Table(caption, head, rows, labels=5)


def _instant(t_ns: int | None) -> str:
    return NOTHING if t_ns is None else pd.Timestamp(t_ns, tz="UTC").strftime(f"%Y-%m-%d{NO_BREAK}%H:%M:%S")


def _sums(logs: list[Artefact]) -> list[Block]:
    total = Counter[str]()
    wrong = []
    for log in logs:
        counts = Counter(log.manifest.counts)
        total.update(counts)
        messages = counts["messages"] == counts["messages_used"] + counts["messages_quarantined"]
        rows = counts["grid_rows"] == counts["rows"] + counts["rows_quarantined"]
        if not (messages and rows):
            wrong.append(str(log.facts.get("file", log.folder.name)))
    if wrong:
        return [Paragraph(f"The counts do not add up in {', '.join(wrong)}.", "warning")]
    return [
        Paragraph(
            f"The books balance in every log: {whole(total['messages'])} messages came in = "
            f"{whole(total['messages_used'])} used + {whole(total['messages_quarantined'])} quarantined, and "
            f"{whole(total['grid_rows'])} grid rows = {whole(total['rows'])} samples + "
            f"{whole(total['rows_quarantined'])} put aside."
        )
    ]


def _left_out_table(evidence: Evidence, logs: list[Artefact]) -> Table:
    found: Counter[tuple[str, str]] = Counter()
    for log in logs:
        ledger = quarantine_of(log)
        sums = ledger.groupby(["level", "code"], as_index=False)["count"].sum()
        for level, code, count in zip(sums["level"], sums["code"], sums["count"], strict=True):
            found[f"{level}s", str(code)] += int(count)
    rows = [[code, what, reason(code), whole(n)] for (what, code), n in sorted(found.items())]
    transitions = evidence.get("transitions")
    if transitions is not None:
        rows += [
            [code, "transitions", reason(code), whole(n)] for code, n in transitions.manifest.left_out.items() if n
        ]
    for artefact in evidence.under("prefill"):
        rows += [
            [code, f"{algorithm_label(artefact.folder.name)} rows", reason(code), whole(n)]
            for code, n in artefact.manifest.left_out.items()
            if n
        ]
    caption = "What was not used, and why. From the quarantine ledgers and the manifests."
    return Table(caption, ["reason code", "of the", "meaning", "count"], rows, labels=3)


def trajectories_section(evidence: Evidence, settings: ReportSettings) -> Section:
    """A stretch of each of the first logs, or of the one that the recipe names."""
    section = Section("trajectories", "Trajectories")
    logs = evidence.under("samples")
    if not logs:
        section.blocks.append(not_yet("There are no samples to draw.", INGEST))
        return section
    wanted = settings.example_log
    named = [log for log in logs if wanted in (log.folder.name, log.facts.get("file"), log.facts.get("log_id"))]
    if wanted is not None and not named:
        section.blocks.append(
            Paragraph(f"There is no log “{wanted}” in the workspace; the first ones are drawn.", "note")
        )
    drawn = named[:1] or logs[: settings.example_logs]
    section.blocks += [_trajectory(number, log, settings) for number, log in enumerate(drawn, start=1)]
    if not named and len(logs) > len(drawn):
        section.blocks.append(Paragraph(f"{len(logs) - len(drawn)} more logs are in the workspace."))
    return section


def _trajectory(place: int, log: Artefact, settings: ReportSettings) -> Plot:
    """A stretch of the first point of a log."""
    samples, quarantine = samples_of_a_point(log), quarantine_of(log)
    point = str(samples["point"].iloc[0])
    window = figures_data.trajectory_window(samples, quarantine, point, settings.example_duration_s)
    name = str(log.facts.get("file", log.folder.name))
    end = window.start_s + window.duration_s
    where = "around the end of a segment" if window.seams else "from the first sample"
    put_aside = len(window.quarantined_s)
    marks = (
        f"Red marks at the foot: {put_aside} quarantined messages and samples."
        if put_aside
        else "Nothing was quarantined in this stretch."
    )
    pieces = window.rows["segment"].nunique()
    caption = (
        f"{name}, point {point}, {plain(window.duration_s)} s {where}: {whole(len(window.rows))} samples in "
        f"{pieces} segment{'s' * (pieces != 1)}. Bands are segments; nothing is interpolated across their ends. "
        f"{marks} From {log.name}."
    )
    label = (
        f"Gap, gap velocity, current and voltage of point {point} of {name} from {number(window.start_s)} to "
        f"{number(end)} seconds."
    )
    return Plot(f"trajectory-{place}", partial(figures_data.trajectory_figure, window), caption, label)


def coverage_section(evidence: Evidence) -> Section:
    """How balance changed the cover of the state-action space."""
    section = Section("coverage", "Coverage of states and actions, before and after balance")
    made = evidence.get("transitions")
    candidates, curated = evidence.transitions("candidates"), evidence.transitions("transitions")
    if made is None or candidates is None or curated is None:
        section.blocks.append(not_yet("There are no curated transitions yet.", CURATE))
        return section
    caption = (
        "Number of transitions by gap error and, from left to right, voltage deviation, gap velocity and current "
        "error; above all usable transitions, below the curated ones, with one colour scale. Rows beyond the 0.1 % "
        "quantiles are counted in the cells at the edge. From transitions (candidates.parquet, transitions.parquet)."
    )
    label = f"Six histograms of {len(candidates)} transitions before balance and {len(curated)} after it."
    section.blocks.append(Plot("coverage", partial(figures_data.coverage_figure, candidates, curated), caption, label))
    section.blocks.append(coverage_table(made.facts))
    left = made.manifest.counts.get("samples_not_drawn", 0)
    if left:
        drawn = made.manifest.counts["samples"] - left
        text = f"{whole(drawn)} of {whole(drawn + left)} samples were drawn for this, minutes of a point at random."
        section.blocks.append(Paragraph(text, "note"))
    kept = made.facts["low_cost_share_kept"]
    section.blocks.append(
        Paragraph(
            f"A low-cost row is one of the cheapest of all candidates (cost at most "
            f"{number(made.facts['low_cost_threshold'])}); balance keeps {percent(kept)} of them."
        )
    )
    return section


def prefill_section(evidence: Evidence, *, trains: bool = True) -> Section:
    """What the buffer starts with."""
    section = Section("prefill", "Prefill")
    columns = evidence.prefills()
    if not columns:
        section.blocks.append(not_yet("No prefill has been made yet.", PREFILL, wanted=trains))
        return section
    rows = []
    for name, part in columns.items():
        action, cost = (np.asarray(part[key], dtype=np.float64) for key in ("action", "cost"))
        rows.append(
            [
                algorithm_label(name),
                whole(len(action)),
                interval(float(action.min()), float(action.max())),
                number(cost.mean()),
                number(float(np.median(cost))),
                interval(float(np.quantile(cost, 0.05)), float(np.quantile(cost, 0.95))),
                whole(int(np.asarray(part["terminated"]).sum())),
                whole(int(np.asarray(part["truncated"]).sum())),
            ]
        )
    head = ["algorithm", "rows", "actions", "mean cost", "median cost", "5 % to 95 % of the costs"]
    head += ["terminated", "truncated"]
    section.blocks.append(Table("The prefilled rows, as each algorithm sees them. From prefill.", head, rows))
    caption = "Costs (logarithmic axis) and actions of the prefilled rows. From prefill (prefill.safetensors)."
    figure = partial(figures_data.prefill_figure, columns)
    section.blocks.append(Plot("prefill", figure, caption, "Histograms of costs and actions of the prefilled rows."))
    return section
