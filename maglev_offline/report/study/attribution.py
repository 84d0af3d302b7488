"""Which part of the rows helps or harms: each left out in turn, as a figure and a table."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from maglev_offline.report.numbers import NO_BREAK, interval, listing, number, percent
from maglev_offline.report.page import Table
from maglev_offline.report.study.axes import WIDE, about_zero, draw_effect, margin_band
from maglev_offline.report.study.reading import Facts, arm_label, metric_label, metric_unit
from maglev_offline.report.style import FULL_WIDTH, INK, RULE, SOFT, algorithm_label, figure_style
from maglev_offline.report.typesetting import printable
from maglev_offline.transfer.attribution import BANDS, BEYOND

KINDS = {"logs": "logs", "cells": "cells", "cost_bands": "cost bands"}

_LOOKS = (("#009E73", "o"), ("#7B3294", "s"))
"""Colour and marker of the algorithms, in their order."""

_PLACES = {"near": "near", "at-rest": "middle", "far": "far"}
_MOTIONS = {"closing": "closing", "still": "still", "opening": "opening"}


def part_label(kind: str, name: str) -> str:
    """A part in words: `log 1`, `far, opening`, `cost 1 of 4 (lowest)`."""
    if kind == "cells":
        place, motion = name.removeprefix("cell-").rsplit("-", 1)
        return f"{_PLACES.get(place, place)}, {_MOTIONS.get(motion, motion)}"
    text = name.replace("-", " ")
    ends = {f"cost-1-of-{BANDS}": " (lowest)", f"cost-{BANDS}-of-{BANDS}": " (highest)"}
    return text + ends.get(name, "")


def rule_words(rule: Mapping[str, Any]) -> str:
    """The rule of a part in the units that people read: `gap error < −1.25 mm, velocity ±37.5 mm/s`."""
    names = {"gap_error_m": ("gap error", 1e3, " mm"), "gap_velocity_m_s": ("velocity", 1e3, " mm/s")}
    found = []
    for key, value in rule.items():
        if key == "log_id":
            found.append(listing([printable(str(log)) for log in value]))
            continue
        name, scale, unit = names.get(key, (key.replace("_", " "), 1.0, ""))
        found.append(f"{name} {_range(float(value[0]), float(value[1]), scale)}{unit}".replace(" ", NO_BREAK))
    return ", ".join(found)


def _range(low: float, high: float, scale: float) -> str:
    """`< 2`, `> 2`, `±2` or `1 to 2`."""
    if low <= -BEYOND:
        return f"< {number(scale * high)}"
    if high >= BEYOND:
        return f"> {number(scale * low)}"
    if low == -high:
        return f"±{number(scale * high)}"
    return interval(scale * low, scale * high)


def parts_in_order(parts: Sequence[Facts]) -> list[tuple[str, str]]:
    """Kind and name of each part, kind by kind, each once."""
    return list(dict.fromkeys((part["kind"], part["part"]) for kind in KINDS for part in parts if part["kind"] == kind))


def attribution_figure(facts: Facts) -> Figure:
    """What leaving out each part does, a row for each, a colour and a marker for each algorithm."""
    parts = facts["attribution"]["parts"]
    order = parts_in_order(parts)
    algorithms = list(dict.fromkeys(part["algorithm"] for part in parts))
    looks = {name: _LOOKS[place % len(_LOOKS)] for place, name in enumerate(algorithms)}
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 1.3 + 0.33 * len(order)), layout="constrained")
        ax = figure.subplots()
        values: list[float] = []
        for part in parts:
            shift = 0.34 * (algorithms.index(part["algorithm"]) - (len(algorithms) - 1) / 2)
            y = order.index((part["kind"], part["part"])) + shift
            if part["difference"] is not None:
                colour, marker = looks[part["algorithm"]]
                draw_effect(ax, y, part["low"], part["high"], part["difference"], part["verdict"], colour, marker)
            values += [part[end] for end in ("low", "difference", "high") if part[end] is not None]
        margin = max(part["margin"] for part in parts)
        margin_band(ax, margin)
        scale = about_zero(ax, "x", values, margin, most=5)
        _rows(ax, order, {(part["kind"], part["part"]): part["share_of_rows"] for part in parts})
        what = f"difference in {metric_unit(facts)}{scale}"
        ax.set_xlabel(f"← the part helps{WIDE}{what}{WIDE}the part harms →")
        ax.xaxis.label.set_color(SOFT)
        handles = [
            Line2D([], [], color=colour, marker=marker, linewidth=2.2, label=algorithm_label(name))
            for name, (colour, marker) in looks.items()
        ]
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), columnspacing=1.6)
    return figure


def _rows(ax: Axes, order: Sequence[tuple[str, str]], shares: Mapping[tuple[str, str], float]) -> None:
    """Names to the left, shares of the rows to the right, a rule and the kind's name where a kind begins."""
    ax.set_yticks(range(len(order)), [part_label(*part) for part in order], color=INK)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(order) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.spines["left"].set_visible(False)
    place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "va": "center", "fontsize": 8.5}
    for y, part in enumerate(order):
        ax.annotate(_share(shares[part]), (1.01, y), color=SOFT, **place)
        if y and part[0] != order[y - 1][0]:
            ax.axhline(y - 0.5, color=RULE, linewidth=0.8)
    ax.annotate("rows", (1.01, 1.0), xycoords="axes fraction", va="bottom", fontsize=8.5, color=SOFT)


def _share(share: float) -> str:
    """A share of the rows, all with as many digits."""
    return f"{number(100 * share)}{NO_BREAK}%"


def attribution_caption(facts: Facts, confidence: float) -> str:
    """What the figure shows and where it is from."""
    cells = any(part["kind"] == "cells" for part in facts["attribution"]["parts"])
    about = " Cells: the gap nearer than the set-point, about it, or farther; and how it moves." if cells else ""
    return (
        f"Each part of the rows left out in turn and the rest balanced anew: {metric_label(facts)} of the "
        f"{arm_label(facts, facts['attribution']['of'])} minus that without the part, paired by seed, with the "
        f"{percent(confidence)} bootstrap interval. Filled: the interval decides. Grey band: the margin. Right: the "
        f"part’s share of the rows.{about} Parts overlap in what they teach: their effects do not add up. From "
        "transfer (manifest.json)."
    )


def attribution_table(facts: Facts, confidence: float) -> Table:
    """All parts and algorithms: which rows they are, the difference without them, and what it means."""
    parts = facts["attribution"]["parts"]
    marks_of = {"harms": "negative", "helps": "positive"}
    rows, marks = [], []
    for kind, name in parts_in_order(parts):
        for part in (p for p in parts if (p["kind"], p["part"]) == (kind, name)):
            rows.append(
                [
                    f"{algorithm_label(part['algorithm'])}, {part_label(kind, name)}",
                    rule_words(part["rule"]),
                    _share(part["share_of_rows"]),
                    number(part["difference"]),
                    interval(part["low"], part["high"]),
                    number(part["p_value_holm"], 2),
                    part["meaning"],
                ]
            )
            marks.append(marks_of.get(part["meaning"], part["verdict"]))
    head = ["part", "its rows", "share", "mean difference", f"{percent(confidence)} interval", "p (Holm)", "the part"]
    caption = (
        f"What leaving out a part does to {metric_label(facts)}, in {metric_unit(facts)}: a positive difference means "
        "that it is better without the part, so the part harms. p: corrected by Holm over all parts and algorithms; "
        "what the part does is read from the interval, without correction. From transfer (manifest.json)."
    )
    return Table(caption, head, rows, labels=2, marks=marks, sources=("transfer",))


def attribution_sentences(facts: Facts) -> list[str]:
    """For each algorithm: which parts harm and which help, after Holm's correction, and how many are open."""
    found = []
    parts, whole = facts["attribution"]["parts"], arm_label(facts, facts["attribution"]["of"])
    for algorithm in dict.fromkeys(part["algorithm"] for part in parts):
        own = [part for part in parts if part["algorithm"] == algorithm]
        clauses = []
        for meaning in ("harms", "helps"):
            sure = [p for p in own if p["meaning"] == meaning and p["holds_after_holm"]]
            if sure:
                names = listing([f"“{part_label(p['kind'], p['part'])}”" for p in sure])
                clauses.append(f"{names} {meaning if len(sure) == 1 else meaning[:-1]}")
        said = "; ".join(clauses) if clauses else "no part is shown to help or to harm"
        found.append(
            f"With {algorithm_label(algorithm)}, after Holm’s correction, of {len(own)} parts of its {whole} {said}."
        )
    return found
