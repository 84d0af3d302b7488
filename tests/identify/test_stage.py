"""The artefact `identify`, the plant file, and the real recordings."""

from pathlib import Path

import pandas as pd
import pytest

from maglev_offline.errors import ArtefactError, RecipeError
from maglev_offline.identify.plants import load_plant
from maglev_offline.identify.settings import IdentifySettings
from maglev_offline.identify.stage import COLUMNS, run_identify, summary
from maglev_offline.ingest.store import ingest_logs
from maglev_offline.recipe import load_recipe
from maglev_offline.workspace import Manifest, Workspace, sha256_of

RECIPE = Path(__file__).parents[2] / "pipelines/levitator.toml"


def stored(workspace, samples):
    """Samples as the ingest stage leaves them, one artefact for each log."""
    folders = []
    for log, part in samples.groupby("log_id"):
        folder = workspace.path("samples", str(log))
        full = part.assign(set_point_m=0.005, gap_velocity_m_s=0.0)
        for name in ("gap", "gap_velocity", "current", "voltage"):
            full[f"{name}_origin"] = "measured"
        with workspace.commit(folder, Manifest("samples", "mark", {})) as draft:
            full.to_parquet(draft / "samples.parquet", index=False)
        folders.append(folder)
    return folders


def test_artefact_and_plant_file(tmp_path, levitator, simulate):
    declared = levitator.model_copy(update={"resistance_ohm": 0.6})
    hashes = []
    for name in ("a", "b"):
        workspace = Workspace(tmp_path / name)
        folders = stored(workspace, simulate(levitator, 2.0, noise=0.01))
        folder, fresh = run_identify(workspace, folders[::-1], declared, IdentifySettings())
        assert fresh
        assert run_identify(workspace, folders, declared, IdentifySettings()) == (folder, False)
        hashes.append({p.name: sha256_of(p) for p in folder.iterdir() if p.name != "manifest.json"})
    assert hashes[0] == hashes[1]
    assert set(hashes[0]) == {"parameters.parquet", "residuals.parquet", "plant.toml"}
    plant = load_plant(folder / "plant.toml")
    assert plant.resistance_ohm == pytest.approx(2.72, rel=0.02)
    assert plant.equilibrium().current_a == pytest.approx(levitator.equilibrium().current_a, rel=0.01)
    assert plant.set_point_m == levitator.set_point_m
    text = (folder / "plant.toml").read_text()
    assert "declared was 0.6" in text
    assert "mass_kg = 0.018 # declared" in text
    assert len(pd.read_parquet(folder / "residuals.parquet")) <= 2000
    sentence, rows, facts = summary(folder)
    assert "0.6 ohm" in sentence
    assert all(len(row) == len(COLUMNS) for row in rows)
    assert facts["parameters"]["resistance_ohm"]["declared_outside_interval"]


def test_of_more_samples_than_it_may_hold_some_are_drawn_and_the_others_counted(tmp_path, levitator, simulate):
    workspace, samples = Workspace(tmp_path), simulate(levitator, 2.0, noise=0.01)
    few = IdentifySettings(most_samples=max(1000, len(samples) // 2))
    folder, _ = run_identify(workspace, stored(workspace, samples), levitator, few)
    made = Manifest.read(folder)
    assert made.counts["samples_not_drawn"] > 0
    assert made.counts["rows"] + made.counts["samples_not_drawn"] == made.counts["samples"] == len(samples)


def test_without_samples(tmp_path, levitator):
    with pytest.raises(ArtefactError, match="no samples"):
        run_identify(Workspace(tmp_path), [], levitator, IdentifySettings())


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[plant", "no valid TOML"),
        ("[mdp]\n", r"no \[plant\] table"),
        ("[plant]\nmass_kg = 0\n", r"\[plant\] mass_kg: .*greater than 0 \(given: 0\)"),
        ("[plant]\nmass_kg = nan\n", r"\[plant\] mass_kg: .*finite"),
        (
            "[plant]\nresistence_ohm = 1\nmass_kg = -1\n",
            r"did you mean `resistance_ohm`.*mass_kg|mass_kg.*resistance_ohm",
        ),
        ("[plant]\nset_point_m = 0.5\n", r"\[plant\]: set_point_m = 0.5 must lie between"),
    ],
)
def test_a_plant_file_that_cannot_be(tmp_path, text, told):
    path = tmp_path / "plant.toml"
    path.write_text(text)
    with pytest.raises(RecipeError, match=told):
        load_plant(path)


def test_a_plant_file_that_is_not_there_and_a_whole_recipe(tmp_path, levitator):
    with pytest.raises(RecipeError, match="no such plant file"):
        load_plant(tmp_path / "none.toml")
    assert load_plant(RECIPE) == levitator


def test_the_real_recordings_refute_the_declared_resistance(tmp_path, levitador):
    recipe = load_recipe(RECIPE)
    workspace = Workspace(tmp_path)
    ingest_logs(sorted(levitador.glob("*.mcap")), workspace, recipe.request)
    folder, _ = run_identify(workspace, workspace.list("samples"), recipe.plant, IdentifySettings())
    sentence, _, facts = summary(folder)
    check = facts["voltage_check"]
    assert not check["holds"]
    assert check["voltage_v"] == pytest.approx(7.2, abs=0.2)
    assert check["declared_explains_v"] == pytest.approx(1.27, abs=0.05)
    assert "2.72 ohm" in sentence
    assert check["voltage_exponent"] == pytest.approx(0.63, abs=0.08)
    assert facts["held_out_median_r2"]["voltage"] > 0.98
    # R i + u0 fits near the set-point, but the plant has no u0, so its resistance is not identified.
    resistance = facts["parameters"]["resistance_ohm"]
    assert resistance["declared_outside_interval"]
    assert resistance["verdict"] == "weakly identified"
    assert "offset" in resistance["reason"]
    assert facts["parameters"]["inductance_slope_h_m"]["verdict"] == "not identifiable from these samples"
    assert facts["whiteness"]["electrical"]["p_value"] < 1e-6
    assert load_plant(folder / "plant.toml").resistance_ohm == 2.72
