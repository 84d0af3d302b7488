"""The sections on control and learning: regulation, return curves, verdict."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.report import figures_control, figures_learning, words
from maglev_offline.report.agent_metrics import agent_metrics
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import interval, listing, number, percent, plain, spread, whole
from maglev_offline.report.page import Block, Plot, Points, Section, Table, not_yet
from maglev_offline.report.style import algorithm_label, arm_stroke, controller_stroke

CONTROL, TRANSFER = "control", "transfer"

_COLUMNS = (
    ("cost", "cost", 1.0),
    ("settling_time_s", "settles, s", 1.0),
    ("overshoot", "overshoot, %", 100.0),
    ("steady_state_bias_m", "bias, mm", 1e3),
    ("gap_rmse_m", "gap RMSE, mm", 1e3),
    ("peak_voltage_v", "peak voltage deviation, V", 1.0),
    ("contact_fraction", "in contact, %", 100.0),
    ("saturation_fraction", "at the limit, %", 100.0),
)


def regulation_section(evidence: Evidence, *, trains: bool = True) -> Section:
    """How classical controllers and agents come back from the reference start."""
    control, blocks = evidence.get("control"), evidence.blocks
    start = _start_m(control, blocks)
    section = Section("regulation", "Regulation" + (f" from {plain(1e3 * start)} mm" if start else ""))
    if control is None:
        section.blocks.append(not_yet("The classical controllers have not been tried yet.", CONTROL))
    if not blocks and trains:
        section.blocks.append(not_yet("No agent has been trained yet.", TRANSFER))
    if control is None and not blocks:
        return section
    classical, agents = evidence.control_responses(), evidence.regulation()
    section.blocks += _regulation_plots(evidence, classical, agents)
    section.blocks.append(_regulation_table(evidence, agents))
    return section


def _periods(process: tuple[Plant, Mdp] | None) -> str:
    """How often each controller acts."""
    if process is None:
        return ""
    mdp = process[1]
    return (
        f" The held LQR and the agents decide every {plain(mdp.control_period_ms)} ms, the other controllers every "
        f"{plain(mdp.plant_step_ms)} ms."
    )


def _start_m(control: Artefact | None, blocks: Sequence[Artefact]) -> float | None:
    if control is not None:
        return float(control.manifest.settings["control"]["reference_start_gap_m"])
    return float(blocks[0].manifest.settings["evaluation"]["reference_start_gap_m"]) if blocks else None


def _regulation_plots(evidence: Evidence, classical: pd.DataFrame | None, agents: pd.DataFrame | None) -> list[Block]:
    process, control = evidence.process(), evidence.get("control")
    if control is not None:
        set_point = float(control.facts["equilibrium"]["gap_m"])
    else:
        set_point = process[0].set_point_m if process else float("nan")
    duration = process[1].episode_duration_s if process else 0.5
    short = None if classical is None else classical[classical["t_s"] <= duration]
    figure = figures_control.regulation_figure(short, agents, set_point, duration)
    seeds = 0 if agents is None else agents["seed"].nunique()
    parts = []
    if classical is not None:
        parts.append("classical controllers on the nonlinear plant (control/responses.parquet)")
    if agents is not None:
        parts.append(
            f"the last policies of the agents (training/…/regulation.parquet): {words.seeds_words(seeds)} in each arm, "
            "each a thin line, with their median at each instant in bold"
        )
    caption = f"Gap, voltage and current over the first {plain(duration)} s: {'; '.join(parts)}.{_periods(process)}"
    label = f"Responses of {listing([p.split(' (')[0] for p in parts])} over {plain(duration)} seconds."
    plots: list[Block] = [Plot("regulation", figure, caption, label)]
    if classical is not None and classical["t_s"].max() > 1.5 * duration:
        span = plain(round(float(classical["t_s"].max()), 1))
        caption = f"Gap with PID and with the cascade over {span} s. From control (responses.parquet)."
        figure = figures_control.long_response_figure(classical, set_point)
        plots.append(Plot("long", figure, caption, f"Gap with PID and with the cascade over {span} seconds."))
    return plots


def _regulation_table(evidence: Evidence, agents: pd.DataFrame | None) -> Table:
    rows, process, classical = [], evidence.process(), evidence.control_metrics()
    if classical is not None:
        for _, row in classical.iterrows():
            cells = [number(round(scale * row[name], 6)) for name, _, scale in _COLUMNS]
            cells[1] = "never" if np.isnan(row["settling_time_s"]) else cells[1]
            rows.append([controller_stroke(str(row["controller"])).label, "", *cells])
    if agents is not None and process is not None:
        table = agent_metrics(agents, *process)
        arms = list(dict.fromkeys(table["arm"]))
        for (algorithm, arm), group in table.groupby(["algorithm", "arm"], sort=False):
            cells = [spread(group[name].to_numpy(), scale) for name, _, scale in _COLUMNS]
            settled = int(group["settling_time_s"].notna().sum())
            cells[1] = "never" if not settled else cells[1]
            label = f"{algorithm_label(str(algorithm))}, {arm_stroke(str(arm), arms).label}"
            rows.append([label, f"{settled} of {len(group)}", *cells])
    head = ["controller", "seeds that settle", *(label for _, label, _ in _COLUMNS)]
    caption = (
        "Regulation from the reference start. Settling (into 2 % of the first deviation), overshoot, bias and peak "
        "voltage of the classical controllers are those of the whole response"
    )
    if agents is None:
        rows = [[row[0], *row[2:]] for row in rows]
        head.pop(1)
        return Table(
            f"{caption}; the other columns are those of one episode. From control (metrics.parquet).", head, rows
        )
    caption += (
        ", of the agents those of one episode; the other columns are those of one episode for all. Agents: median over "
        "seeds (interquartile range); settling time of those seeds that settle. From control (metrics.parquet) and "
        "training (regulation.parquet)."
    )
    return Table(caption, head, rows)


def curves_section(evidence: Evidence, *, trains: bool = True) -> Section:
    """Cost over training."""
    section = Section("curves", "Return curves")
    curves, study, blocks = evidence.curves(), evidence.get("transfer"), evidence.blocks
    if curves is None:
        section.blocks.append(not_yet("There are no learning curves yet.", TRANSFER, wanted=trains))
        return section
    reference: Mapping[str, float] = study.facts["reference_cost"] if study else {}
    threshold = float(study.facts["threshold_cost"]) if study else None
    exploratory = int(blocks[0].manifest.settings["training"]["exploratory_steps"]) if blocks else None
    figure = figures_learning.curves_figure(curves, reference, threshold, exploratory)
    seeds, runs = curves["seed"].nunique(), len(curves.groupby(["algorithm", "arm", "seed"]))
    source = "transfer (curves.parquet)" if study else "training (curves.parquet)"
    lines = ""
    if reference:
        values = [
            f"{controller_stroke(name).label} {number(reference[name])}"
            for name in figures_learning.REFERENCES
            if name in reference
        ]
        lines = f" Horizontal lines, over the same starts: {listing(values)}; threshold {number(threshold)}."
        lines += _periods(evidence.process())
    shade = f" Shaded on the left: the {whole(exploratory)} exploratory steps." if exploratory else ""
    caption = (
        f"Cost (minus the return) of evaluation episodes without exploration noise, mean over the fixed starts, on a "
        f"logarithmic axis: {whole(runs)} runs, {words.seeds_words(seeds)} in each arm. Thin: one run; bold: the "
        f"median; band: the interquartile range.{lines}{shade} Lower is better. From {source}."
    )
    label = f"Learning curves of {runs} runs, a panel for each algorithm, a colour for each arm."
    section.blocks.append(Plot("curves", figure, caption, label))
    return section


def verdict_section(evidence: Evidence, *, trains: bool = True) -> Section:
    """What prefill changed."""
    section = Section("verdict", "Verdict: does the prefill help or harm?")
    study = evidence.get("transfer")
    if study is None:
        section.blocks.append(not_yet("The arms have not been compared yet.", TRANSFER, wanted=trains))
        return section
    facts, settings = study.facts, study.manifest.settings["transfer"]
    rows = figures_learning.forest_rows(facts)
    if rows:
        caption = (
            f"Difference between the arms, paired by seed (empty minus prefilled), with its "
            f"{percent(settings['confidence'])} bootstrap interval, in per cent of the mean with an empty buffer; on "
            f"the right in the metric’s own unit. "
            f"Grey: the margin within which a difference does not matter, {percent(settings['equivalence_share'])} of "
            f"the held LQR’s cost, or of the length of a run. Filled: the interval decides; hollow: it does not, or "
            f"the arms are equivalent. From transfer."
        )
        label = f"Forest plot of {len(rows)} differences: " + "; ".join(
            f"{row['label'].replace('  ', ' ')} {row['verdict']}" for row in rows
        )
        section.blocks.append(Plot("forest", figures_learning.forest_figure(facts), caption, label))
    for algorithm, found in facts["algorithms"].items():
        section.blocks += [_effects_table(algorithm, arm, found) for arm in found["effects"]]
    section.blocks += [_arms_table(facts), Points(_notes(study))]
    return section


def _effects_table(algorithm: str, arm: str, found: Mapping[str, Any]) -> Table:
    rows, marks = [], []
    for metric, effect in figures_learning.sorted_metrics(found["effects"][arm]):
        rows.append(
            [
                figures_learning.METRIC_LABELS.get(metric, metric),
                number(effect["baseline_mean"]),
                number(effect["arm_mean"]),
                number(effect["difference"]),
                interval(effect["low"], effect["high"]),
                percent(effect["probability_better"]),
                number(effect["detectable"]),
                number(effect["margin"]),
                words.VERDICT_WORDS[effect["verdict"]],
            ]
        )
        marks.append(effect["verdict"])
    seeds = next(iter(found["effects"][arm].values()))["seeds"]
    head = ["metric", "empty: mean", f"{arm}: mean", "difference", "interval", "seeds better"]
    head += ["detectable", "margin", "verdict"]
    caption = (
        f"{algorithm_label(algorithm)}, {words.seeds_words(seeds)} in each arm. Jumpstart, asymptote and area are "
        "costs, the time to the threshold is in steps; of all, less is better. Seeds better: their share, "
        "ties counted half. Detectable: the smallest difference that so "
        "many seeds show with a power of 80 %. From the manifest of transfer."
    )
    return Table(caption, head, rows, marks=marks)


def _arms_table(facts: Mapping[str, Any]) -> Table:
    rows = []
    for algorithm, found in facts["algorithms"].items():
        for name, arm in found["arms"].items():
            n = arm["seeds"]
            rows.append(
                [
                    f"{algorithm_label(algorithm)}, {arm_stroke(name, found['arms']).label}",
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
    return Table(caption, head, rows)


def _notes(study: Artefact) -> list[str]:
    facts = study.facts
    notes = [f"Direction: {facts['direction']}."]
    censored, moving = [], []
    for algorithm, found in facts["algorithms"].items():
        margin = {
            effect["margin"] for arm in found["effects"].values() for m, effect in arm.items() if m == "asymptote"
        }
        for name, arm in found["arms"].items():
            label = f"{algorithm_label(algorithm)} with {arm_stroke(name, found['arms']).label}"
            missing = arm["seeds"] - round(arm["share_reached"] * arm["seeds"])
            if missing:
                censored.append(f"{missing} of {arm['seeds']} ({label})")
            if margin and abs(arm["mean_drift"]) > max(margin):
                moving.append(f"{label} (drift {number(arm['mean_drift'])}, margin {number(max(margin))})")
    if censored:
        notes.append(
            "Censored: runs that never hold the threshold count with the whole length of the training, so that the "
            f"time to threshold is a restricted mean: {listing(censored)}."
        )
    else:
        notes.append("Nothing is censored: every run reached the threshold.")
    if moving:
        notes.append(f"Not converged: {listing(moving)}. The asymptote is a snapshot there.")
    else:
        notes.append("Converged: no arm drifts by more than the margin of the asymptote over the last evaluations.")
    few = min((arm["seeds"] for found in facts["algorithms"].values() for arm in found["arms"].values()), default=0)
    if few < 8:
        notes.append(f"{words.seeds_words(few).capitalize()} in each arm are few: read the intervals, not the means.")
    notes.append("The intervals are those of single comparisons; they are not corrected for their number.")
    return notes


def settling_of(evidence: Evidence) -> dict[str, float | None]:
    """Settling time of each classical controller from the reference start; None where it never settles."""
    table = evidence.control_metrics()
    if table is None:
        return {}
    pairs = zip(table["controller"], table["settling_time_s"], strict=True)
    return {str(name): None if np.isnan(value) else float(value) for name, value in pairs}
