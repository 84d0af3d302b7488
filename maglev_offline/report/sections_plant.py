"""The section on the plant: its linear model, force, stability, responses, robustness, and the paper's claims."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.physics.parameters import Plant
from maglev_offline.report import figures_plant
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import NOTHING, listing, number, percent, plain, whole
from maglev_offline.report.page import Block, Paragraph, Plot, Section, Table, not_yet
from maglev_offline.report.style import CONTROLLERS, controller_stroke

CONTROL = "control"

PAPER_A = ((0.0, 1.0, 0.0), (2450.0, 0.0, -1.1558), (0.0, 2119.7, -3.1438))
PAPER_B = (0.0, 0.0, 2.6198)
PAPER_C = (1.0, 0.0, 0.0)
"""The linear model as the paper prints it (Zhao et al., Sec. II-B)."""

STEPS_S = 0.5
"""The stretch of the responses that is drawn."""

_OF_THE_MODEL = (
    *("mass_kg", "resistance_ohm", "gravity_m_s2", "set_point_m"),
    *("inductance_slope_h_m", "inductance_offset_h", "pole_offset_m"),
)
_SAMPLING_WORDS = {
    "continuous": "in continuous time",
    "euler": "under forward Euler",
    "zoh": "under a zero-order hold",
}
_VERDICT_MARKS = {"reproduced": "positive", "not reproduced": "negative", "not testable": ""}


def plant_section(evidence: Evidence) -> Section:
    """The plant that the controllers were made for: where it is stable, what each controller makes of it."""
    section = Section("plant", "The plant and its classical controllers")
    control = evidence.get("control")
    if control is None:
        section.blocks.append(not_yet("The classical controllers have not been tried yet.", CONTROL))
        return section
    plant = plant_of(control)
    section.blocks += _model(control, plant)
    section.blocks += _locus(control)
    section.blocks += _margins(control)
    section.blocks += _steps(control)
    section.blocks += _robustness(control, plant)
    section.blocks += _claims(control)
    return section


def plant_of(control: Artefact) -> Plant | None:
    """The plant that a control artefact was made for; None where an older one does not hold it."""
    settings = control.manifest.settings.get("plant")
    return None if settings is None else Plant.model_validate(settings)


def is_papers(plant: Plant) -> bool:
    """Whether the plant moves as the paper's does; the stops, which the paper leaves open, may differ."""
    return all(np.isclose(getattr(plant, name), getattr(Plant(), name), rtol=1e-9, atol=0) for name in _OF_THE_MODEL)


def _table_of(control: Artefact, name: str) -> pd.DataFrame | None:
    file = f"{name}.parquet"
    return pd.read_parquet(control.folder / file) if file in control.manifest.files else None


def _older(what: str) -> list[Block]:
    return [not_yet(f"The artefact of the controllers, made by an older version, holds no {what}.", CONTROL)]


def _model(control: Artefact, plant: Plant | None) -> list[Block]:
    facts = control.facts
    if "a" not in facts:
        return _older("linear model")
    point = facts["equilibrium"]
    text = (
        f"The magnet carries the mass at a gap of {plain(1e3 * point['gap_m'])} mm with {number(point['current_a'])} A "
    )
    text += f"and {number(point['voltage_v'])} V; κ = {whole(facts['kappa_a2_per_m2'])} A²/m². "
    text += f"Without control this equilibrium is {_stability(facts['poles_rad_s'])}."
    blocks: list[Block] = [Paragraph(text), _model_table(facts, plant is not None and is_papers(plant))]
    if plant is None:
        return blocks + _older("plant, so that its force is not drawn")
    shares = listing([plain(share) for share in figures_plant.CURRENT_SHARES])
    caption = (
        "The suspension force of the nonlinear plant. Left: darker is stronger; along each line the force is constant, "
        "and each lies at twice the force of the one below it. Right: the same force over the gap, for "
        f"{shares} times the current that carries the mass; dashed: the weight m g. Dot: the equilibrium. The force "
        "falls with the gap, so that a magnet which is too far away is pulled too little. The gap runs between the "
        f"stops at {plain(1e3 * plant.gap_min_m)} and {plain(1e3 * plant.gap_max_m)} mm. From the recipe’s plant."
    )
    label = (
        "Suspension force over gap and current, and lines of force over the gap with the weight and the equilibrium."
    )
    return [*blocks, Plot("force", partial(figures_plant.force_figure, plant), caption, label)]


def _stability(poles: Sequence[Sequence[float]]) -> str:
    right = max(pole[0] for pole in poles)
    return f"unstable: a pole lies at {number(right)} rad/s" if right > 0 else "stable"


def _model_table(facts: Mapping[str, Any], papers: bool) -> Table:
    rows = [[f"A, row {i}", _vector(row)] for i, row in enumerate(facts["a"], 1)]
    rows += [["B, transposed", _vector(np.ravel(facts["b"]))], ["C", _vector(np.ravel(facts["c"]))]]
    rows.append(["poles, rad/s", _poles([complex(*pole) for pole in facts["poles_rad_s"]])])
    head = ["", "here"]
    caption = (
        "The plant, linear about its equilibrium: dz/dt = A z + B v and y = C z, with z the deviations of gap, "
        "velocity and current, and v that of the voltage; SI units. From the manifest of control."
    )
    if papers:
        printed = [*map(_vector, PAPER_A), _vector(PAPER_B), _vector(PAPER_C), _poles(np.linalg.eigvals(PAPER_A))]
        rows = [[*row, text] for row, text in zip(rows, printed, strict=True)]
        head.append("printed in the paper")
        caption += " The paper prints no poles: those of its printed A stand there."
    return Table(caption, head, rows, labels=len(head))


def _vector(values: Any) -> str:
    """With five digits, as the paper prints them."""
    return "[" + ", ".join(plain(float(f"{value:.5g}") + 0.0) for value in values) + "]"


def _poles(poles: Any) -> str:
    """The poles, fastest growing first, a conjugate pair as one."""
    texts = []
    for pole in sorted((complex(p) for p in poles), key=lambda p: (-round(p.real, 9), p.imag)):
        if pole.imag > 0:
            texts.append(f"{number(pole.real, 4)} ± {number(pole.imag, 4)}j")
        elif pole.imag == 0:
            texts.append(number(pole.real, 4))
    return ", ".join(texts)


def _locus(control: Artefact) -> list[Block]:
    locus, ranges = _table_of(control, "root_locus"), control.facts.get("kp_ranges")
    if locus is None or ranges is None:
        return _older("root locus")
    kp = float(control.manifest.settings["control"]["pid"]["kp"])
    gains = f"{plain(float(locus['kp'].min()))} to {whole(locus['kp'].max())} V/m"
    caption = (
        f"Poles of the loop of the PID for {whole(locus['kp'].nunique())} values of Kp from {gains}, Kd and Ki as in "
        "the recipe. Left: all of them; in the middle those near the origin; tinted: unstable. Right: the largest real "
        "part of the poles; shaded: the stable range in continuous time; dashed and dotted: the limits of the range "
        "where the voltage is held for a plant step. Rings: the recipe’s Kp. From control (root_locus.parquet)."
    )
    label = "Root locus of the PID over Kp, and the largest real part over Kp with the stable ranges."
    figure = partial(figures_plant.root_locus_figure, locus, ranges, kp)
    return [Plot("root-locus", figure, caption, label), Paragraph(_ranges_sentence(control.facts, kp))]


def _ranges_sentence(facts: Mapping[str, Any], kp: float) -> str:
    found = {str(one["sampling"]): one for one in facts["kp_ranges"]}
    parts = []
    for sampling, words in _SAMPLING_WORDS.items():
        one = found.get(sampling)
        step = "" if one is None or one["step_s"] is None else f" with steps of {plain(1e3 * one['step_s'])} ms"
        where = "nowhere" if one is None else f"from {whole(one['lowest'])} to {whole(one['highest'])} V/m"
        parts.append(f"{where} {words}{step}")
    text = f"With the recipe’s Kd and Ki the loop of the PID is stable for Kp {listing(parts)}."
    text += f" The recipe has {kp:,.6g} V/m"
    margin = facts.get("margins", {}).get("pid")
    if margin is None or not margin["stable"]:
        return text + ("." if margin is None else ", where the loop is unstable as given.")
    changes = {
        "gain_margin_down": "its gain falls to {} times what it is",
        "gain_margin_up": "its gain rises to {} times",
        "phase_margin_deg": "its phase shifts by {}°",
        "delay_margin_s": "{} ms of delay are added",
    }
    bounds = [words.format(_bound(margin, key)) for key, words in changes.items() if margin[key]]
    return text + (f"; there it turns unstable if {', or '.join(bounds)}." if bounds else ".")


def _bound(margin: Mapping[str, Any], key: str) -> str:
    value = margin[key]
    return "any" if value is None else number(1e3 * value if key == "delay_margin_s" else value)


def _margins(control: Artefact) -> list[Block]:
    margins = control.facts.get("margins")
    if not margins:
        return _older("margins")
    rows = []
    order = [*(name for name in CONTROLLERS if name in margins), *(name for name in margins if name not in CONTROLLERS)]
    for name in order:
        found = margins[name]
        row = [NOTHING] * 5
        if found["stable"]:
            row = [_bound(found, key) for key in ("gain_margin_down", "gain_margin_up", "phase_margin_deg")]
            row += [number(found["crossover_rad_s"]), _bound(found, "delay_margin_s")]
        rows.append([controller_stroke(name).label, *row, "stable" if found["stable"] else "unstable as given"])
    head = ["controller", "gain: lowest factor", "highest factor", "phase, °", "at, rad/s", "delay, ms", "loop"]
    caption = (
        "Margins of the loops on the linear plant in continuous time, each broken at the plant’s input: how far gain, "
        "phase and delay may change before the loop becomes unstable. Any: no change of that kind does. The filter of "
        "LQI + EKF is not linear and has none. From the manifest of control."
    )
    return [Table(caption, head, rows)]


def _steps(control: Artefact) -> list[Block]:
    responses = _table_of(control, "responses")
    if responses is None:
        return _older("responses")
    settings = control.manifest.settings["control"]
    caption = (
        f"The gap over the first {plain(STEPS_S)} s from several starts: on the linear plant, which has neither stops "
        "nor a voltage limit, beside the nonlinear plant, which has both. Every panel has the range of the nonlinear "
        f"plant; an arrow says how far lines go beyond it. Dotted: the set-point.{_disturbed(settings)} From control "
        "(responses.parquet)."
    )
    set_point = control.facts["equilibrium"]["gap_m"] if "equilibrium" in control.facts else None
    figure = partial(figures_plant.step_responses_figure, responses, set_point, STEPS_S)
    names = [controller_stroke(str(name)).label for name in dict.fromkeys(responses["controller"])]
    label = f"Gap over time on the linear and the nonlinear plant, for {listing(names)}."
    return [Plot("steps", figure, caption, label)]


def _disturbed(settings: Mapping[str, Any]) -> str:
    load, noise = settings.get("constant_load_n", 0), settings.get("force_noise_std_n", 0)
    error = settings.get("mass_error_share", 0)
    parts = [f"a constant load of {number(load)} N"] if load else []
    parts += [f"a random force of {number(noise)} N"] if noise else []
    parts += [f"a mass off by {percent(error)}"] if error else []
    return f" With {listing(parts)}." if parts else ""


def _robustness(control: Artefact, plant: Plant | None) -> list[Block]:
    table = _table_of(control, "robustness")
    if table is None:
        return _older("map of robustness")
    limit = control.manifest.settings.get("mdp", {}).get("voltage_limit_v")
    duration = control.manifest.settings["control"].get("robustness_duration_s")
    followed = "" if duration is None else f" Each case is followed for {plain(duration)} s."
    caption = (
        "What each controller survives on the nonlinear plant. Above: start against mass, at the recipe’s voltage "
        "limit; below: start against voltage limit, at the nominal mass. The controllers know the nominal plant only. "
        "Survives: over the last 20 % of the response no stop is touched; within 0.5 mm: nor is the gap ever farther "
        f"than that from the set-point. Dashed: what the recipe has.{followed} From control (robustness.parquet)."
    )
    label = "Maps of what each controller survives, over start and mass and over start and voltage limit."
    figure = partial(figures_plant.robustness_figure, table, plant, None if limit is None else float(limit))
    return [Plot("robustness", figure, caption, label), _survival_table(table)]


def _survival_table(table: pd.DataFrame) -> Table:
    table = table.assign(verdict=figures_plant.robustness_classes(table))
    rows = []
    for name, tried in table.groupby("controller", sort=False):
        row = [controller_stroke(str(name)).label]
        for kind, *_ in figures_plant.MAPS:
            verdict = tried.loc[tried["map"] == kind, "verdict"]
            row += [percent(float((verdict <= best).mean())) for best in (1, 0)]
        rows.append(row)
    cases = len(table) // max(1, len(rows) * len(figures_plant.MAPS))
    head = ["controller", "masses: survives", "within 0.5 mm", "voltage limits: survives", "within 0.5 mm"]
    caption = f"Shares of the {whole(cases)} cases of each map. From control (robustness.parquet)."
    return Table(caption, head, rows)


def _claims(control: Artefact) -> list[Block]:
    table = _table_of(control, "claims")
    if table is None:
        text = "The paper’s statements were not tested: with `claims = true` in the recipe’s table [control], run"
        return [Paragraph(text, "note", CONTROL)]
    counts = table["verdict"].value_counts()
    parts = [f"{whole(counts[verdict])} {verdict}" for verdict in _VERDICT_MARKS if verdict in counts]
    text = (
        f"{whole(table['statement'].nunique())} statements of the paper were tested in {whole(len(table))} settings, "
    )
    text += f"on the paper’s plant whatever the recipe: {listing(parts)}."
    columns = ["statement", "section", "paper", "measured", "setting", "verdict"]
    rows = [[str(row[column]) for column in columns] for row in table.to_dict("records")]
    caption = (
        "The paper’s statements held against this code, with the setting each was measured in. Not testable: the paper "
        "gives no number, and the table says what it is here. From control (claims.parquet)."
    )
    marks = [_VERDICT_MARKS.get(str(verdict), "") for verdict in table["verdict"]]
    return [
        Paragraph(text),
        Table(caption, columns, rows, labels=len(columns), marks=marks),
    ]
