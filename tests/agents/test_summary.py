import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.agents.summary import COLUMNS, Spread, classical, policies
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.control.settings import ControlSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

NEVER = float("nan")


@pytest.fixture
def curves():
    """Two seeds, three evaluations; seed 0 was best at step 50, seed 1 at the end."""
    return pd.DataFrame(
        {
            "algorithm": "td3",
            "arm": "empty",
            "seed": [0, 0, 0, 1, 1, 1],
            "env_step": [0, 50, 100] * 2,
            "return": [-90.0, -10.0, -30.0, -95.0, -40.0, -20.0],
            "selection_cost": [90.0, 10.0, 30.0, 95.0, 40.0, 20.0],
            "settling_time_s": [NEVER, 0.2, NEVER, NEVER, NEVER, 0.1],
            "overshoot": [0.0, 0.1, 0.2, 0.0, 0.1, 0.4],
            "steady_state_bias_m": [5e-3, 1e-4, 1e-3, 5e-3, 2e-3, -2e-4],
            "worst_error_m": [5e-3, 4e-4, 2e-3, 5e-3, 3e-3, 5e-4],
        }
    )


def test_last_and_best_of_each_seed_are_told_as_median_and_range(curves):
    last, best = policies(curves)
    assert (last.policy, best.policy) == ("td3-empty, last", "td3-empty, best")
    assert last.reward == Spread(-25.0, -30.0, -20.0)
    assert best.reward == Spread(-15.0, -20.0, -10.0)
    assert best.settling_time_s == pytest.approx((0.15, 0.1, 0.2))
    assert (last.within, best.within) == (1, 2)


def test_a_seed_that_never_settles_is_not_dropped(curves):
    last, _ = policies(curves)
    assert last.settling_time_s == (np.inf, 0.1, np.inf)
    assert last.plain()["settling_time_s"] == {"median": None, "least": 0.1, "greatest": None}
    assert last.cells() == [
        "td3-empty, last", "-25.0 (-30.0..-20.0)", "never (0.10..never)", "30% (20%..40%)", "+0.40 (-0.20..+1.00)",
        "1 of 2",
    ]  # fmt: skip
    assert len(last.cells()) == len(COLUMNS)


def test_the_order_of_the_rows_does_not_matter(curves):
    assert policies(curves.sample(frac=1, random_state=3).reset_index(drop=True)) == policies(curves)


def test_the_classical_controllers_are_scored_by_the_same_cost_on_the_same_starts():
    plant, mdp, evaluation = Plant(), Mdp(), EvaluationSettings()
    found = {standing.policy: standing for standing in classical(plant, mdp, evaluation, ControlSettings())}
    assert list(found) == ["LQR every 10 ms", "LQR", "LQI", "PID"]
    cost = classical_reference_cost(plant, mdp, evaluation.start_gaps_m)
    assert found["LQR every 10 ms"].reward.median == pytest.approx(-cost["lqr_held"].mean())
    assert found["PID"].reward.median == pytest.approx(-cost["pid"].mean())
    assert found["LQI"].settling_time_s.median < 0.2
    assert found["PID"].cells()[2] == "never"
    assert (found["LQR"].cells()[-1], found["PID"].cells()[-1]) == ("yes", "no")
