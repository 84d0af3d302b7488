import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.resampling import (
    CONFIDENCE,
    LEAST_LOGS,
    RESAMPLES,
    interval,
    interval_of_part,
    resamples,
    rows_and_units,
    units_of,
)


def test_stretches_are_resampled_and_logs_where_there_are_enough(simulator_rows):
    table = simulator_rows(300).assign(segment=0)
    kind, unit = units_of(table)
    assert kind == "stretches"
    assert unit.tolist() == np.repeat([0, 1, 2], 100).tolist()  # 10 s of samples 100 ms apart
    many = pd.concat([table.iloc[:5].assign(log_id=f"log-{n}") for n in range(LEAST_LOGS)])
    assert units_of(many)[0] == "logs"
    assert len(np.unique(units_of(many)[1])) == LEAST_LOGS


def test_a_resample_draws_as_many_units_as_there_are():
    counts = resamples(np.random.default_rng(0), 7)
    assert counts.shape == (RESAMPLES, 7)
    assert (counts.sum(axis=1) == 7).all()


def test_an_interval_is_that_of_the_quantiles_and_needs_a_value_in_every_resample():
    values = np.linspace(0, 1, 1001)
    assert interval(values) == pytest.approx(((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    assert interval(np.append(values, np.nan)) is None


def test_resamples_that_hold_nothing_of_a_part_are_left_out_of_its_interval():
    values = np.linspace(0, 1, 1001)
    assert interval_of_part(np.append(values, [np.nan] * 50)) == interval(values)
    assert interval_of_part(np.full(3, np.nan)) is None


def test_rows_and_units_of_each_part_are_counted():
    rows, units = rows_and_units(np.array([0, 0, 0, 2]), np.array([5, 5, 7, 5]), 3)
    assert rows.tolist() == [3, 0, 1]
    assert units.tolist() == [2, 0, 1]
