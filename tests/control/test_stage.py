"""The artefact `control` and the reference costs."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from maglev_offline.control.pid import PidGains
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.control.settings import CONTROLLERS, ControlSettings
from maglev_offline.control.stage import run_control
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.workspace import Manifest, Workspace, sha256_of

QUICK = ControlSettings(
    duration_s=0.6, stored_fully_s=0.2, start_gaps_m=(0.006,), robustness_cells=3, robustness_duration_s=0.2
)


def test_artefact(tmp_path: Path) -> None:
    folder, _ = run_control(Workspace(tmp_path), plant=Plant(), mdp=Mdp(), settings=QUICK)
    metrics = pd.read_parquet(folder / "metrics.parquet")
    responses = pd.read_parquet(folder / "responses.parquet")
    assert set(metrics.controller) == set(CONTROLLERS)
    assert len(metrics) == 6 * 2 * 2
    assert len(responses) == len(metrics) * (200 + 40)
    assert list(responses.columns) == [
        *("controller", "plant_kind", "start_gap_m", "t_s", "gap_m", "gap_velocity_m_s", "current_a", "voltage_v")
    ]
    first = responses[responses.t_s == 0]
    np.testing.assert_allclose(first.gap_m, first.start_gap_m)
    settled = metrics[(metrics.controller == "lqi") & (metrics.plant_kind == "nonlinear")]
    assert settled.settling_time_s.notna().all()
    assert metrics[metrics.controller == "pid"].settling_time_s.isna().all()
    manifest = Manifest.read(folder)
    assert manifest.settings == {
        "control": QUICK.model_dump(mode="json"),
        "plant": Plant().model_dump(mode="json"),
        "mdp": Mdp().model_dump(mode="json"),
    }
    facts = manifest.facts
    assert facts["closed_loops"]["pid"]["stable"]
    np.testing.assert_allclose(facts["poles_rad_s"][0], [18.754, 0.0], atol=1e-3)


def test_the_held_lqr_alone_holds_its_voltage_for_a_control_period(tmp_path: Path) -> None:
    folder, _ = run_control(Workspace(tmp_path), plant=Plant(), mdp=Mdp(control_period_ms=10), settings=QUICK)
    responses = pd.read_parquet(folder / "responses.parquet")
    first = responses[(responses.plant_kind == "nonlinear") & (responses.start_gap_m == 0.006) & (responses.t_s < 0.05)]
    period = (first.t_s / 0.010 + 1e-6).astype(int)
    voltages = first.groupby(["controller", period]).voltage_v.nunique().unstack()
    assert (voltages.loc["lqr_held"] == 1).all()
    assert (voltages.drop("lqr_held").max(axis=1) > 1).all()  # where they do not saturate


def test_second_run_does_nothing_and_another_workspace_gets_the_same_bytes(tmp_path: Path) -> None:
    made = [
        run_control(Workspace(tmp_path / name), plant=Plant(), mdp=Mdp(), settings=QUICK) for name in ("a", "a", "b")
    ]
    assert [fresh for _, fresh in made] == [True, False, True]
    hashes = {sha256_of(folder / "manifest.json") for folder, _ in made}
    assert len(hashes) == 1


def test_unstable_gains_are_told_and_do_not_crash(tmp_path: Path) -> None:
    warned: list[str] = []

    class Listener:
        def say(self, text: str) -> None:
            pass

        def warn(self, text: str) -> None:
            warned.append(text)

        def task(self, title: str, total: int, unit: str):  # type: ignore[no-untyped-def]
            from maglev_offline.progress import SILENT

            return SILENT.task(title, total, unit)

    settings = QUICK.model_copy(update={"pid": PidGains(kp=100)})
    folder, _ = run_control(Workspace(tmp_path), plant=Plant(), mdp=Mdp(), settings=settings, progress=Listener())
    assert any("pid" in text for text in warned)
    metrics = pd.read_parquet(folder / "metrics.parquet")
    assert np.isfinite(metrics.cost).all()
    assert metrics[(metrics.controller == "pid") & (metrics.plant_kind == "nonlinear")].contact_fraction.max() > 0.1


def test_another_plant(tmp_path: Path, levitator: Plant) -> None:
    mdp = Mdp(voltage_limit_v=12, start_gap_m=(0.003, 0.007))
    settings = ControlSettings(
        reference_start_gap_m=0.006,
        start_gaps_m=(0.0045,),
        duration_s=0.6,
        robustness_cells=3,
        robustness_duration_s=0.2,
    )
    folder, _ = run_control(Workspace(tmp_path), plant=levitator, mdp=mdp, settings=settings)
    assert np.isfinite(pd.read_parquet(folder / "responses.parquet").gap_m).all()


@pytest.mark.parametrize(("period_ms", "lqr"), [(1.0, 10.75), (10.0, 11.00)])
def test_reference_costs(period_ms: float, lqr: float) -> None:
    mdp = Mdp(control_period_ms=period_ms)
    found = classical_reference_cost(Plant(), mdp, np.linspace(0.004, 0.015, 10))
    assert found["lqr_held"].mean() == pytest.approx(lqr, abs=0.01)
    assert found["lqr"].mean() == pytest.approx(10.73, abs=0.01)  # whatever the control period
    assert found["pid"].mean() == pytest.approx(81.6, abs=0.1)
    assert found["cascade"].mean() == pytest.approx(8.9, abs=0.1)
    assert found["lqi"].mean() == pytest.approx(10.44, abs=0.02)
