"""What every construction promises."""

from typing import get_args

import numpy as np
import pytest

from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.settings import ConstructionName
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()
COLUMNS = [
    "gap_error_m", "gap_velocity_m_s", "current_error_a", "voltage_deviation_v", "cost",
    "next_gap_error_m", "next_gap_velocity_m_s", "next_current_error_a",
    "duration_s", "discount", "terminated", "truncated", "origin", "uncertainty",
    "log_id", "point", "t", "segment", "step", "substep",
]  # fmt: skip


def test_every_name_of_a_recipe_has_its_construction():
    assert set(CONSTRUCTIONS) == set(get_args(ConstructionName))


@pytest.mark.parametrize("name", CONSTRUCTIONS)
def test_rows_have_the_same_columns_and_say_what_made_them(name, wandering):
    table = CONSTRUCTIONS[name](pairs_of(wandering("log-a", 30), PLANT), PLANT, MDP)
    assert list(table.columns) == COLUMNS
    assert (table["origin"] == name).all()
    assert table["truncated"].sum() == 1
    assert np.isfinite(table[COLUMNS[:10]].to_numpy()).all()
    assert (table.groupby("step")["substep"].apply(list).map(lambda x: x == list(range(len(x))))).all()


@pytest.mark.parametrize("name", CONSTRUCTIONS)
def test_no_pairs_give_no_rows(name, samples_of):
    assert len(CONSTRUCTIONS[name](pairs_of(samples_of([0.008]), PLANT), PLANT, MDP)) == 0


@pytest.mark.parametrize("name", [name for name in CONSTRUCTIONS if name != "simulated_next"])
def test_logged_contact_is_paid_for_once_and_ends_the_process_where_it_should(name, samples_of):
    pairs = pairs_of(samples_of([0.012, 0.0159, 0.016], contact=[False, False, True]), PLANT)
    free, paid, ended = (
        CONSTRUCTIONS[name](pairs, PLANT, Mdp(contact_penalty=penalty, terminate_on_contact=ends))
        for penalty, ends in ((0.0, False), (3.0, False), (3.0, True))
    )
    np.testing.assert_allclose((paid["cost"] - free["cost"]).iloc[-1], 3.0)
    np.testing.assert_allclose((paid["cost"] - free["cost"]).iloc[:-1], 0.0)
    assert ended["terminated"].tolist() == [*[False] * (len(ended) - 1), True]
    assert ended["discount"].iloc[-1] == 0
    assert (ended["discount"].iloc[:-1] > 0).all()
    assert not ended["truncated"].any()
    assert not paid["terminated"].any()
    assert paid["truncated"].iloc[-1]
