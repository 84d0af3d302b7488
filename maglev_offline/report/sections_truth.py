"""The section on what rows teach and what the simulator explains, before anything is trained."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import pandas as pd

from maglev_offline.curate.diagnostic import FIT_ERROR, HARMFUL_ERROR
from maglev_offline.curate.resampling import LEAST_ROWS, LEAST_UNITS
from maglev_offline.curate.residual_map import MOST_NOT_EXPLAINED, STEPS_AHEAD
from maglev_offline.curate.words import region_words, verdict_words
from maglev_offline.report import figures_truth
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import listing, number, percent, plain, whole
from maglev_offline.report.page import Paragraph, Plot, Section, not_yet


def truth_section(evidence: Evidence) -> Section:
    """The verdict on the rows with its map, and the residual between logs and simulator with its own."""
    section = Section("truth", "What the rows teach, and what the simulator explains")
    made = evidence.get("transitions")
    files = ("diagnostic_cells", "diagnostic_rows", "residuals")
    if made is None or not all((made.folder / f"{name}.parquet").exists() for name in files):
        section.blocks.append(not_yet("The rows have not been judged.", "curate"))
        return section
    cells, rows, residuals = (evidence.transitions(name) for name in files)
    assert cells is not None
    assert rows is not None
    assert residuals is not None
    words = verdict_words(made.facts)
    text = (
        f"Before anything is trained: {words}. The truth is the simulator’s, one decision at a time; the reference "
        "is the LQR at the same cost. The verdict is about what rows say, not about what they cover."
    )
    section.blocks += [Paragraph(text), truth_plot(cells, rows, made.facts)]
    residual = made.facts["residual"]
    if residual is None:
        section.blocks.append(Paragraph("No stretch of the logs could be compared with the simulator.", "note"))
        return section
    section.blocks += [Paragraph(text) for text in residual_words(residual, names_of(evidence.under("samples")))]
    section.blocks.append(residual_plot(residuals, residual, names_of(evidence.under("samples"))))
    return section


def names_of(logs: list[Artefact]) -> dict[str, str]:
    """The file of each log, by its id."""
    return {
        str(log.facts["log_id"]): str(log.facts.get("file", log.folder.name)) for log in logs if "log_id" in log.facts
    }


def truth_plot(cells: pd.DataFrame, rows: pd.DataFrame, facts: Mapping[str, Any]) -> Plot:
    """The diagnostic by cell, and both advantages of each row that was judged."""
    counted = cells["verdict"].value_counts()
    found = [f"{whole(counted[name])} {name}" for name in ("fit", "doubtful", "harmful") if name in counted]
    words = f"Cells that have a verdict: {listing(found)}." if found else "No cell has rows enough for a verdict."
    diagnostic = facts["diagnostic"]
    caption = (
        f"Left: the error of the targets over the spread of the advantage, in cells of the state, which hold as many "
        f"rows as is written in them. Blue: up to {plain(FIT_ERROR)}, rows tell actions apart. Orange: from "
        f"{plain(HARMFUL_ERROR)} on, they mislead. Hatched: fewer than {LEAST_ROWS} rows or {LEAST_UNITS} stretches "
        f"(or logs). The outermost cells have no end. {words} Right: the advantage that rows teach over the true one, "
        f"which is the line. From {whole(len(rows))} rows, each for as many as it stands for: error "
        f"{number(diagnostic['error_over_advantage_std'])}, "
        f"correlation {number(diagnostic['correlation_with_advantage'], 2)}. From transitions "
        "(diagnostic_cells, diagnostic_rows)."
    )
    label = f"A map of the error of targets in {len(cells)} cells, and a histogram of taught over true advantages."
    return Plot("truth", partial(figures_truth.truth_figure, cells, rows), caption, label)


def residual_words(found: Mapping[str, Any], names: Mapping[str, str]) -> list[str]:
    """What the simulator explains, which logs it does not, and why the time between samples matters."""
    logs, regions = found["logs"], found["regions"]
    text = (
        f"From one sample, with the logged voltages, the simulator of the recipe’s plant says where the state is "
        f"{plain(found['duration_s'] * 1e3)} ms later. It explains at least half of the logged change in "
        f"{whole(logs['explained'])} of {whole(logs['judged'])} logs and in {whole(regions['explained'])} of "
        f"{whole(regions['judged'])} regions."
    )
    if found["growth"] > 2:
        text += (
            f" The plant is unstable: an error of the state grows {number(found['growth'], 2)}-fold in that time, and "
            "no log says what the voltage did between its samples. What is not explained is first a finding about the "
            "time between samples, and only where it is an offset one about the plant."
        )
    texts = [text]
    offset = [log for log in found["worst_logs"] if log["offset"]]
    if offset:
        parts = [
            f"{names.get(log['log_id'], log['log_id'])} ({percent(round(log['offset_share'], 2))} of the mean square "
            f"of {number(log['rms_state_scales'], 2)} state scales)"
            for log in offset
        ]
        texts.append(
            f"The same at every sample, an offset as another plant or load makes it, is most of what is not explained "
            f"in {listing(parts)}. The command identify fits the plant to the logs."
        )
    if found["worst_regions"]:
        worst = found["worst_regions"][0]
        size, where = number(worst["rms_state_scales"], 2), region_words(worst).replace("-", "−")
        texts.append(f"The region with the largest residual is {where}: {size} state scales.")
    return texts


def residual_plot(residuals: pd.DataFrame, found: Mapping[str, Any], names: Mapping[str, str]) -> Plot:
    """The residual of the shortest length, by region and by log."""
    shortest = residuals[residuals["steps"] == STEPS_AHEAD[0]]
    lengths = [(number(one["unexplained_share"]), plain(one["duration_s"] * 1e3)) for one in (found, *found["longer"])]
    shares = [f"{share} at {duration_ms} ms" for share, duration_ms in lengths]
    caption = (
        f"Left: the mean square of the residual over that of the logged change, {plain(found['duration_s'] * 1e3)} ms "
        f"ahead, in cells of the state. Blue: up to {plain(MOST_NOT_EXPLAINED)}, at least half is explained. Orange: "
        "from 1 on, no better than to say that nothing changes. Numbers and hatches as above, of windows. "
        "Right: the rms of the residual by log, the part of it that is an offset, and the change that was logged. The "
        f"share of all logs is {listing(shares)}. From transitions (residuals)."
    )
    label = "A map of the share that the simulator does not explain, and bars of the residual of each log."
    return Plot("residual", partial(figures_truth.residual_figure, shortest, names), caption, label)
