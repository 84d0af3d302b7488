import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from maglev_offline.curate.rules import Rule, fits, left_out_by
from maglev_offline.errors import RecipeError
from maglev_offline.recipe import parse_recipe

TABLE = pd.DataFrame(
    {
        "gap_error_m": [-0.002, -0.001, 0.0, 0.002, np.nan],
        "cost": [4.0, 1.0, 0.0, 4.0, 1.0],
        "log_id": ["a", "a", "b", "b", "c"],
        "point": ["P1", "P2", "P1", "P2", "P1"],
    }
)


def test_a_range_has_both_its_ends_and_no_value_that_is_not_finite():
    assert fits(TABLE, Rule(gap_error_m=(-0.001, 0.002))).tolist() == [False, True, True, True, False]


def test_a_row_fits_a_rule_where_it_fits_all_of_it():
    assert fits(TABLE, Rule(cost=(0, 2), log_id=("a", "c"))).tolist() == [False, True, False, False, True]
    assert fits(TABLE, Rule(point=("P2",))).tolist() == [False, True, False, True, False]


def test_a_row_is_left_out_that_fits_an_exclude_rule_or_none_of_the_include_rules():
    include, exclude = [Rule(log_id=("a",)), Rule(cost=(0, 0))], [Rule(point=("P2",)), Rule(log_id=("c",))]
    excluded, not_included = left_out_by(TABLE, include, exclude)
    assert excluded.tolist() == [False, True, False, True, True]
    assert not_included.tolist() == [False, False, False, True, True]


def test_without_rules_all_rows_are_used():
    assert not np.any(left_out_by(TABLE, [], []))


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ({}, "a rule needs a range"),
        ({"cost": (2, 1)}, r"cost must be \[smallest, largest\], not \[2, 1\]"),
        ({"log_id": ()}, "log_id must name one"),
        ({"cost": (0, float("inf"))}, "finite"),
    ],
)
def test_a_rule_that_cannot_be_meant_is_refused(rule, message):
    with pytest.raises(ValidationError, match=message):
        Rule(**rule)


def test_a_recipe_says_which_rule_is_wrong_and_which_column_was_meant():
    data = {"curate": {"exclude": [{"cost": [0, 1]}, {"gap_errors_m": [0, 1]}], "include": [{"cost": [2, 1]}]}}
    with pytest.raises(RecipeError) as refused:
        parse_recipe(data, "a.toml")
    assert "[curate] exclude[1].gap_errors_m: unknown key (did you mean `gap_error_m`?)" in str(refused.value)
    assert "cost must be [smallest, largest]" in str(refused.value)
