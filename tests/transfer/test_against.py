"""One arm held against another, where the recipe asks for it."""

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from maglev_offline.transfer.against import held_against, pairs_of
from maglev_offline.transfer.settings import TransferSettings

ARM = {"better": {"against": ["alike", "worse"]}, "alike": {}, "worse": {}}
SETTINGS = TransferSettings.model_validate({"arms": ["empty", *ARM], "arm": ARM, "resamples": 200})


def test_pairs_are_those_of_the_recipe():
    assert pairs_of(SETTINGS) == [("better", "alike"), ("better", "worse")]
    with pytest.raises(ValidationError, match="none of the arms"):
        TransferSettings.model_validate({"arms": ["empty", "better"], "arm": ARM})


def test_a_planted_difference_is_found_and_none_where_there_is_none():
    noise = np.random.default_rng(0).normal(size=(3, 20))
    cost = {"better": 10 + noise[0], "alike": 10 + noise[1], "worse": 14 + noise[2]}
    table = pd.concat(
        pd.DataFrame({"algorithm": "td3", "arm": arm, "seed": range(20), "area": values})
        for arm, values in cost.items()
    )
    found = held_against(table, SETTINGS, {"area": 0.5}, ["td3"])["comparisons"]
    verdicts = {row["against"]: row["verdict"] for row in found}
    assert verdicts == {"alike": "inconclusive", "worse": "positive"}
    assert [row["holds_after_holm"] for row in found] == [False, True]
