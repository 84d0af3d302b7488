"""What the configuration of the wheels promises."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
CONFIGURATION = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_wheels_are_tried_in_every_python_that_the_project_names():
    named = [text for text in CONFIGURATION["project"]["classifiers"] if re.search(r":: 3\.\d+$", text)]
    tried = CONFIGURATION["tool"]["cibuildwheel"]["build"]
    assert tried == [f"cp{text.rpartition(' ')[2].replace('.', '')}-*" for text in named]


def test_every_wheel_is_looked_at_from_outside_and_one_in_every_run_of_ci():
    look = CONFIGURATION["tool"]["cibuildwheel"]["test-command"].rpartition("{project}/")[2]
    assert (ROOT / look).is_file()
    assert look in (ROOT / ".ci" / "wheel").read_text()
    assert re.search(r"^make wheel\b", (ROOT / ".ci" / "run").read_text(), flags=re.M)
    assert re.search(r"^wheel:.*\n\t\.ci/wheel$", (ROOT / "Makefile").read_text(), flags=re.M)
