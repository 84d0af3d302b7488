"""The figures hold the data of the workspace: so many lines as seeds, and the numbers that were found."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.report import figures_control, figures_data, figures_learning
from maglev_offline.report.agent_metrics import agent_metrics
from maglev_offline.report.evidence import gather, quarantine_of, samples_of_a_point
from maglev_offline.report.style import ARMS, CONTROLLERS
from maglev_offline.report.svg import inline_svg
from maglev_offline.workspace import Workspace


@pytest.fixture(scope="module")
def evidence(made):
    return gather(Workspace(made))


def lines(ax, part):
    return [line for line in ax.get_lines() if part in str(line.get_gid())]


def test_curves_hold_every_seed(evidence, recipe):
    curves = evidence.curves()
    figure = figures_learning.curves_figure(curves, {"pid": 90.0, "lqr": 13.0, "lqr_held": 12.0}, 18.0, 100)
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["DDPG", "TD3"]
    for ax, algorithm in zip(figure.axes, ("ddpg", "td3"), strict=True):
        for arm in ("empty", "prefill"):
            drawn = lines(ax, f"cost-{arm}-seed")
            assert len(drawn) == recipe.training.seeds
            rows = curves[(curves["algorithm"] == algorithm) & (curves["arm"] == arm) & (curves["seed"] == 1)]
            np.testing.assert_array_equal(drawn[1].get_ydata(), rows.sort_values("env_step")["cost"])
        assert ax.get_yscale() == "log"
        levels = {line.get_ydata()[0] for line in ax.get_lines() if len(set(line.get_ydata())) == 1}
        assert {90.0, 12.0, 18.0} <= levels
        assert 13.0 not in levels  # the agents' reference is the LQR that acts as often as they do


def test_regulation_holds_every_seed_and_controller(evidence, recipe):
    agents, classical = evidence.regulation(), evidence.control_responses()
    figure = figures_control.regulation_figure(classical[classical["t_s"] <= 0.5], agents, 0.008, 0.5)
    assert len(figure.axes) == 9
    assert len(lines(figure.axes[0], "gap_m-")) == len(CONTROLLERS)
    for ax in figure.axes[1:3]:
        for arm in ARMS:
            assert len(lines(ax, f"gap_m-{arm}-seed")) == recipe.training.seeds
    first = lines(figure.axes[1], "gap_m-empty-seed-0")[0].get_ydata()
    rows = agents[(agents["algorithm"] == "ddpg") & (agents["arm"] == "empty") & (agents["seed"] == 0)]
    np.testing.assert_allclose(first, 1e3 * rows["gap_m"])
    assert first[0] == pytest.approx(15)


def test_classical_controllers_alone_lie_in_one_row(evidence):
    figure = figures_control.regulation_figure(evidence.control_responses(), None, 0.008, 0.5)
    assert len(figure.axes) == 3
    assert figure.get_size_inches()[0] > 2 * figure.get_size_inches()[1]


def test_coverage_counts_every_row(evidence):
    candidates, curated = evidence.transitions("candidates"), evidence.transitions("transitions")
    figure = figures_data.coverage_figure(candidates, curated)
    panels = [ax.collections[0] for ax in figure.axes[:6]]
    assert [int(mesh.get_array().sum()) for mesh in panels] == [len(candidates)] * 3 + [len(curated)] * 3
    assert len({(mesh.norm.vmin, mesh.norm.vmax) for mesh in panels}) == 1


def test_trajectory_is_the_log(evidence):
    log = evidence.under("samples")[0]
    samples, quarantine = samples_of_a_point(log), quarantine_of(log)
    point = samples["point"].iloc[0]
    window = figures_data.trajectory_window(samples, quarantine, point, 20.0)
    assert window.rows["point"].unique().tolist() == [point]
    assert window.rows["t_s"].between(window.start_s, window.start_s + 20).all()
    figure = figures_data.trajectory_figure(window)
    drawn = lines(figure.axes[0], "gap_m-")
    assert len(drawn) == window.rows["segment"].nunique()
    np.testing.assert_allclose(
        np.concatenate([line.get_ydata() for line in drawn]),
        1e3 * window.rows.sort_values(["segment", "step"])["gap_m"],
    )


def test_trajectory_shows_what_was_quarantined():
    t = pd.to_datetime(np.arange(100) * 10**8, utc=True)
    samples = pd.DataFrame({"point": "P", "t": t, "segment": 0, "step": np.arange(100)})
    quarantine = pd.DataFrame({"point": ["P", "", "Q", "P"], "t": [t[10], t[20], t[30], pd.NaT]})
    window = figures_data.trajectory_window(samples, quarantine, "P", 5.0)
    assert window.start_s == 0
    assert window.seams == 0
    np.testing.assert_allclose(window.quarantined_s, [1.0, 2.0])


def test_prefill_algorithms_with_the_same_rows_share_a_line(evidence):
    columns = evidence.prefills()
    figure = figures_data.prefill_figure(columns)
    (cost, action) = (ax.patches for ax in figure.axes)
    assert len(cost) == len(action) == 1
    assert cost[0].get_data().values.sum() == len(columns["ddpg"]["cost"])
    columns["td3"] = {**columns["td3"], "cost": columns["td3"]["cost"] * 2}
    assert len(figures_data.prefill_figure(columns).axes[0].patches) == 2


def test_forest_has_a_row_for_each_effect(evidence):
    facts = evidence.get("transfer").facts
    rows = figures_learning.forest_rows(facts, ["prefill"])
    assert len(rows) == 8
    assert rows[0]["label"].startswith("DDPG")
    effect = facts["algorithms"]["ddpg"]["effects"]["prefill"]["jumpstart"]
    assert rows[0]["difference"] == pytest.approx(100 * effect["difference"] / abs(effect["baseline_mean"]))
    figure = figures_learning.forest_figure(rows)
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == [row["label"] for row in rows]


def test_forest_compresses_effects_that_dwarf_the_margin():
    effect = {"baseline_mean": 10.0, "margin": 0.5, "seeds": 8}
    small = {**effect, "difference": 0.1, "low": -0.2, "high": 0.3, "verdict": "equivalent"}
    large = {**effect, "difference": -40.0, "low": -60.0, "high": -20.0, "verdict": "negative"}
    silent = {**effect, "difference": -1.0, "low": None, "high": None, "verdict": "inconclusive"}
    for effects, scale in (({"area": small}, "linear"), ({"area": small, "asymptote": large, "x": silent}, "symlog")):
        verdict = {"algorithms": {"td3": {"effects": {"prefill": effects}}}}
        figure = figures_learning.forest_figure(figures_learning.forest_rows(verdict, ["prefill"]))
        assert figure.axes[0].get_xscale() == scale
        assert ("logarithmic" in figure.axes[0].get_xlabel()) == (scale == "symlog")


def test_agent_metrics_are_those_of_training(evidence, recipe):
    table = agent_metrics(evidence.regulation(), recipe.plant, recipe.mdp)
    assert len(table) == 12
    last = evidence.curves().query("env_step == env_step.max()")
    both = table.merge(last, on=["algorithm", "arm", "seed"], suffixes=("", "_in_training"))
    for name in ("settling_time_s", "overshoot"):
        np.testing.assert_allclose(both[name], both[f"{name}_in_training"], rtol=0.02, atol=2e-3)
    np.testing.assert_allclose(both["steady_state_bias_m"], both["steady_state_bias_m_in_training"], atol=2e-5)


def test_svg_is_the_same_each_time_and_free_of_outside_references():
    table = pd.DataFrame(
        {"env_step": [0, 10, 20], "cost": [3.0, 2.0, 1.0], "seed": 0, "algorithm": "td3", "arm": "empty"}
    )
    first, second = (inline_svg(figures_learning.curves_figure(table, {}, None, None), "key") for _ in range(2))
    assert first == second
    assert first.startswith("<svg viewBox")
    assert "http" not in first
    assert "DejaVu" not in first
    assert 'id="key-' in first
    assert "<metadata" not in first


def test_the_look_does_not_depend_on_the_users_settings():
    import matplotlib

    table = pd.DataFrame({"env_step": [0, 10], "cost": [3.0, 1.0], "seed": 0, "algorithm": "td3", "arm": "empty"})
    plain = inline_svg(figures_learning.curves_figure(table, {}, None, None), "key")
    with matplotlib.rc_context({"font.size": 30, "svg.fonttype": "path", "axes.facecolor": "black"}):
        assert inline_svg(figures_learning.curves_figure(table, {}, None, None), "key") == plain
        assert matplotlib.rcParams["font.size"] == 30
