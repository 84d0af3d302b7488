"""The table of what balance changed."""

from collections.abc import Mapping
from typing import Any

from maglev_offline.report.numbers import number, percent, whole
from maglev_offline.report.page import Table


def coverage_table(facts: Mapping[str, Any]) -> Table:
    """Lay out the facts of a manifest of transitions, before and after."""
    before, after = facts["occupancy_before"], facts["occupancy_after"]
    rows = [
        ["rows", whole(before["rows"]), whole(after["rows"])],
        ["occupied cells", whole(before["occupied_cells"]), whole(after["occupied_cells"])],
        ["entropy of the cells, nats", number(before["entropy"]), number(after["entropy"])],
        [
            "effective cells (inverse Simpson index)",
            number(before["effective_cells"]),
            number(after["effective_cells"]),
        ],
        *_newer_rows(facts),
        ["effective sample size", whole(before["rows"]), number(facts["effective_sample_size"], 4)],
        ["low-cost rows", whole(facts["low_cost_rows_before"]), whole(facts["low_cost_rows_after"])],
        ["mean cost of a row", number(facts["mean_cost_before"]), number(facts["mean_cost_after"])],
        *_cost_rows(facts),
    ]
    caption = (
        f"What balance ({facts.get('balance', 'cells')}) changed. Effective sample size (Kish): how many rows of the "
        "log the curated ones are worth, when weighted back to the log’s own shares. Discrepancy: squared centred L2, "
        "0 is even. Visited states: the share of those of an episode in the simulator that have a row near them. From "
        "the manifest of transitions."
    )
    return Table(caption, ["", "before", "after"], rows)


def _newer_rows(facts: Mapping[str, Any]) -> list[list[str]]:
    """What transitions of earlier versions do not say."""
    rows = []
    uneven, visited = facts.get("discrepancy"), facts.get("visited_states")
    if uneven is not None:
        label = f"discrepancy of {whole(uneven['rows'])} rows"
        rows.append([label, number(uneven["before"]), number(uneven["after"])])
    if visited is not None:
        rows += [
            [
                f"states visited by the {name.upper()} with a row within {visited['distance']:g} scales",
                percent(found["before"]),
                percent(found["after"]),
            ]
            for name, found in visited["policies"].items()
        ]
    return rows


def _cost_rows(facts: Mapping[str, Any]) -> list[list[str]]:
    quantiles = facts.get("cost_quantiles")
    if quantiles is None:
        return []
    columns = zip(quantiles["levels"], quantiles["before"], quantiles["after"], strict=True)
    return [
        [f"{percent(level)} quantile of the cost", number(before), number(after)]
        for level, before, after in columns
        if 0 < level < 1
    ]
