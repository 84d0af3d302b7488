from typing import get_args

import numpy as np
import pytest

from maglev_offline.curate.balance import BALANCES, choose
from maglev_offline.curate.balance.quota import balanced_choice
from maglev_offline.curate.settings import BalanceName, CurateSettings
from maglev_offline.streams import stream


def test_every_name_of_a_recipe_has_its_balance():
    assert tuple(BALANCES) == get_args(BalanceName)


@pytest.mark.parametrize("name", BALANCES)
@pytest.mark.parametrize("target", [1, 37, 400, 500])
def test_every_balance_chooses_as_many_different_rows_as_asked_for_or_all_of_them(log_rows, name, target):
    chosen = choose(log_rows(400), CurateSettings(balance=name, target_rows=target))
    assert len(chosen) == min(target, 400)
    assert (np.diff(chosen) > 0).all()
    assert (chosen[0] >= 0, chosen[-1] < 400) == (True, True)


@pytest.mark.parametrize("name", BALANCES)
def test_the_same_seed_chooses_the_same_rows_and_another_one_others(log_rows, name):
    settings = CurateSettings(balance=name, target_rows=100)
    first, again = (choose(log_rows(1000), settings) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, choose(log_rows(1000), settings.model_copy(update={"seed": 1})))


@pytest.mark.parametrize("name", BALANCES)
def test_rows_that_are_all_alike_can_be_balanced(log_rows, name):
    rows = log_rows(50)
    alike = rows._replace(values=np.zeros((50, 4)), cost=np.zeros(50), cell=np.zeros(50, dtype=np.int64))
    assert len(choose(alike, CurateSettings(balance=name, target_rows=7))) == 7


def test_the_default_chooses_from_cells_of_equal_width(log_rows):
    rows, settings = log_rows(1000), CurateSettings(target_rows=100)
    expected = balanced_choice(rows.cell, 100, stream(0, "curate: balance"))
    np.testing.assert_array_equal(choose(rows, settings), expected)
