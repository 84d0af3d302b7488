import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents.stage import load_curves
from maglev_offline.control.settings import ControlSettings
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import ArtefactError
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.transfer.arm_rows import Sources, prefill_of, shuffled, transitions_of
from maglev_offline.transfer.arms import plan_of
from maglev_offline.workspace import Manifest

SOURCES = Sources(CurateSettings(), PrefillSettings(), ControlSettings())


@pytest.fixture(scope="module")
def several_arms(tmp_path_factory, with_transitions, study_in, judged):
    workspace = with_transitions(tmp_path_factory.mktemp("arms"))
    arms = ("empty", "prefill", "shuffled", "random_policy", "pid")
    study_in(workspace, transfer=judged.model_copy(update={"arms": arms}))
    return workspace


def rows_of(workspace, arm):
    return pd.read_parquet(workspace.path("arms", arm, "transitions", "transitions.parquet"))


def test_every_arm_is_trained_and_compared_with_the_empty_one(several_arms):
    facts = Manifest.read(several_arms.path("transfer")).facts
    assert sorted(facts["algorithms"]["ddpg"]["effects"]) == ["pid", "prefill", "random_policy", "shuffled"]
    curves = load_curves(sorted(several_arms.path("training").glob("ddpg-*/seeds-*")))
    costs = curves.pivot(index=["seed", "env_step"], columns="arm", values="cost")
    assert (costs.loc[(0, 0)] == costs.loc[(0, 0), "empty"]).all()
    assert costs.loc[(0, 300)].nunique() == 5


def test_every_arm_has_as_many_rows_as_the_curated_log(several_arms):
    for arm in ("shuffled", "random_policy", "pid"):
        assert len(rows_of(several_arms, arm)) == 30
        assert Manifest.read(several_arms.path("arms", arm, "ddpg")).counts["rows"] == 30


def test_the_verdict_before_training_stands_beside_the_outcome(several_arms):
    facts = Manifest.read(several_arms.path("transfer")).facts
    assert {arm: (rows["rows_from"], rows["rows"]) for arm, rows in facts["rows"].items()} == {
        "prefill": ("log", 30), "shuffled": ("shuffled", 30), "random_policy": ("random_policy", 30), "pid": ("pid", 30)
    }  # fmt: skip
    assert facts["rows"]["pid"]["diagnostic"]["verdict"] == "fit"
    assert facts["rows"]["shuffled"]["diagnostic"]["error_over_advantage_std"] > 0.5
    counted = [n for row in facts["foretelling"]["calibration"].values() for n in row.values()]
    assert sum(counted) == 4


def test_shuffled_rows_have_the_same_states_costs_and_voltages_and_other_pairs_of_them(several_arms):
    logged = pd.read_parquet(several_arms.path("transitions", "transitions.parquet"))
    mixed = rows_of(several_arms, "shuffled")
    others = [name for name in logged if name != "voltage_deviation_v"]
    pd.testing.assert_frame_equal(mixed[others], logged[others])
    assert sorted(mixed["voltage_deviation_v"]) == sorted(logged["voltage_deviation_v"])
    assert (mixed["voltage_deviation_v"] != logged["voltage_deviation_v"]).mean() > 0.8


def test_the_same_seed_shuffles_in_the_same_way(several_arms):
    logged = pd.read_parquet(several_arms.path("transitions", "transitions.parquet"))
    pd.testing.assert_frame_equal(shuffled(logged, 3), shuffled(logged, 3))
    assert not shuffled(logged, 3).equals(shuffled(logged, 4))


def test_rows_that_are_there_are_not_made_again(several_arms, tiny_world, judged):
    plan = plan_of("pid", judged, SOURCES.curate, tiny_world.training)
    before = several_arms.path("arms", "pid", "transitions", "manifest.json").stat().st_mtime_ns
    folder = transitions_of(several_arms, plan, tiny_world, SOURCES)
    assert (folder / "manifest.json").stat().st_mtime_ns == before
    assert (
        prefill_of(
            several_arms, plan_of("empty", judged, *SOURCES[:1], tiny_world.training), "ddpg", tiny_world, SOURCES
        )
        is None
    )


def test_pid_rows_are_what_the_pid_does_at_the_control_period(several_arms, tiny_world):
    table = rows_of(several_arms, "pid")
    first = table[table["step"] == 0]
    expected = np.clip(3100 * first["gap_error_m"], -200, 200)
    np.testing.assert_allclose(first["voltage_deviation_v"], expected)
    assert table["duration_s"].eq(tiny_world.mdp.control_period_ms / 1e3).all()


def test_rows_of_another_process_are_no_base_for_an_arm(several_arms, tiny_world, judged):
    other = tiny_world._replace(mdp=tiny_world.mdp.model_copy(update={"discount": 0.5}))
    plan = plan_of("shuffled", judged, SOURCES.curate, tiny_world.training)
    with pytest.raises(ArtefactError, match=r"another \[plant\] or \[mdp\] than this recipe has"):
        transitions_of(several_arms, plan, other, SOURCES)


def test_training_names_the_rows_that_each_arm_really_started_with(several_arms):
    inputs = {
        arm: list(Manifest.read(several_arms.path("training", f"ddpg-{arm}", "seeds-0000-0001")).inputs)
        for arm in ("empty", "prefill", "shuffled")
    }
    assert inputs == {"empty": [], "prefill": ["prefill/ddpg"], "shuffled": ["arms/shuffled/ddpg"]}
