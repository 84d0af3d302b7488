import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.curate.rules import Rule, fits
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.transfer.arms import plan_of
from maglev_offline.transfer.attribution import Part, attribute, parts_of, plan_without
from maglev_offline.transfer.judgement import METRICS
from maglev_offline.transfer.settings import TransferSettings

MDP = Mdp()
SETTINGS = TransferSettings(resamples=300)
MARGINS = dict.fromkeys(METRICS, 0.05)


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(0)
    return pd.DataFrame(
        {
            "gap_error_m": rng.normal(0, 0.002, 500),
            "gap_velocity_m_s": rng.normal(0, 0.05, 500),
            "cost": rng.exponential(0.1, 500),
            "log_id": rng.choice(["log-a", "log-b", "log-c"], 500, p=[0.6, 0.395, 0.005]),
        }
    )


@pytest.mark.parametrize(("kind", "count"), [("cells", 9), ("cost_bands", 4)])
def test_every_row_belongs_to_just_one_part_of_a_kind(rows, kind, count):
    parts = parts_of(rows, [kind], MDP)
    assert len(parts) == count
    belongs = np.sum([fits(rows, part.rule) for part in parts], axis=0)
    assert (belongs == 1).mean() > 0.98  # the edges of cost bands lie on rows
    assert (belongs >= 1).all()
    assert [part.share for part in parts] == pytest.approx([fits(rows, part.rule).mean() for part in parts])


def test_what_is_hardly_there_is_no_part(rows):
    parts = parts_of(rows, ["logs"], MDP)
    assert [(part.name, part.rule.log_id) for part in parts] == [("log-1", ("log-a",)), ("log-2", ("log-b",))]


def test_a_whole_is_no_part_of_itself(rows):
    assert parts_of(rows[rows["log_id"] == "log-a"], ["logs"], MDP) == []


def test_an_arm_without_a_part_has_one_more_rule_and_nothing_else_is_different():
    curate = CurateSettings(exclude=(Rule(point=("F9",)),))
    settings = TransferSettings()
    training = TrainingSettings()
    whole = plan_of("prefill", settings, curate, training)
    part = Part("logs", "log-1", Rule(log_id=("log-a",)), 0.5)
    found = plan_without(part, whole, curate)
    assert (found.name, found.rows, found.training) == ("prefill-without-log-1", "log", training)
    assert found.curate == curate.model_copy(update={"exclude": (*curate.exclude, part.rule)})


def test_the_part_that_harms_and_the_part_that_helps_are_told_apart():
    rng = np.random.default_rng(1)
    whole = rng.normal(20, 4, 12)
    arms = {
        "empty": whole - 5,
        "prefill": whole,
        "prefill-without-bad": whole - 2 + rng.normal(0, 0.1, 12),
        "prefill-without-good": whole + 3 + rng.normal(0, 0.1, 12),
        "prefill-without-idle": whole + np.resize([0.005, -0.005], 12),
    }
    table = pd.DataFrame(
        [
            {"algorithm": "td3", "arm": arm, "seed": seed, "area": value}
            for arm, values in arms.items()
            for seed, value in enumerate(values)
        ]
    )
    parts = [Part("logs", name, Rule(log_id=(name,)), 0.3) for name in ("bad", "good", "idle")]
    found = attribute(table, parts, "prefill", SETTINGS, MARGINS, ["td3"])
    assert (found["of"], found["metric"]) == ("prefill", "area")
    assert {row["part"]: row["meaning"] for row in found["parts"]} == {
        "bad": "harms", "good": "helps", "idle": "does not matter"
    }  # fmt: skip
    assert found["parts"][0]["difference"] == pytest.approx(2, abs=0.1)
    assert found["parts"][0]["rule"] == {"log_id": ["bad"]}
    assert found["parts"][0]["holds_after_holm"]
    assert not found["parts"][2]["holds_after_holm"]
