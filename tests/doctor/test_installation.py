import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from maglev_offline.doctor import installation
from maglev_offline.doctor.installation import EXTRAS, SOURCE_EXTRAS, Declared, declared, dependencies, extras, package

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

SAID = Declared(
    python=">=3.11",
    dependencies=["numpy>=2.0", "zstandard>=0.22", "winonly>=1; sys_platform == 'win32'"],
    extras={"export": ["onnx>=1.18", "onnxruntime>=1.20"], "dev": ["ruff>=0.8"]},
    tested={"numpy": "2.4.6", "zstandard": "0.25.0"},
    tree=ROOT,
)


@pytest.fixture
def versions(monkeypatch):
    """Versions of the packages that are here; a test takes some away."""
    here = {"maglev-offline": "0.1.0", "packaging": "26.3", "numpy": "2.4.6", "zstandard": "0.25.0", "ruff": "0.9",
            "onnx": "1.20", "onnxruntime": "1.21"}  # fmt: skip
    monkeypatch.setattr(installation, "_version", here.get)
    return here


def test_a_source_tree_says_what_it_needs_itself():
    said = declared()
    assert (said.tree, said.dependencies, said.extras) == (
        ROOT,
        PROJECT["dependencies"],
        PROJECT["optional-dependencies"],
    )
    assert said.tested["torch"] == "2.13.0"


METADATA = """\
Metadata-Version: 2.4
Name: maglev-offline
Version: 0.1.0
Requires-Python: >=3.11
Provides-Extra: export
Requires-Dist: numpy>=2.0
Requires-Dist: onnx>=1.18; extra == "export"
"""


def test_an_installed_package_says_it_in_its_metadata(monkeypatch, tmp_path):
    home = tmp_path / "maglev_offline-0.1.0.dist-info"
    home.mkdir()
    (home / "METADATA").write_text(METADATA)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    said = declared(beside=tmp_path)
    assert said[:2] == (">=3.11", ["numpy>=2.0"])
    assert list(said.extras) == ["export"]
    assert (said.tested, said.tree) == ({}, None)


def test_a_package_that_is_neither_installed_nor_in_its_tree_is_told_of(monkeypatch, tmp_path):
    def nowhere(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "metadata", nowhere)
    monkeypatch.setattr(metadata, "version", nowhere)
    assert declared(beside=tmp_path) is None
    assert [check.state for check in (package(None), *dependencies(None))] == ["note", "note"]
    assert extras(None) == []


def test_every_dependency_is_held_against_its_requirement(versions):
    assert [(check.about, check.state, check.what) for check in dependencies(SAID)] == [
        ("numpy", "ok", "2.4.6"),
        ("zstandard", "ok", "0.25.0"),
    ]


@pytest.mark.parametrize(
    ("version", "what"), [(None, "not here, and >=2.0 is needed"), ("1.26.4", "1.26.4, and >=2.0 is needed")]
)
def test_a_dependency_that_is_missing_or_too_old_is_a_problem_and_says_what_to_install(versions, version, what):
    versions["numpy"] = version
    check = dependencies(SAID)[0]
    assert (check.state, check.what, check.todo) == ("problem", what, "pip install 'numpy>=2.0'")
    assert check.facts == {"version": version, "needs": ">=2.0", "tested": "2.4.6"}


def test_other_versions_than_the_tested_ones_are_one_note(versions):
    versions |= {"numpy": "2.5.0", "zstandard": "0.25.0+local"}
    *_, note = dependencies(SAID)
    assert (note.code, note.state) == ("versions", "note")
    assert "numpy 2.5.0 (2.4.6)" in note.what
    assert "zstandard" not in note.what


def test_without_the_reader_of_requirements_nothing_is_claimed(versions):
    versions["packaging"] = None
    assert [(check.about, check.state) for check in dependencies(SAID)] == [("packaging", "problem")]
    assert extras(SAID) == []
    assert installation.python(SAID)[0].state == "ok"


def test_an_optional_package_that_is_missing_is_a_note_with_the_way_to_get_it(versions):
    versions["onnx"], versions["onnxruntime"] = None, "1.19"
    (export,) = [check for check in extras(SAID) if check.about == "extra export"]
    assert (export.state, export.todo) == ("note", "pip install 'maglev-offline[export]'")
    assert export.facts == {
        "versions": {"onnx": None, "onnxruntime": "1.19"},
        "missing": ["onnx", "onnxruntime"],
    }


def test_what_contributors_need_is_told_in_the_source_tree_alone_and_is_no_lack(versions):
    versions["ruff"] = None
    assert {check.about: check.state for check in extras(SAID)} == {"extra dev": "ok", "extra export": "ok"}
    assert [check.about for check in extras(SAID._replace(tree=None))] == ["extra export"]


def test_every_extra_of_the_project_is_known():
    assert set(EXTRAS) | set(SOURCE_EXTRAS) == set(PROJECT["optional-dependencies"])


def test_a_python_that_is_too_old_is_a_problem():
    (check,) = installation.python(SAID._replace(python=">=3.99"))
    assert (check.state, check.todo) == ("problem", "Install it into an environment with Python >=3.99.")


@pytest.mark.parametrize(("name", "state"), [("Linux", "ok"), ("Darwin", "note"), ("Windows", "problem")])
def test_systems_are_judged_by_what_was_tried_on_them(monkeypatch, name, state):
    monkeypatch.setattr(installation.platform, "system", lambda: name)
    assert installation.system().state == state


def test_an_older_installation_is_seen(versions):
    versions["maglev-offline"] = "0.0.9"
    assert package(SAID).state == "note"


def test_the_doctor_comes_without_what_may_be_missing():
    script = "import maglev_offline.doctor.examination, sys; print(sorted({'numpy', 'pydantic', 'pyarrow', 'torch', "
    script += "'packaging', 'rich', 'typer'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
