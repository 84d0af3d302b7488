import numpy as np
import pandas as pd
import pytest

from maglev_offline.transfer.cure import candidates_of, confirmed_cures
from maglev_offline.transfer.judgement import METRICS
from maglev_offline.transfer.settings import ArmSettings, TransferSettings

SETTINGS = TransferSettings(resamples=300)
MARGINS = dict.fromkeys(METRICS, 0.05)


def table(arms):
    return pd.DataFrame(
        [
            {"algorithm": "td3", "arm": arm, "seed": seed, "area": value}
            for arm, values in arms.items()
            for seed, value in enumerate(values)
        ]
    )


def cured(arms):
    names = [name for name in arms if name != "empty"]
    return confirmed_cures(table(arms), names, SETTINGS, MARGINS, ["td3"])["algorithms"]["td3"]


def test_a_real_cure_is_chosen_and_confirmed():
    rng = np.random.default_rng(0)
    empty = rng.normal(20, 4, 20)
    found = cured({"empty": empty, "idle": empty + rng.normal(0, 0.3, 20), "cure": empty - 2 + rng.normal(0, 0.3, 20)})
    assert found["chosen"] == "cure"
    assert found["confirmed"]["verdict"] == "positive"
    assert (found["choosing_seeds"], found["confirming_seeds"]) == (list(range(10)), list(range(10, 20)))


def test_what_only_looked_good_to_the_seeds_that_chose_it_is_not_confirmed():
    empty = np.full(20, 20.0)
    lucky = np.r_[np.full(10, 15.0), np.full(10, 21.0)]
    found = cured({"empty": empty, "lucky": lucky, "steady": empty - 1})
    assert found["chosen"] == "lucky"
    assert found["differences_when_chosen"] == {"lucky": 5.0, "steady": 1.0}
    assert found["confirmed"]["verdict"] == "negative"


def test_the_best_of_many_useless_arms_is_confirmed_no_more_often_than_chance_admits():
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(60):
        empty = rng.normal(20, 1, 16)
        found = cured({"empty": empty} | {f"arm{k}": rng.normal(20, 1, 16) for k in range(8)})
        alarms += found["confirmed"]["verdict"] == "positive"
    assert alarms <= 5  # 2.5 % nominal; without the halves the best of eight would be positive in most


def test_one_seed_confirms_nothing():
    found = confirmed_cures(table({"empty": [1.0], "cure": [0.5]}), ["cure"], SETTINGS, MARGINS, ["td3"])
    assert found["algorithms"] == {}


@pytest.mark.parametrize(("arms", "expected"), [(("empty", "half"), ["half"]), (("empty", "prefill"), [])])
def test_cures_are_the_arms_that_the_recipe_names_so(arms, expected):
    settings = TransferSettings(arms=arms, arm={"half": ArmSettings(cure=True, training={"mixing_share": 0.5})})
    assert candidates_of(settings) == expected
