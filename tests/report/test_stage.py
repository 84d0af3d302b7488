"""The page as a whole: well-formed, self-contained, honest about what is missing, the same bytes each time."""

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from markupsafe import Markup

from maglev_offline.curate.settings import CurateSettings
from maglev_offline.curate.stage import curate
from maglev_offline.errors import ArtefactError
from maglev_offline.physics.parameters import Plant
from maglev_offline.report import stage
from maglev_offline.report.evidence import gather
from maglev_offline.report.numbers import interval, number, whole
from maglev_offline.report.settings import ReportSettings
from maglev_offline.report.stage import build_report
from maglev_offline.workspace import Manifest, Workspace, sha256_of

FIGURES = (
    *("trajectory-1", "trajectory-2", "coverage", "truth", "residual", "prefill"),
    *("force", "root-locus", "steps", "robustness"),
    *("regulation", "long", "curves", "forest", "differences", "profiles"),
)
SECTIONS = (
    *("origin", "trajectories", "coverage", "truth", "prefill"),
    *("plant", "regulation", "curves", "verdict"),
    *("differences", "profiles", "paper", "threats", "runs", "recipe"),
)


def build(workspace, recipe, drawn=FIGURES, **changes):
    """The report. To draw is most of the work: figures not in `drawn` stay blank.

    `reported` has all of them drawn; a test of the words draws those that look different in its workspace.
    """

    real = stage.drawn

    def draw(plot):
        return real(plot) if plot.key in drawn else Markup('<svg viewBox="0 0 1 1"></svg>')

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage, "drawn", draw)
        return build_report(workspace, ReportSettings(**changes), recipe.plain(), recipe.name)


@pytest.fixture(scope="module")
def path(reported):
    return reported.path("report", stage.PAGE)


@pytest.fixture(scope="module")
def page(path, read_page):
    return read_page(path)


def test_page_is_well_formed(page):
    assert page.errors == []
    assert len(page.ids) == len(set(page.ids))
    inside = [reference[1:] for reference in page.references if reference.startswith("#")]
    assert set(inside) <= set(page.ids)


def test_page_needs_nothing_else(page, path, reported):
    assert all(reference.startswith(("#", "data:image/png;base64,")) for reference in page.references)
    assert not {"link", "iframe", "object", "img"} & {tag for tag, _ in page.tags}
    text = path.read_text()
    data, script = (attributes for tag, attributes in page.tags if tag == "script")
    assert (data, script) == ({"type": "application/json"}, {})
    assert "default-src 'none'" in text
    assert "http" not in re.sub(r"http://www\.w3\.org/2000/svg|http-equiv", "", text)
    assert "@import" not in text
    assert str(reported.root.parent) not in text
    assert len(text.encode()) < 3_000_000


def test_sections_and_figures_come_in_order(page):
    headings = [attributes["id"] for tag, attributes in page.tags if tag == "h2" and attributes["id"] != "contents"]
    assert tuple(headings) == SECTIONS
    figures = [attributes["id"] for tag, attributes in page.tags if tag == "figure" and "id" in attributes]
    assert tuple(figures) == tuple(f"figure-{key}" for key in FIGURES)


def test_page_is_accessible(page):
    html = next(attributes for tag, attributes in page.tags if tag == "html")
    assert html["lang"] == "en"
    images = [attributes for _, attributes in page.tags if attributes.get("role") == "img"]
    assert len(images) == len(FIGURES)
    assert all(attributes["aria-label"] for attributes in images)
    tags = [tag for tag, _ in page.tags]
    assert tags.count("caption") == tags.count("table") > 8
    assert all(attributes.get("scope") in ("col", "row") for tag, attributes in page.tags if tag == "th")
    assert ("a", {"class": "skip", "href": "#main"}) in page.tags


def test_simulated_logs_are_called_so(page):
    assert "Both logs are simulated" in page.text


def test_books_balance_in_words(page, made):
    counts = [Manifest.read(folder).counts for folder in Workspace(made).list("samples")]
    came, used = sum(c["messages"] for c in counts), sum(c["messages_used"] for c in counts)
    assert f"{whole(came)} messages came in = {whole(used)} used + {whole(came - used)} quarantined" in page.text


def test_every_reason_code_is_listed_with_its_count(page, made):
    ledger = pd.concat([pd.read_parquet(f / "quarantine.parquet") for f in Workspace(made).list("samples")])
    for code, count in ledger.groupby("code")["count"].sum().items():
        assert any(row[0] == code and row[-1] == whole(count) for row in page.rows)


def test_verdict_table_is_the_manifest(page, made):
    facts = Manifest.read(made / "transfer").facts
    rows = [[cell.replace("\xa0", " ") for cell in row] for row in page.rows]
    for found in facts["algorithms"].values():
        for metric, effect in found["effects"]["prefill"].items():
            wanted = [
                metric.replace("_", " "),
                *(number(effect[key]) for key in ("baseline_mean", "arm_mean", "difference")),
                interval(effect["low"], effect["high"]).replace("\xa0", " "),
            ]
            row = next(row for row in rows if row[:5] == wanted)
            assert row[6] == number(effect["p_value_holm"])
            assert row[8] == number(effect["margin"])
            assert effect["verdict"] in row[9]


def test_every_artefact_hash_and_recipe_number_is_there(page, made):
    names = {row[0] for row in page.rows}
    artefacts = {path.parent.relative_to(made).as_posix() for path in made.rglob("manifest.json")}
    assert artefacts <= names
    assert "exploratory_steps = 100" in page.text
    assert "[surrogate.sensors]" in page.text


def test_second_run_does_nothing_and_another_workspace_gets_the_same_bytes(reported, recipe, tmp_path):
    workspace = Workspace(Path(shutil.copytree(reported.root, tmp_path / "another")))
    assert not build(workspace, recipe)[1]
    assert build(workspace, recipe, drawn=(), title="Another")[1]
    path, fresh = build(workspace, recipe)
    assert fresh
    for name in (stage.PAGE, "manifest.json"):
        assert (path.parent / name).read_bytes() == reported.path("report", name).read_bytes()


@pytest.mark.parametrize(
    ("missing", "section", "command", "drawn"),
    [
        (("transfer",), "verdict", "maglev-offline transfer", ("curves",)),
        (("transfer", "training"), "curves", "maglev-offline transfer", ("regulation",)),
        (("control",), "regulation", "maglev-offline control", ("regulation",)),
        (("prefill",), "prefill", "maglev-offline prefill", ()),
        (("transitions",), "coverage", "maglev-offline curate", ()),
        (("samples",), "origin", "maglev-offline ingest", ()),
    ],
)
def test_missing_artefact_becomes_a_sentence_with_its_command(
    workspace, recipe, read_page, missing, section, command, drawn
):
    for name in missing:
        shutil.rmtree(workspace.path(name))
    path, _ = build(workspace, recipe, drawn)
    page = read_page(path)
    assert page.errors == []
    assert command in page.text
    text = path.read_text()
    part = text[text.index(f'<h2 id="{section}"') :]
    part = part[: part.index("</section>")]
    assert f"<code>{command}" in part


def test_empty_workspace_is_refused_and_left_empty(tmp_path, recipe):
    with pytest.raises(ArtefactError, match=r"nothing in the workspace to report on.*Run `maglev-offline ingest"):
        build(Workspace(tmp_path), recipe)
    assert list(tmp_path.iterdir()) == []


def test_tampered_artefact_is_refused(workspace, recipe):
    path = workspace.path("transitions", "transitions.parquet")
    pd.read_parquet(path).head(20).to_parquet(path)
    with pytest.raises(ArtefactError, match=r"transitions.parquet is not what was written"):
        build(workspace, recipe)


def test_no_warning_without_a_reason(made, page):
    assert [a for _, a in page.tags if "warning" in (a.get("class") or "")] == []
    assert Manifest.read(made / "transitions").facts["doubts"] == []


def edit(folder, **tables):
    """Change the manifest of an artefact, as if it had been made so."""
    data = json.loads((folder / "manifest.json").read_text())
    for name, change in tables.items():
        data[name] = {**data[name], **change}
    (folder / "manifest.json").write_text(json.dumps(data | {"seal": ""}))


def test_doubts_are_told_in_the_head(workspace, recipe, read_page):
    edit(workspace.path("transitions"), facts={"doubts": ["the logged <gap> (median 0.8 m) does not fit"]})
    text = read_page(build(workspace, recipe, drawn=())[0]).text
    assert "To be doubted: the logged <gap> (median 0.8 m) does not fit" in text
    assert text.index("To be doubted") < text.index("The logs, how many of their messages")


def test_artefacts_of_another_recipe_are_named_with_their_tables(workspace, recipe, read_page):
    other = recipe.model_copy(update={"plant": Plant(mass_kg=650), "curate": CurateSettings(target_rows=301)})
    text = read_page(build(workspace, other, drawn=())[0]).text
    told = text.split("such as --seeds and --steps):")[1].split("\n")[0]
    assert "transitions ([curate], [plant])" in told or "transitions ([plant], [curate])" in told
    assert "control ([plant])" in told
    assert "transfer ([plant])" in told


def test_blocks_that_a_study_of_fewer_seeds_left_are_not_of_another_recipe(workspace, recipe):
    for folder in workspace.list("training/ddpg-empty"):
        training = Manifest.read(folder).settings["training"]
        edit(folder, settings={"training": training | {"seeds": 2}})
    assert not [name for name in gather(workspace).foreign(recipe.plain()) if name.startswith("training/")]


def test_how_the_engine_was_asked_for_makes_no_other_recipe(workspace, recipe):
    training = recipe.training.model_copy(update={"engine": "torch", "checkpoint_every": 99})
    asked = recipe.model_copy(update={"training": training})
    assert gather(workspace).foreign(asked.plain()) == gather(workspace).foreign(recipe.plain()) == []


def test_logs_that_are_not_in_the_transitions_are_named_and_marked_in_their_table(workspace, recipe, read_page):
    one, other = workspace.list("samples")
    curate(workspace, recipe.curate, recipe.plant, recipe.mdp, folders=[one])
    page = read_page(build(workspace, recipe, drawn=("coverage",))[0])
    assert f"not in the transitions that this page is about: samples/{other.name}." in page.text
    head = next(row for row in page.rows if row[-1] == "curated")
    rows = page.rows[page.rows.index(head) + 1 :][:2]
    assert {row[0]: row[-1] for row in rows} == {
        Manifest.read(one).facts["file"]: "yes",
        Manifest.read(other).facts["file"]: "no",
    }


def test_recipe_without_agents_asks_for_none(workspace, recipe, read_page):
    for name in ("transfer", "training", "prefill"):
        shutil.rmtree(workspace.path(name))
    training = recipe.training.model_copy(update={"algorithms": ()})
    data_only = recipe.model_copy(update={"training": training, "name": "data only"})
    path, _ = build(workspace, data_only, drawn=("regulation",))
    text = read_page(path).text
    assert "The recipe trains no agent" in text
    assert "maglev-offline transfer" not in text
    assert "figure-regulation" in path.read_text()


def test_hostile_names_are_escaped(workspace, recipe, read_page):
    folder = workspace.list("samples")[0]
    evil = "<script>alert(1)</script>$x_{\x00&\"'"
    samples = pd.read_parquet(folder / "samples.parquet")
    samples["point"] = evil
    samples.to_parquet(folder / "samples.parquet")
    edit(folder, facts={"file": evil}, files={"samples.parquet": sha256_of(folder / "samples.parquet")})
    path, _ = build(workspace, recipe, ("trajectory-1", "trajectory-2", "residual"), title=evil)  # they have names
    page = read_page(path)
    assert page.errors == []
    assert [tag for tag, _ in page.tags].count("script") == 2  # the curves' numbers and their script, and no other
    assert "<script>alert(1)</script>" in page.text
    assert "\x00" not in path.read_text()


def test_results_older_than_their_inputs_are_called_so(workspace, recipe, read_page):
    path = workspace.path("transitions", "manifest.json")
    path.write_text(path.read_text() + " ")
    page = read_page(build(workspace, recipe, drawn=())[0])
    assert "Older than what they were made from" in page.text
    assert "prefill/ddpg" in page.text.split("Older than")[1][:200]


def test_example_log_is_chosen_by_name(workspace, recipe, read_page):
    second = workspace.list("samples")[1]
    text = read_page(build(workspace, recipe, ("trajectory-1",), example_log=second.name)[0]).text
    assert f"From samples/{second.name}" in text
    text = read_page(build(workspace, recipe, (), example_log="no such log")[0]).text
    assert "There is no log “no such log”" in text
