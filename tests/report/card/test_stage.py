"""The card as an artefact: what it says is what the artefacts hold, and it says so the same each time."""

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from maglev_offline.errors import ArtefactError
from maglev_offline.report.card import stage
from maglev_offline.report.card.page import card_page
from maglev_offline.report.card.parts import parts_of
from maglev_offline.report.card.sample import packed, read_candidates
from maglev_offline.workspace import Manifest, Workspace

KEYS = (
    "schema", "name", "description", "intended_use", "sources", "shared_content", "ledger", "construction", "balance",
    "coverage", "diagnostic", "recovery", "residual", "doubts", "splits", "recipe", "artefacts", "versions",
)  # fmt: skip


@pytest.fixture(scope="module")
def card(carded):
    return json.loads((carded / "card" / stage.JSON).read_text())


@pytest.fixture(scope="module")
def page(carded, read_page):
    return read_page(carded / "card" / stage.PAGE)


@pytest.fixture
def workspace(carded, tmp_path):
    return Workspace(Path(shutil.copytree(carded, tmp_path / "workspace")))


def test_keys_are_stable(card):
    assert tuple(card) == KEYS
    assert card["schema"] == 1


def test_sources_are_the_logs_by_their_hash(card, carded):
    for source in card["sources"]:
        data = (carded.parent / source["file"]).read_bytes()
        assert source["sha256"] == hashlib.sha256(data).hexdigest()
        assert source["simulated"]
        assert source["first"] < source["last"]
        assert source["signals"]["gap"] == {"field": "gap_mm", "offset": 0.0, "sign": 1, "unit": "mm"}
        assert {found["severity"] for found in source["findings"]} <= {"error", "warning", "info"}


def test_books_balance_at_every_stage(card, carded):
    assert [(entry["stage"], entry["unit"]) for entry in card["ledger"]] == [
        ("ingest", "messages"), ("ingest", "grid rows"), ("curate", "rows"),
    ]  # fmt: skip
    for entry in card["ledger"]:
        assert entry["balances"]
        assert entry["in"] == entry["used"] + sum(entry["left_out"].values()) > 0
    assert card["ledger"][2]["used"] == len(pd.read_parquet(carded / "transitions/transitions.parquet"))
    assert card["ledger"][2]["left_out"]["excluded_by_rule"] > 0


def test_splits_are_by_whole_logs(card):
    train, validation = card["splits"]["train"], card["splits"]["validation"]
    assert len(train["logs"]) == len(validation["logs"]) == 1
    assert train["transitions"] == card["ledger"][2]["used"]
    assert validation["transitions"] == 0
    assert validation["candidates"] == card["ledger"][2]["left_out"]["held_out_for_validation"]


def test_numbers_and_hashes_are_those_of_the_artefacts(card, carded):
    made = Manifest.read(carded / "transitions")
    assert card["diagnostic"] == made.facts["diagnostic"]
    assert card["coverage"]["occupancy_after"] == made.facts["occupancy_after"]
    assert card["artefacts"]["transitions"]["files"] == made.files
    assert card["shared_content"] == []
    assert card["recipe"]["tables"]["curate"]["exclude"] == [{"gap_error_m": [-0.0002, -0.0001], "cost": [0.0, 1e9]}]


def test_page_is_whole_and_needs_nothing_else(page, carded):
    path = carded / "card" / stage.PAGE
    assert page.errors == []
    assert len(page.ids) == len(set(page.ids))
    assert page.references == []
    text = path.read_text()
    assert "http:" not in text
    assert "https:" not in text
    assert str(carded.parent) not in text
    assert path.stat().st_size < 1_000_000


def test_page_says_what_the_json_says(page, card):
    assert "Both logs are simulated" in page.text
    assert "SIMULATED" in page.text
    assert card["intended_use"]["verdict"].upper() in page.text
    for sentence in (*card["intended_use"]["for"], *card["intended_use"]["not_for"]):
        assert sentence in page.text
    cells = {cell for row in page.rows for cell in row}
    assert {source["sha256"] for source in card["sources"]} <= cells
    assert {code for entry in card["ledger"] for code in entry["left_out"]} <= cells
    assert {found["code"] for source in card["sources"] for found in source["findings"]} <= cells


def test_page_is_accessible(page):
    labels = {attributes["for"] for tag, attributes in page.tags if tag == "label" and "for" in attributes}
    fields = [attributes for tag, attributes in page.tags if tag in ("input", "textarea")]
    assert all(field["id"] in labels or field.get("aria-label") for field in fields)
    assert all(attributes.get("aria-label") for tag, attributes in page.tags if tag == "canvas")
    assert all(attributes.get("scope") in ("col", "row") for tag, attributes in page.tags if tag == "th")


def test_only_the_script_of_the_page_may_run(carded):
    text = (carded / "card" / stage.PAGE).read_text()
    script = re.search(r"<script>(.*?)</script>", text, re.S)[1]
    mark = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{mark}'" in text


def test_hostile_names_stay_text(card, carded, tmp_path, read_page):
    evil = "</script><script>alert(1)</script>&\"'"
    candidates = read_candidates(carded / "transitions").assign(point=evil)
    sample = candidates.head(5).assign(state=0, judged=0)
    hostile = card | {"name": evil, "doubts": [evil]}
    path = tmp_path / "card.html"
    path.write_text(card_page(hostile, packed(sample, candidates, [{"kind": "exclude", "point": [evil]}])))
    page = read_page(path)
    assert page.errors == []
    assert [tag for tag, _ in page.tags].count("script") == 2
    assert f"To be doubted: {evil}" in page.text


def test_second_run_does_nothing_and_another_workspace_gets_the_same_bytes(workspace, carded, recipe):
    assert not stage.build_card(workspace, recipe.name, recipe.description)[1]
    assert stage.build_card(workspace, "another")[1]
    folder, fresh = stage.build_card(workspace, recipe.name, recipe.description)
    assert fresh
    for name in (stage.JSON, stage.PAGE, "manifest.json"):
        assert (folder / name).read_bytes() == (carded / "card" / name).read_bytes()


def test_samples_that_are_gone_or_changed_are_named(workspace, recipe):
    one, other = workspace.list("samples")
    (one / "manifest.json").write_text((one / "manifest.json").read_text() + " ")
    shutil.rmtree(other)
    with pytest.raises(ArtefactError, match=rf"changed or are gone since .*{one.name}.*{other.name}.*curate` again"):
        stage.build_card(workspace, recipe.name)


def test_there_is_no_card_without_transitions(tmp_path):
    with pytest.raises(ArtefactError, match=r"no transitions in the workspace\. Run `maglev-offline ingest"):
        stage.build_card(Workspace(tmp_path), "nothing")


def test_prefills_of_other_transitions_are_no_part_of_it(workspace):
    def prefill(algorithm, source):
        manifest = Manifest(f"prefill/{algorithm}", "mark", {"transitions": source}, counts={"rows": 1})
        with workspace.commit(workspace.path("prefill", algorithm), manifest):
            pass

    prefill("ddpg", workspace.input_hash(workspace.path("transitions")))
    prefill("td3", "of long ago")
    parts = parts_of(workspace)
    assert [artefact.name for artefact in parts.prefills] == ["prefill/ddpg"]
    assert replace(parts, prefills=()).hashes.keys() < parts.hashes.keys()
