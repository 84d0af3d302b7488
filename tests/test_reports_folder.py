"""The finished studies that the repository keeps: whole, small, and of the recipes as they stand."""

import json
from pathlib import Path

import pandas as pd
import pytest

from maglev_offline.hashes import sha256_of
from maglev_offline.recipe import load_recipe
from maglev_offline.transfer.findings import with_tables

ROOT = Path(__file__).parents[1]
STUDIES = sorted(path.parent for path in (ROOT / "reports").glob("*/manifest.json"))


@pytest.fixture(params=STUDIES, ids=lambda folder: folder.name)
def study(request):
    return request.param


def test_the_studies_are_there():
    assert [folder.name for folder in STUDIES] == ["changsha", "cure", "study"]


def test_files_are_those_of_the_manifest(study):
    files = json.loads((study / "manifest.json").read_text())["files"]
    assert {name: sha256_of(study / name) for name in files} == files


def test_a_study_is_of_its_recipe_as_it_stands(study):
    made = json.loads((study / "manifest.json").read_text())["settings"]
    recipe = load_recipe(ROOT / "pipelines" / f"{study.name}.toml")
    means = {"engine", "checkpoint_every"}
    for name in ("plant", "mdp", "training", "evaluation", "transfer"):
        wanted = getattr(recipe, name).model_dump(mode="json")
        assert {k: v for k, v in made[name].items() if k not in means} == {
            k: v for k, v in wanted.items() if k not in means
        }


def test_every_run_of_the_recipe_is_in_it(study):
    recipe = load_recipe(ROOT / "pipelines" / f"{study.name}.toml")
    metrics = pd.read_parquet(study / "metrics.parquet")
    runs = metrics[metrics["arm"].isin(recipe.transfer.arms)].groupby(["algorithm", "arm"])["seed"].nunique()
    assert len(runs) == len(recipe.training.algorithms) * len(recipe.transfer.arms)
    assert set(runs) == {recipe.training.seeds}


def test_the_page_is_light_and_alone(study):
    page = (study / "report.html").read_text(encoding="utf-8")
    assert len(page.encode()) < 3_000_000
    assert "default-src 'none'" in page
    assert load_recipe(ROOT / "pipelines" / f"{study.name}.toml").report.title in page


def test_the_findings_say_what_the_studies_found():
    document = ROOT / "docs" / "findings.md"
    text = document.read_text(encoding="utf-8")
    assert text.count("<!-- study of ") >= 4
    assert with_tables(text, ROOT / "reports") == text


def test_the_picture_of_the_readme_is_that_of_the_report():
    picture = (ROOT / "docs" / "images" / "differences.svg").read_text(encoding="utf-8")
    drawn = picture[picture.index("<g>") : picture.rindex("</svg>")]
    assert len(drawn) > 10_000
    assert drawn in (ROOT / "reports" / "study" / "report.html").read_text(encoding="utf-8")
