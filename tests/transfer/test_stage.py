import json

import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.transfer.judgement import METRICS, compare
from maglev_offline.transfer.metrics import area
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.workspace import Manifest, Workspace


def blocks(workspace):
    """When each trained block was committed."""
    return {p.parent: p.stat().st_mtime_ns for p in workspace.root.glob("training/*/*/manifest.json")}


def test_the_study_leaves_curves_metrics_and_a_verdict(finished):
    folder = finished.path("transfer")
    manifest = Manifest.read(folder)
    curves, metrics = (pd.read_parquet(folder / f"{name}.parquet") for name in ("curves", "metrics"))
    assert manifest.counts == {"runs": 4, "evaluations": 4 * 7}
    assert sorted(curves["env_step"].unique()) == list(range(0, 301, 50))
    assert sorted(zip(metrics["arm"], metrics["seed"], strict=True)) == [
        ("empty", 0), ("empty", 1), ("prefill", 0), ("prefill", 1)
    ]  # fmt: skip
    assert set(manifest.facts["algorithms"]["ddpg"]["effects"]["prefill"]) == set(METRICS)
    assert finished.path("prefill", "ddpg", "manifest.json").is_file()
    assert set(manifest.inputs) == {f"training/ddpg-{arm}/seeds-0000-0001" for arm in ("empty", "prefill")}


def test_both_arms_begin_with_the_same_weights_and_learn_different_policies(finished):
    curves = pd.read_parquet(finished.path("transfer", "curves.parquet"))
    of = {arm: group.pivot(index="seed", columns="env_step", values="cost") for arm, group in curves.groupby("arm")}
    np.testing.assert_array_equal(of["empty"][0], of["prefill"][0])
    np.testing.assert_array_equal(of["empty"][100], of["prefill"][100])
    assert (of["empty"][300] != of["prefill"][300]).all()


def test_the_metrics_are_those_of_the_curves(finished):
    curves, metrics = (pd.read_parquet(finished.path("transfer", f"{n}.parquet")) for n in ("curves", "metrics"))
    for _, run in metrics.iterrows():
        of_run = curves[(curves["arm"] == run["arm"]) & (curves["seed"] == run["seed"])].sort_values("env_step")
        cost = of_run.set_index("env_step")["cost"]
        assert run["jumpstart"] == pytest.approx(cost[[150, 200]].mean())  # after the 100 exploratory steps
        assert run["asymptote"] == pytest.approx(cost[[250, 300]].mean())
        assert run["area"] == pytest.approx(area(cost.index.to_numpy(), cost.to_numpy()[None])[0])
        assert run["drift"] == pytest.approx(cost[300] - cost[250])
        assert run["final_worst_error_m"] == of_run["worst_error_m"].iloc[-1]


def test_the_threshold_belongs_to_the_lqr_and_not_to_an_arm(finished, tiny_world, judged):
    facts = Manifest.read(finished.path("transfer")).facts
    costs = classical_reference_cost(tiny_world.plant, tiny_world.mdp, tiny_world.evaluation.start_gaps_m)
    assert facts["threshold_cost"] == pytest.approx(judged.threshold_over_lqr * costs["lqr_held"].mean())


def test_margins_are_shares_of_the_held_lqrs_cost_and_of_a_run_and_not_of_an_arm(finished, tiny_world, judged):
    facts = Manifest.read(finished.path("transfer")).facts
    lqr = classical_reference_cost(tiny_world.plant, tiny_world.mdp, tiny_world.evaluation.start_gaps_m)["lqr_held"]
    assert facts["primary_metric"] == "area"
    for metric, effect in facts["algorithms"]["ddpg"]["effects"]["prefill"].items():
        whole = tiny_world.training.steps if metric == "time_to_threshold" else lqr.mean()
        assert effect["margin"] == pytest.approx(judged.equivalence_share * whole)


def test_a_finished_study_is_left_alone(finished, study_in):
    before = blocks(finished)
    assert study_in(finished) == (finished.path("transfer"), False)
    assert blocks(finished) == before


def test_more_seeds_train_the_new_block_only(tmp_path, with_transitions, study_in):
    workspace = with_transitions(tmp_path)
    study_in(workspace)
    before = blocks(workspace)
    folder, fresh = study_in(workspace, seeds=4)
    after = blocks(workspace)
    assert fresh
    assert {path: when for path, when in after.items() if path in before} == before
    assert sorted(path.name for path in after.keys() - before.keys()) == ["seeds-0002-0003"] * 2
    assert Manifest.read(folder).counts["runs"] == 8


def test_another_judgement_trains_nothing(tmp_path, with_transitions, study_in, judged):
    workspace = with_transitions(tmp_path)
    study_in(workspace)
    before = blocks(workspace)
    assert study_in(workspace, transfer=judged.model_copy(update={"confidence": 0.9}))[1]
    assert blocks(workspace) == before


def test_two_processes_give_the_same_bytes_as_one(finished, tmp_path, with_transitions, study_in):
    workspace = with_transitions(tmp_path)
    study_in(workspace, jobs=2)
    for name in ("manifest.json", "curves.parquet", "metrics.parquet"):
        assert workspace.path("transfer", name).read_bytes() == finished.path("transfer", name).read_bytes()


def test_an_arm_that_is_named_twice_counts_once(finished, study_in, judged):
    twice = judged.model_copy(update={"arms": ("empty", "prefill", "prefill")})
    folder, _ = study_in(finished, transfer=twice, algorithms=("ddpg", "ddpg"))
    assert Manifest.read(folder).counts["runs"] == 4
    study_in(finished)


@pytest.mark.parametrize("seeds", [1, 2])
def test_the_verdict_is_strict_json_even_where_there_is_no_interval(tmp_path, with_transitions, study_in, seeds):
    workspace = with_transitions(tmp_path)
    folder, _ = study_in(workspace, seeds=seeds, block=1)

    def refuse(name):
        raise AssertionError(name)

    data = json.loads((folder / "manifest.json").read_text(), parse_constant=refuse)
    effect = data["facts"]["algorithms"]["ddpg"]["effects"]["prefill"]["area"]
    assert effect["seeds"] == seeds
    assert effect["verdict"] == "inconclusive"
    assert effect["low"] is None


def test_arms_are_compared_seed_by_seed_whatever_the_order_of_the_rows():
    rng = np.random.default_rng(0)
    base = rng.normal(10, 5, 8)
    rows = [
        dict.fromkeys(METRICS, value) | {"arm": arm, "seed": seed}
        for arm, values in (("empty", base), ("prefill", base + 1 + 0.01 * rng.normal(size=8)))
        for seed, value in enumerate(values)
    ]
    filler = {
        "reached": True,
        "final_worst_error_m": 1e-4,
        "final_settling_time_s": 0.1,
        "drift": 0.0,
        "diverged": False,
    }
    table = pd.DataFrame([row | filler for row in rows]).sample(frac=1, random_state=3)
    settings = TransferSettings(resamples=300, equivalence_share=0.01)
    margins = dict.fromkeys(METRICS, 0.2) | {"asymptote": 5.0}
    effects = compare(table, settings, margins)["effects"]["prefill"]
    assert effects["area"]["difference"] == pytest.approx(-1, abs=0.02)
    assert {metric: effect["margin"] for metric, effect in effects.items()} == margins
    assert effects["area"]["verdict"] == "negative"
    assert effects["asymptote"]["verdict"] == "equivalent"


def test_a_policy_counts_as_within_half_a_millimetre_by_its_worst_error():
    filler = dict.fromkeys(METRICS, 1.0) | {"reached": True, "final_settling_time_s": 0.1, "drift": 0.0}
    errors = [4e-4, 5e-4, 6e-4, 2e-3]
    table = pd.DataFrame(
        [
            filler | {"arm": arm, "seed": seed, "final_worst_error_m": error, "diverged": False}
            for arm in ("empty", "prefill")
            for seed, error in enumerate(errors)
        ]
    )
    facts = compare(table, TransferSettings(resamples=200), dict.fromkeys(METRICS, 0.1))["arms"]["empty"]
    assert facts["share_within_half_mm"] == 0.5
    assert facts["median_final_worst_error_m"] == pytest.approx(5.5e-4)


@pytest.mark.parametrize("arms", [("empty",), ("prefill",), ("empty", "empty")])
def test_a_comparison_needs_the_baseline_and_another_arm(tmp_path, with_transitions, study_in, judged, arms):
    with pytest.raises(InputError, match="a comparison needs the arm 'empty' and another one"):
        study_in(with_transitions(tmp_path), transfer=judged.model_copy(update={"arms": arms}))


@pytest.mark.parametrize("every", [101, 150, 300])
def test_windows_that_do_not_fit_are_refused_before_anything_is_trained(
    tmp_path, with_transitions, study_in, judged, every
):
    workspace = with_transitions(tmp_path)
    evaluation = EvaluationSettings(every_steps=every, start_gaps_m=(0.006, 0.015), selection_gaps_m=(0.010,))
    found = len({step for step in (*range(every, 300, every), 300) if step > 100})
    windows = judged.model_copy(update={"last_evaluations": found + 1})
    with pytest.raises(
        InputError, match=rf"{found} evaluations after the first gradient step are too few.*Evaluate more"
    ):
        study_in(workspace, transfer=windows, evaluation=evaluation)
    assert not workspace.path("training").exists()


def test_a_study_without_algorithms_is_refused(tmp_path, with_transitions, study_in):
    with pytest.raises(InputError, match="trains no algorithm"):
        study_in(with_transitions(tmp_path), algorithms=())


def test_a_study_without_transitions_says_what_to_run(tmp_path, study_in):
    with pytest.raises(ArtefactError, match="Run `maglev-offline ingest"):
        study_in(Workspace(tmp_path))
