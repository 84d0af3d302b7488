"""What the simulator does not explain is found where it was planted, and not elsewhere."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.cells import CELLS
from maglev_offline.curate.diagnostic_cells import TOO_FEW
from maglev_offline.curate.residual import predicted, recording_of, windows_of
from maglev_offline.curate.residual_facts import residual_facts
from maglev_offline.curate.residual_map import residual_map
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP, HEAVY = Plant(), Mdp(), Plant(mass_kg=2000)


def one_step(table, kind):
    return table[(table["steps"] == 1) & (table["kind"] == kind)].reset_index(drop=True)


@pytest.fixture(scope="module")
def of_logs(driven_samples):
    """Three logs, of which the second is of another plant."""
    samples = [driven_samples(f"log-{name}", HEAVY if name == "b" else None) for name in "abc"]
    return pd.concat(samples, ignore_index=True)


@pytest.fixture(scope="module")
def by_log(of_logs):
    return residual_map(of_logs, PLANT, MDP, 0)


def test_a_log_of_another_plant_is_unexplained_and_the_others_are_not(by_log):
    logs = one_step(by_log, "log").set_index("log_id")
    assert logs["verdict"].to_dict() == {"log-a": "explained", "log-b": "unexplained", "log-c": "explained"}
    assert logs["offset"].to_dict() == {"log-a": False, "log-b": True, "log-c": False}
    assert logs.loc["log-a", "unexplained_share"] < 1e-9
    assert logs.loc["log-b", "velocity_mean"] > 0.1  # heavier than the simulator thinks: it falls faster
    points = one_step(by_log, "point").set_index("log_id")
    assert points["verdict"].equals(logs["verdict"])


def test_a_region_of_another_plant_is_unexplained_and_the_others_are_not(driven_samples):
    samples = driven_samples(
        heavy=HEAVY, beyond=lambda gap_m: gap_m > PLANT.set_point_m, n=2000, steps=2, gap_std_m=2e-4
    )
    regions = one_step(residual_map(samples, PLANT, MDP, 0), "region").query("verdict != @TOO_FEW")
    above, below = regions[regions["gap_cell"] > CELLS // 2], regions[regions["gap_cell"] < CELLS // 2 - 1]
    assert min(len(above), len(below)) > 3
    assert (above["verdict"] == "unexplained").all()
    assert (below["verdict"] == "explained").all()


def test_the_numbers_are_those_of_the_definition(of_logs, by_log):
    windows = windows_of(recording_of(of_logs), 1, 0)
    mine = (windows.place["log_id"] == "log-b").to_numpy()
    r = ((windows.later - predicted(windows, PLANT, MDP)) / MDP.state_scale)[mine]
    d = ((windows.later - windows.state) / MDP.state_scale)[mine]
    found = one_step(by_log, "log").set_index("log_id").loc["log-b"]
    np.testing.assert_allclose([found[f"{n}_mean"] for n in ("gap", "velocity", "current")], r.mean(axis=0))
    np.testing.assert_allclose(
        [found[f"{n}_rms"] for n in ("gap", "velocity", "current")], np.sqrt((r**2).mean(axis=0))
    )
    np.testing.assert_allclose(
        [found[f"{n}_change"] for n in ("gap", "velocity", "current")], np.sqrt((d**2).mean(axis=0))
    )
    assert found["unexplained_share"] == pytest.approx((r**2).sum() / (d**2).sum())
    assert found["offset_share"] == pytest.approx((r.mean(axis=0) ** 2).sum() / (r**2).mean(axis=0).sum())
    for name in ("unexplained_share", "offset_share"):
        assert found[f"{name}_low"] < found[name] < found[f"{name}_high"]


def test_every_way_to_cut_holds_every_window_and_each_length_is_there(by_log):
    assert by_log["steps"].unique().tolist() == [1, 2, 5]
    np.testing.assert_allclose(
        by_log.groupby("steps")["duration_s"].unique().explode().astype(float), [0.005, 0.01, 0.025]
    )
    rows = by_log.groupby(["steps", "kind"])["rows"].sum().unstack()
    assert set(rows) == {"all", "log", "point", "region", "voltage"}
    assert (rows.nunique(axis=1) == 1).all()
    assert (by_log["rows"] > 0).all()


def test_at_100_ms_not_even_the_very_plant_explains_its_log_but_what_is_missing_is_no_offset(samples_every):
    """No noise and no force: the voltage between samples is all that is unknown, and the plant is unstable."""
    maps = [residual_map(samples_every(ms).query("point < 'P4'"), PLANT, Mdp(integrator="rk4"), 0) for ms in (10, 100)]
    fast, slow = (one_step(found, "all") for found in maps)
    assert fast["verdict"].tolist() == ["explained"]
    assert slow["verdict"].tolist() != ["explained"]
    assert not slow["offset"].any()
    assert slow.loc[0, "unexplained_share"] > 100 * fast.loc[0, "unexplained_share"]


def test_the_same_samples_in_any_order_give_the_same_map(of_logs, by_log):
    pd.testing.assert_frame_equal(residual_map(of_logs.sample(frac=1, random_state=0), PLANT, MDP, 0), by_log)


def test_few_windows_have_no_verdict_and_none_have_no_map(samples_of):
    few = residual_map(samples_of([0.008, 0.0081, 0.0082]), PLANT, MDP, 0)
    assert set(few["verdict"]) == {TOO_FEW}
    assert few["steps"].unique().tolist() == [1, 2]
    assert residual_facts(residual_map(samples_of([0.008]), PLANT, MDP, 0), PLANT) is None


def test_facts_count_the_verdicts_and_list_the_worst_first(by_log):
    facts = residual_facts(by_log, PLANT)
    assert facts["logs"] == {"judged": 3, "explained": 2, "open": 0, "unexplained": 1, "offset": 1}
    assert [log["log_id"] for log in facts["worst_logs"]] == ["log-b"]
    sizes = [region["rms_state_scales"] for region in facts["worst_regions"]]
    assert sizes == sorted(sizes, reverse=True)
    assert [one["duration_s"] for one in facts["longer"]] == pytest.approx([0.01, 0.025])
    assert facts["growth"] == pytest.approx(np.exp(18.754 * 0.005), rel=1e-3)
