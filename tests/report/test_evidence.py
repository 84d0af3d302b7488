"""What the report reads: workspaces of other periods within, and those that the recipe does not ask for."""

import json

import pytest

from maglev_offline.report.evidence import gather
from maglev_offline.workspace import Workspace


@pytest.fixture
def workspace_of(tmp_path):
    """A workspace with a study of so many seeds in each of the folders below periods/."""

    def make(*folders, seeds=8):
        for name in folders:
            home = tmp_path / "periods" / name / "transfer"
            home.mkdir(parents=True)
            manifest = {
                "artefact": "transfer",
                "schema": 1,
                "fingerprint": "f",
                "inputs": {},
                "settings": {"training": {"seeds": seeds}},
            }
            (home / "manifest.json").write_text(json.dumps(manifest))
        return Workspace(tmp_path)

    return make


def test_periods_come_from_the_longest_and_other_folders_are_none(workspace_of):
    evidence = gather(workspace_of("1ms", "2.5ms", "20ms", "5ms-old", ".5ms", "notes"))
    assert list(evidence.periods) == ["20ms", "2.5ms", "1ms"]
    assert "periods/1ms/transfer" in evidence.hashes


def test_a_study_at_a_period_that_the_recipe_does_not_ask_for_is_foreign(workspace_of):
    evidence = gather(workspace_of("5ms", "1ms"))
    recipe = {"training": {"seeds": 20}, "transfer": {"control_periods_ms": [10, 5], "other_periods_seeds": 8}}
    assert evidence.foreign(recipe) == ["periods/1ms/transfer (no period of it)"]
    recipe["transfer"] |= {"control_periods_ms": [5, 1], "other_periods_seeds": None}
    assert evidence.foreign(recipe) == [f"periods/{name}/transfer ([training] seeds)" for name in ("5ms", "1ms")]
