"""What the documents promise: their commands run as they stand, and their links lead somewhere."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "data_raw" / "README.md"])


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.S | re.M)


def test_every_command_of_the_readme_runs_in_the_order_in_which_it_is_read(reader):
    """What makes logs for those who have none; then what works as it stands, in a shell of its own; and the others."""
    scripts = blocks(ROOT / "README.md", "sh")
    (logs,) = (script for script in scripts if script.startswith("maglev-offline surrogate logs"))
    reader(logs)
    first, *others = (script for script in scripts if script != logs)
    assert "ingest logs/*.mcap" in first
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    command = ["bash", "-euo", "pipefail", "-c", first]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for script in others:
        reader(script)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_to_files_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_recipes_and_make_targets_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    for recipe in re.findall(r"pipelines/[\w-]+\.toml", text):
        assert (ROOT / recipe).is_file(), recipe
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.M)
    for target in re.findall(r"`?\bmake ([a-z]+)\b", "\n".join(re.findall(r"`[^`]+`|^make .*", text, flags=re.M))):
        assert target in targets, target


def test_the_architecture_names_every_folder_and_the_layers_as_they_are():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    folders = {path.name for path in (ROOT / "maglev_offline").iterdir() if path.is_dir() and path.name[0] != "_"}
    assert set(re.findall(r"^\| `(\w+)` \|", text, flags=re.M)) == folders
    told = "".join(re.findall(r"^    .*(?: > ).*\n", text, flags=re.M))
    (contract,) = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    assert [layer.strip() for layer in told.split(">") if layer.strip()] == contract["layers"]


def test_ci_calls_the_test_command_of_the_readme():
    commands = "\n".join(blocks(ROOT / "README.md", "console"))
    assert "make test" in commands
    assert "make test" in (ROOT / ".ci" / "run").read_text()
