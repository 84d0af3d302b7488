import re

import pytest
from typer.testing import CliRunner

from maglev_offline import __version__
from maglev_offline.cli import app

COMMANDS = [
    "surrogate", "inspect", "ingest", "curate", "prefill", "control", "train", "transfer", "card", "report", "run",
    "doctor",
]  # fmt: skip


def help_of(*command):
    result = CliRunner(env={"COLUMNS": "200", "TERM": "dumb", "NO_COLOR": "1"}).invoke(app, [*command, "--help"])
    assert result.exit_code == 0
    return re.sub(r"\x1b\[[0-9;]*m", "", result.output)


def test_the_commands_are_the_stages_of_the_road():
    text = help_of()
    assert [name for name in COMMANDS if re.search(rf"[│ ] {name} ", text)] == COMMANDS
    assert "maglev-offline run pipelines/quickstart.toml" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_an_example_and_the_shared_options(command):
    text = help_of(command)
    assert f"Example: maglev-offline {command}" in text
    for option in ("--json", "--workspace", "--recipe", "--quiet"):
        assert option in text


@pytest.mark.parametrize("command", COMMANDS)
def test_the_example_of_a_command_is_one_that_it_understands(command):
    example = re.search(r"Example: maglev-offline (.+)", help_of(command)).group(1).strip(" │").split()
    options = {word for word in example if word.startswith("--")}
    assert all(option in help_of(command) for option in options)


def test_the_version(call):
    assert call("--version").out == f"maglev-offline {__version__}\n"


def test_no_command_at_all_shows_the_help(call):
    called = call()
    assert called.code == 2
    assert "Usage:" in called.out + called.err
    assert "failure" not in called.err
