from maglev_offline.report.coverage_table import coverage_table

SHARES = {"rows": 900, "occupied_cells": 50, "entropy": 2.5, "effective_cells": 9.0}
OLD = {
    "occupancy_before": SHARES,
    "occupancy_after": {**SHARES, "rows": 100},
    "effective_sample_size": 60.0,
    "low_cost_rows_before": 225,
    "low_cost_rows_after": 20,
    "mean_cost_before": 1.0,
    "mean_cost_after": 2.0,
}
NEW = {
    **OLD,
    "balance": "coverage",
    "discrepancy": {"before": 0.25, "after": 0.1, "rows": 100},
    "visited_states": {"distance": 0.2, "policies": {"lqr": {"states": 500, "before": 0.81, "after": 0.5}}},
    "cost_quantiles": {"levels": [0.0, 0.5, 1.0], "before": [0.0, 0.3, 9.0], "after": [0.0, 0.7, 9.0]},
}


def cells(facts):
    return {row[0]: row[1:] for row in coverage_table(facts).rows}


def test_every_measure_stands_before_and_after():
    found = cells(NEW)
    assert found["rows"] == ["900", "100"]
    assert found["discrepancy of 100 rows"] == ["0.250", "0.100"]
    near = next(row for label, row in found.items() if "visited by the LQR with a row within 0.2" in label)
    assert [text[:2] for text in near] == ["81", "50"]
    assert [row for label, row in found.items() if "quantile of the cost" in label] == [["0.300", "0.700"]]
    assert "(coverage)" in coverage_table(NEW).caption


def test_transitions_of_an_earlier_version_have_the_rows_that_they_know_of():
    assert len(cells(OLD)) == 7
    assert "(cells)" in coverage_table(OLD).caption
