"""The sections on control and learning: regulation and return curves."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.report import figures_control, figures_learning, words
from maglev_offline.report.agent_metrics import agent_metrics
from maglev_offline.report.curves_data import curves_data
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import listing, number, percent, plain, spread, whole
from maglev_offline.report.page import Block, Live, Plot, Section, Table, not_yet
from maglev_offline.report.study.arms import arms_of, drawn_arms
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
    study = evidence.get("transfer")
    arms = [] if agents is None else list(dict.fromkeys(agents["arm"]))
    drawn = arms
    if study is not None and agents is not None:
        arms, drawn = arms_of(study.facts), drawn_arms(study.facts)
        agents = agents[agents["arm"].isin(arms)]
    section.blocks += _regulation_plots(evidence, classical, agents, arms, drawn)
    section.blocks.append(_regulation_table(evidence, agents, arms))
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


def _regulation_plots(
    evidence: Evidence,
    classical: pd.DataFrame | None,
    agents: pd.DataFrame | None,
    arms: Sequence[str],
    drawn: Sequence[str],
) -> list[Block]:
    process, control = evidence.process(), evidence.get("control")
    if control is not None:
        set_point = float(control.facts["equilibrium"]["gap_m"])
    else:
        set_point = process[0].set_point_m if process else float("nan")
    duration = process[1].episode_duration_s if process else 0.5
    short = None if classical is None else classical[classical["t_s"] <= duration]
    shown = None if agents is None else agents[agents["arm"].isin(drawn)]
    figure = partial(figures_control.regulation_figure, short, shown, set_point, duration, arms)
    seeds = 0 if agents is None else agents["seed"].nunique()
    parts = []
    if classical is not None:
        parts.append("classical controllers on the nonlinear plant (control/responses.parquet)")
    if agents is not None:
        parts.append(
            f"the last policies of the agents (training/…/regulation.parquet): {words.seeds_words(seeds)} in each arm, "
            "each a thin line, with their median at each instant in bold" + _left_out(arms, drawn)
        )
    caption = f"Gap, voltage and current over the first {plain(duration)} s: {'; '.join(parts)}.{_periods(process)}"
    label = f"Responses of {listing([p.split(' (')[0] for p in parts])} over {plain(duration)} seconds."
    plots: list[Block] = [Plot("regulation", figure, caption, label)]
    if classical is not None and classical["t_s"].max() > 1.5 * duration:
        span = plain(round(float(classical["t_s"].max()), 1))
        caption = f"Gap with PID and with the cascade over {span} s. From control (responses.parquet)."
        figure = partial(figures_control.long_response_figure, classical, set_point)
        plots.append(Plot("long", figure, caption, f"Gap with PID and with the cascade over {span} seconds."))
    return plots


def _left_out(arms: Sequence[str], drawn: Sequence[str]) -> str:
    """Say which of the arms are drawn, where they are not all."""
    if len(drawn) == len(arms):
        return ""
    names = listing([arm_stroke(arm, arms).label for arm in drawn])
    return f" (of {len(arms)} arms, {names}: the baseline, the logged rows, and the best by the mean difference)"


def _regulation_table(evidence: Evidence, agents: pd.DataFrame | None, arms: Sequence[str]) -> Table:
    rows, process, classical = [], evidence.process(), evidence.control_metrics()
    if classical is not None:
        for _, row in classical.iterrows():
            cells = [number(round(scale * row[name], 6)) for name, _, scale in _COLUMNS]
            cells[1] = "never" if np.isnan(row["settling_time_s"]) else cells[1]
            rows.append([controller_stroke(str(row["controller"])).label, "", *cells])
    if agents is not None and process is not None:
        table = agent_metrics(agents, *process)
        groups = dict(iter(table.groupby(["algorithm", "arm"], sort=False)))
        for algorithm, arm in sorted(groups, key=lambda pair: (pair[0], arms.index(pair[1]))):
            group = groups[algorithm, arm]
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
    """Cost over training: for a study, curves that a reader can question; else as they are so far."""
    section = Section("curves", "Return curves")
    curves, study, blocks = evidence.curves(), evidence.get("transfer"), evidence.blocks
    if curves is None:
        section.blocks.append(not_yet("There are no learning curves yet.", TRANSFER, wanted=trains))
        return section
    arms = list(dict.fromkeys(curves["arm"])) if study is None else arms_of(study.facts)
    drawn = arms if study is None else drawn_arms(study.facts)
    curves = curves[curves["arm"].isin(arms)]
    reference = {n: study.facts["reference_cost"][n] for n in figures_learning.REFERENCES} if study else {}
    threshold = float(study.facts["threshold_cost"]) if study else None
    exploratory = int(blocks[0].manifest.settings["training"]["exploratory_steps"]) if blocks else None
    still = Plot(
        "curves",
        partial(figures_learning.curves_figure, curves, reference, threshold, exploratory, drawn),
        "Thin: one run; bold: the median; band: the interquartile range"
        f"{_left_out(arms, drawn)}. {_curves_caption(evidence, curves, reference, threshold, exploratory)}",
        f"Learning curves of {_runs(curves)} runs, a panel for each algorithm, a colour for each arm.",
        (TRANSFER,) if study else (),
    )
    if study is None:
        section.blocks.append(still)
        return section
    confidence = float(study.manifest.settings["transfer"]["confidence"])
    data = curves_data(
        curves, blocks, shown=drawn, reference=reference, threshold=threshold, exploratory_steps=exploratory,
        confidence=confidence,
    )  # fmt: skip
    caption = (
        f"Interquartile mean over the runs of an arm (of the middle half of them, so that a run that fails does not "
        f"move it far), with its {percent(confidence)} bootstrap interval at each evaluation. "
        "Point at a curve or use the arrow keys to read it; drag across, or press plus, to zoom; “every run” shows "
        "each run, and names the one nearest to the pointer and the artefact that holds it. "
        f"{_curves_caption(evidence, curves, reference, threshold, exploratory)}"
    )
    section.blocks.append(Live("curves", data, caption, "Learning curves, to be read, zoomed and chosen from", still))
    return section


def _curves_caption(
    evidence: Evidence,
    curves: pd.DataFrame,
    reference: Mapping[str, float],
    threshold: float | None,
    exploratory: int | None,
) -> str:
    """What both forms of the figure show."""
    source = "transfer (curves.parquet)" if evidence.get("transfer") else "training (curves.parquet)"
    lines = ""
    if reference:
        values = [f"{controller_stroke(name).label} {number(cost)}" for name, cost in reference.items()]
        lines = f" Horizontal lines, over the same starts: {listing(values)}; threshold {number(threshold)}."
        lines += _periods(evidence.process())
    shade = f" Shaded on the left: the {whole(exploratory)} exploratory steps." if exploratory else ""
    return (
        f"Cost (minus the return) of evaluation episodes without exploration noise, mean over the fixed starts: "
        f"{whole(_runs(curves))} runs, {words.seeds_words(curves['seed'].nunique())} in each arm.{lines}{shade} "
        f"Lower is better. From {source}."
    )


def _runs(curves: pd.DataFrame) -> int:
    return len(curves[["algorithm", "arm", "seed"]].drop_duplicates())


def settling_of(evidence: Evidence) -> dict[str, float | None]:
    """Settling time of each classical controller from the reference start; None where it never settles."""
    table = evidence.control_metrics()
    if table is None:
        return {}
    pairs = zip(table["controller"], table["settling_time_s"], strict=True)
    return {str(name): None if np.isnan(value) else float(value) for name, value in pairs}
