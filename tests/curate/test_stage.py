import json
import shutil

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate import residual_map as residual_map_module
from maglev_offline.curate.consistency import one_step_residual
from maglev_offline.curate.diagnostic import diagnose
from maglev_offline.curate.residual_map import residual_map
from maglev_offline.curate.rules import Rule
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.curate.stage import curate
from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.store import load_samples
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import Silent
from maglev_offline.workspace import Manifest, Workspace

PLANT, MDP = Plant(), Mdp()
SMALL = CurateSettings(target_rows=100, bins_gap=3, bins_velocity=3, bins_current=3, bins_voltage=3)


class Listener(Silent):
    def __init__(self):
        self.warnings, self.said = [], []

    def warn(self, text):
        self.warnings.append(text)

    def say(self, text):
        self.said.append(text)


@pytest.fixture(autouse=True)
def one_length(monkeypatch):
    """One length of the residual map is enough here, and takes an eighth of the time."""
    monkeypatch.setattr(residual_map_module, "STEPS_AHEAD", (1,))


@pytest.fixture
def workspace(tmp_path, put_samples, wandering):
    found = Workspace(tmp_path / "workspace")
    for name in ("log-a", "log-b", "log-c", "log-d"):
        put_samples(found, wandering(name, 80))
    return found


def test_every_pair_of_samples_is_a_candidate_or_left_out_for_a_reason(workspace, put_samples, samples_of):
    limit = PLANT.equilibrium(0.008).voltage_v + MDP.voltage_limit_v
    voltage = [24, limit + 1, 24, 24, 24]
    put_samples(workspace, samples_of([0.008, 0.008, 0.008, 0.008, np.nan], log_id="log-e", voltage_v=voltage))
    settings = SMALL.model_copy(update={"validation_share": 0.2})
    folder, _ = curate(workspace, settings, PLANT, MDP)
    manifest = Manifest.read(folder)
    pairs = 4 * 79 + 4
    assert manifest.counts == {
        "samples": 4 * 80 + 5, "samples_not_drawn": 0,
        "pairs": pairs, "rows": pairs, "candidates": 4 * 79 + 2, "transitions": 100,
    }  # fmt: skip
    candidates = pd.read_parquet(folder / "candidates.parquet")
    held_out = int((candidates["split"] == "validation").sum())
    assert held_out > 0
    assert manifest.left_out == {
        "not_finite": 1,
        "voltage_outside_limit": 1,
        "held_out_for_validation": held_out,
        "not_selected_by_balance": 4 * 79 + 2 - held_out - 100,
    }
    assert sum(manifest.left_out.values()) + manifest.counts["transitions"] == manifest.counts["pairs"]


def test_more_samples_than_memory_should_hold_are_drawn_and_counted(workspace, put_samples, wandering):
    """No pair reaches over what was not drawn, and whoever asks is told how many samples there are."""
    put_samples(workspace, wandering("log-long", 6000))
    settings, heard = SMALL.model_copy(update={"most_samples": 3000}), Listener()
    folder, _ = curate(workspace, settings, PLANT, MDP, progress=heard)
    counts = Manifest.read(folder).counts
    assert counts["samples"] == 6320
    assert 3000 - 600 < 6320 - counts["samples_not_drawn"] <= 3000
    candidates = pd.read_parquet(folder / "candidates.parquet")
    assert set(candidates["duration_s"].round(9)) == {0.1}
    assert counts["pairs"] == counts["rows"] < 3000
    assert any("of 6,320 samples are drawn" in text for text in heard.said)


def test_a_construction_of_several_rows_draws_as_many_times_fewer_samples(workspace, put_samples, wandering):
    put_samples(workspace, wandering("log-long", 6000), settings={"ingest": {"grid_ms": 100.0}})
    drawn = {}
    for name in ("raw", "interpolated"):
        settings = SMALL.model_copy(update={"most_samples": 6100, "construction": name})
        folder, _ = curate(workspace, settings, PLANT, MDP)
        counts = Manifest.read(folder).counts
        drawn[name] = counts["samples"] - counts["samples_not_drawn"]
    assert drawn["raw"] > 6100 - 600
    assert drawn["interpolated"] <= 610
    least = SMALL.model_copy(update={"most_samples": 1000, "construction": "interpolated"})
    folder, _ = curate(workspace, least, PLANT, MDP)
    assert Manifest.read(folder).counts["pairs"] > 0, "a piece at least"


def test_the_artefact_holds_the_choice_and_all_candidates(workspace):
    folder, fresh = curate(workspace, SMALL, PLANT, MDP)
    chosen, all_of_them = (pd.read_parquet(folder / f"{n}.parquet") for n in ("transitions", "candidates"))
    assert fresh
    assert len(chosen) == 100
    key = ["log_id", "point", "segment", "step"]
    assert not chosen.duplicated(key).any()
    joined = chosen.merge(all_of_them, how="left", suffixes=("", "_before"), on=key)
    np.testing.assert_array_equal(joined["cost"], joined["cost_before"])
    assert len(all_of_them) == 4 * 79
    assert "cell" in chosen
    assert "cell" not in all_of_them
    assert chosen["weight"].mean() == pytest.approx(1)


def test_the_coverage_report_counts_the_training_rows_in_the_tables(workspace):
    settings = SMALL.model_copy(update={"validation_share": 0.5})
    folder, _ = curate(workspace, settings, PLANT, MDP)
    facts = Manifest.read(folder).facts
    chosen, all_of_them = (pd.read_parquet(folder / f"{n}.parquet") for n in ("transitions", "candidates"))
    all_of_them = all_of_them[all_of_them["split"] == "train"]
    assert facts["occupancy_before"]["rows"] == len(all_of_them) == 2 * 79
    assert facts["occupancy_after"]["rows"] == len(chosen) == 100
    low = all_of_them["cost"].quantile(SMALL.low_cost_quantile)
    assert facts["low_cost_rows_before"] == (all_of_them["cost"] <= low).sum()
    assert facts["low_cost_rows_after"] == (chosen["cost"] <= low).sum()
    assert facts["low_cost_share_kept"] == facts["low_cost_rows_after"] / facts["low_cost_rows_before"]
    assert facts["occupancy_after"]["occupied_cells"] == chosen["cell"].nunique()
    assert facts["mean_cost_before"] == pytest.approx(all_of_them["cost"].mean())
    assert facts["occupancy_after"]["effective_cells"] > facts["occupancy_before"]["effective_cells"]
    weight = chosen["weight"]
    assert facts["effective_sample_size"] == pytest.approx(weight.sum() ** 2 / (weight**2).sum())
    assert facts["mean_cost_after"] == pytest.approx(chosen["cost"].mean())


def test_unchanged_samples_and_recipe_are_left_alone(workspace):
    folder, _ = curate(workspace, SMALL, PLANT, MDP)
    written = (folder / "manifest.json").stat().st_mtime_ns
    assert curate(workspace, SMALL, PLANT, MDP) == (folder, False)
    assert (folder / "manifest.json").stat().st_mtime_ns == written


@pytest.mark.parametrize(
    ("settings", "plant", "mdp"),
    [
        (SMALL.model_copy(update={"seed": 1}), PLANT, MDP),
        (SMALL, Plant(mass_kg=650), MDP),
        (SMALL, PLANT, Mdp(discount=0.8)),
    ],
)
def test_a_change_of_any_table_of_the_recipe_makes_it_anew(workspace, settings, plant, mdp):
    curate(workspace, SMALL, PLANT, MDP)
    assert curate(workspace, settings, plant, mdp)[1]


def test_another_log_makes_it_anew(workspace, put_samples, wandering):
    curate(workspace, SMALL, PLANT, MDP)
    put_samples(workspace, wandering("log-e", 10))
    folder, fresh = curate(workspace, SMALL, PLANT, MDP)
    assert fresh
    assert Manifest.read(folder).counts["pairs"] == 4 * 79 + 9


def test_the_same_inputs_give_the_same_bytes(workspace, tmp_path, put_samples, wandering):
    other = Workspace(tmp_path / "other")
    for name in ("log-d", "log-b", "log-a", "log-c"):
        put_samples(other, wandering(name, 80))
    folders = [curate(place, SMALL, PLANT, MDP)[0] for place in (workspace, other)]
    for name in ("transitions.parquet", "candidates.parquet", "manifest.json"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_whole_logs_are_held_out(workspace):
    settings = SMALL.model_copy(update={"validation_share": 0.5})
    candidates = pd.read_parquet(curate(workspace, settings, PLANT, MDP)[0] / "candidates.parquet")
    splits = candidates.groupby("log_id")["split"].unique()
    assert all(len(split) == 1 for split in splits)
    assert sorted(split[0] for split in splits) == ["train", "train", "validation", "validation"]


def test_no_row_of_a_log_that_is_held_out_is_curated_and_the_target_is_met_by_the_others(workspace):
    for share in (0.0, 0.25, 0.5):
        settings = SMALL.model_copy(update={"validation_share": share})
        folder, _ = curate(workspace, settings, PLANT, MDP)
        chosen, all_of_them = (pd.read_parquet(folder / f"{n}.parquet") for n in ("transitions", "candidates"))
        held_out = set(all_of_them.loc[all_of_them["split"] == "validation", "log_id"])
        assert len(held_out) == 4 * share
        assert not held_out & set(chosen["log_id"])
        assert (chosen["split"] == "train").all()
        assert len(chosen) == SMALL.target_rows


def test_logs_that_are_held_out_do_not_change_the_cells_of_the_others(tmp_path, put_samples, wandering, samples_of):
    """The edges of the cells come from training rows: what is held out must not leak into the choice."""
    settings = SMALL.model_copy(update={"validation_share": 0.5})
    chosen = []
    for name in ("plain", "wild"):
        workspace = Workspace(tmp_path / name)
        for log in ("log-a", "log-b"):
            put_samples(workspace, wandering(log, 150))
        first = pd.read_parquet(curate(workspace, settings, PLANT, MDP)[0] / "candidates.parquet")
        held_out = first.loc[first["split"] == "validation", "log_id"].iloc[0]
        if name == "wild":
            shutil.rmtree(workspace.path("samples", held_out))
            put_samples(workspace, samples_of(np.linspace(0.001, 0.0155, 40), log_id=held_out, current_a=30.0))
        chosen.append(pd.read_parquet(curate(workspace, settings, PLANT, MDP)[0] / "transitions.parquet"))
    pd.testing.assert_frame_equal(*chosen)


def test_the_nearest_whole_number_of_logs_is_held_out_and_one_remains(workspace):
    for share, logs in ((0.2, 1), (0.3, 1), (0.4, 2), (0.99, 3)):
        settings = SMALL.model_copy(update={"validation_share": share})
        candidates = pd.read_parquet(curate(workspace, settings, PLANT, MDP)[0] / "candidates.parquet")
        assert candidates.loc[candidates["split"] == "validation", "log_id"].nunique() == logs


def test_a_share_too_small_for_one_log_is_warned_of(workspace):
    listener = Listener()
    settings = SMALL.model_copy(update={"validation_share": 0.05})
    curate(workspace, settings, PLANT, MDP, progress=listener)
    assert "nothing is held out" in listener.warnings[0]


def test_too_few_transitions_are_all_kept_and_warned_of(workspace):
    listener = Listener()
    folder, _ = curate(workspace, CurateSettings(target_rows=1000), PLANT, MDP, progress=listener)
    assert Manifest.read(folder).counts["transitions"] == 4 * 79
    assert "only 316 usable transitions for curate.target_rows = 1000" in listener.warnings[0]
    assert (pd.read_parquet(folder / "transitions.parquet")["weight"] == 1).all()


def test_too_few_training_rows_are_told_of_with_what_is_not_usable(workspace, put_samples, samples_of):
    put_samples(workspace, samples_of([0.008] * 4, log_id="log-e", voltage_v=1e4))
    listener = Listener()
    settings = CurateSettings(target_rows=1000, validation_share=0.25)
    folder, _ = curate(workspace, settings, PLANT, MDP, progress=listener)
    kept = Manifest.read(folder).counts["transitions"]
    assert kept < 4 * 79
    assert (
        f"only {kept} usable transitions (voltage_outside_limit: 3 of 319 pairs are not usable)" in listener.warnings[0]
    )


def test_samples_that_do_not_fit_the_plant_are_doubted_in_a_warning_and_in_the_manifest(workspace):
    for plant, doubted in ((PLANT, False), (Plant(mass_kg=70_000), True)):
        listener = Listener()
        folder, _ = curate(workspace, SMALL, plant, MDP, progress=listener)
        doubts = Manifest.read(folder).facts["doubts"]
        assert bool(doubts) == doubted
        assert [text for text in listener.warnings if "[plant]" in text] == doubts


def test_a_table_that_was_changed_by_hand_is_made_anew(workspace):
    folder, _ = curate(workspace, SMALL, PLANT, MDP)
    before = (folder / "transitions.parquet").read_bytes()
    pd.read_parquet(folder / "transitions.parquet").head(50).to_parquet(folder / "transitions.parquet")
    assert curate(workspace, SMALL, PLANT, MDP)[1]
    assert (folder / "transitions.parquet").read_bytes() == before


def test_samples_that_were_changed_by_hand_are_refused(workspace):
    path = workspace.path("samples", "log-b", "samples.parquet")
    pd.read_parquet(path).head(50).to_parquet(path)
    with pytest.raises(ArtefactError, match=r"log-b: samples.parquet is not what was written.*run its stage again"):
        curate(workspace, SMALL, PLANT, MDP)


def test_an_empty_workspace_says_what_to_run(tmp_path):
    with pytest.raises(ArtefactError, match=r"there are no samples.*Run `maglev-offline ingest"):
        curate(Workspace(tmp_path), SMALL, PLANT, MDP)


def test_without_a_usable_transition_the_reasons_are_told_and_nothing_is_left_behind(tmp_path, put_samples, samples_of):
    workspace = Workspace(tmp_path)
    put_samples(workspace, samples_of([0.008] * 4, voltage_v=1e4))
    with pytest.raises(ArtefactError, match=r"no usable transition in 3 pairs .*voltage_outside_limit: 3"):
        curate(workspace, SMALL, PLANT, MDP)
    assert not workspace.path("transitions").exists()


def test_samples_that_never_follow_each_other_are_told_of(tmp_path, put_samples, samples_of):
    workspace = Workspace(tmp_path)
    put_samples(workspace, samples_of([0.008]))
    with pytest.raises(ArtefactError, match="no two samples follow each other"):
        curate(workspace, SMALL, PLANT, MDP)


def test_the_manifest_is_strict_json_with_the_tables_it_was_made_from(workspace):
    folder, _ = curate(workspace, SMALL, PLANT, MDP)

    def refuse(name):
        raise AssertionError(name)

    data = json.loads((folder / "manifest.json").read_text(), parse_constant=refuse)
    assert data["settings"]["plant"] == PLANT.model_dump(mode="json")
    assert set(data["inputs"]) == {f"samples/log-{name}" for name in "abcd"}


@pytest.mark.parametrize(
    ("construction", "rows_a_pair"),
    [("raw", 1), ("semi_markov", 1), ("interpolated", 10), ("simulated_next", 1)],
)
def test_every_construction_counts_its_rows_as_used_or_left_out(workspace, construction, rows_a_pair):
    settings = SMALL.model_copy(update={"construction": construction})
    folder, _ = curate(workspace, settings, PLANT, MDP)
    manifest = Manifest.read(folder)
    assert manifest.counts["pairs"] == 4 * 79
    assert manifest.counts["rows"] == 4 * 79 * rows_a_pair
    assert sum(manifest.left_out.values()) + manifest.counts["transitions"] == manifest.counts["rows"]
    chosen = pd.read_parquet(folder / "transitions.parquet")
    assert (chosen["origin"] == construction).all()
    assert not chosen.duplicated(["log_id", "point", "segment", "step", "substep"]).any()
    assert manifest.facts["construction"] == construction


def test_rows_that_contradict_the_simulator_most_are_left_out_where_the_recipe_asks_for_it(workspace):
    settings = SMALL.model_copy(update={"consistent_fraction": 0.25, "target_rows": 50})
    folder, _ = curate(workspace, settings, PLANT, MDP)
    manifest = Manifest.read(folder)
    assert manifest.counts["candidates"] == 79
    assert manifest.left_out["inconsistent_with_simulator"] == 3 * 79
    assert sum(manifest.left_out.values()) + manifest.counts["transitions"] == manifest.counts["rows"]
    all_of_them = pd.read_parquet(curate(workspace, SMALL, PLANT, MDP)[0] / "candidates.parquet")
    residual = one_step_residual(all_of_them, PLANT, MDP)
    curate(workspace, settings, PLANT, MDP)
    kept = one_step_residual(pd.read_parquet(folder / "candidates.parquet"), PLANT, MDP)
    np.testing.assert_allclose(np.sort(kept), np.sort(residual)[:79])


def test_samples_closer_than_decisions_cannot_be_interpolated_and_that_is_told(tmp_path, put_samples, samples_of):
    workspace = Workspace(tmp_path)
    put_samples(workspace, samples_of([0.008] * 4))
    settings = SMALL.model_copy(update={"construction": "interpolated"})
    mdp = Mdp(control_period_ms=200, episode_duration_s=1)
    with pytest.raises(ArtefactError, match=r"shorter_than_a_decision: 3.*take another \[curate\] construction"):
        curate(workspace, settings, PLANT, mdp)


def test_the_verdict_on_the_training_rows_is_in_the_manifest(workspace):
    settings = SMALL.model_copy(update={"validation_share": 0.5})
    folder, _ = curate(workspace, settings, PLANT, MDP)
    rows = pd.read_parquet(folder / "candidates.parquet").query("split == 'train'")
    found = Manifest.read(folder).facts["diagnostic"]
    assert found == diagnose(rows, PLANT, MDP, SMALL.seed).plain()
    assert found["verdict"] in ("fit", "doubtful", "harmful")
    assert found["rows"] == 2 * 79


def test_what_was_judged_before_training_lies_beside_the_rows(workspace):
    folder, _ = curate(workspace, SMALL, PLANT, MDP)
    facts = Manifest.read(folder).facts
    cells, rows, residuals = (
        pd.read_parquet(folder / f"{name}.parquet") for name in ("diagnostic_cells", "diagnostic_rows", "residuals")
    )
    assert cells["rows"].sum() == len(rows) == facts["diagnostic"]["rows"]
    made = residual_map(load_samples(workspace.list("samples")), PLANT, MDP, 0)
    pd.testing.assert_frame_equal(residuals, made, check_dtype=False)
    assert facts["residual"]["windows"] == 4 * 79
    assert facts["residual"]["verdict"] == "too_few"


@pytest.mark.parametrize("balance", ["quantiles", "coverage", "low_cost"])
def test_every_balance_is_measured_in_the_same_cells_and_its_books_add_up(workspace, balance):
    folder, _ = curate(workspace, SMALL.model_copy(update={"balance": balance}), PLANT, MDP)
    manifest = Manifest.read(folder)
    facts, chosen = manifest.facts, pd.read_parquet(folder / "transitions.parquet")
    assert facts["balance"] == balance
    assert sum(manifest.left_out.values()) + len(chosen) == manifest.counts["rows"]
    assert facts["occupancy_before"]["occupied_cells"] <= 3**4
    assert facts["occupancy_after"]["occupied_cells"] == chosen["cell"].nunique()
    levels = facts["cost_quantiles"]["levels"]
    assert facts["cost_quantiles"]["after"] == pytest.approx(chosen["cost"].quantile(levels).tolist())
    assert facts["discrepancy"]["rows"] == 100
    for found in facts["visited_states"]["policies"].values():
        assert 0 <= found["after"] <= found["before"] <= 1


def test_rows_that_the_rules_leave_out_are_counted_by_reason(workspace):
    settings = SMALL.model_copy(
        update={
            "include": (Rule(log_id=("log-a", "log-b")), Rule(voltage_deviation_v=(-10, 10))),
            "exclude": (Rule(gap_error_m=(-0.001, 0.001)), Rule(log_id=("log-a",), cost=(0, 0.1))),
            "target_rows": 20,
        }
    )
    every = pd.read_parquet(curate(workspace, SMALL, PLANT, MDP)[0] / "candidates.parquet")
    excluded = every["gap_error_m"].between(-0.001, 0.001) | ((every["log_id"] == "log-a") & (every["cost"] <= 0.1))
    included = every["log_id"].isin(["log-a", "log-b"]) | every["voltage_deviation_v"].between(-10, 10)
    folder, _ = curate(workspace, settings, PLANT, MDP)
    manifest = Manifest.read(folder)
    assert manifest.left_out["excluded_by_rule"] == excluded.sum() > 0
    assert manifest.left_out["not_in_include_rule"] == (~included & ~excluded).sum() > 0
    assert sum(manifest.left_out.values()) + manifest.counts["transitions"] == manifest.counts["rows"]
    used = pd.read_parquet(folder / "candidates.parquet")
    assert used["cost"].tolist() == every.loc[included & ~excluded, "cost"].tolist()


def test_a_rule_that_no_row_fits_is_told_of(workspace):
    listener = Listener()
    settings = SMALL.model_copy(update={"exclude": (Rule(cost=(0, 1e9), log_id=("log-z",)),)})
    folder, _ = curate(workspace, settings, PLANT, MDP, progress=listener)
    assert "no row fits curate.exclude[0]" in listener.warnings[0]
    assert "excluded_by_rule" not in Manifest.read(folder).left_out


def test_rules_that_leave_nothing_are_told_of(workspace):
    settings = SMALL.model_copy(update={"include": (Rule(gap_error_m=(1, 2)),)})
    with pytest.raises(ArtefactError, match=r"not_in_include_rule: 316.*\[\[curate.include\]\]"):
        curate(workspace, settings, PLANT, MDP)
