"""What the tab key offers, through the same door as a shell's."""

import subprocess
import sys
from typing import get_args

import pytest

from maglev_offline import cli
from maglev_offline.agents.settings import Algorithm, EngineChoice
from maglev_offline.cli import completion
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.policies.rollout import DRIVERS
from maglev_offline.recipe import parse_recipe, remember
from maglev_offline.transfer.settings import BUILT_IN

STUDY = '[transfer.arm.gentle]\nrows = "log"\n'


@pytest.fixture
def tab(tmp_path, monkeypatch, capsys):
    """What a shell gets for a line on which the tab key is pressed; the last word may be empty."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MAGLEV_OFFLINE_WORKSPACE", raising=False)

    def press(line):
        words = ["maglev-offline", *line.split(" ")]
        monkeypatch.setattr(sys, "argv", ["maglev-offline"])
        monkeypatch.setenv("_MAGLEV_OFFLINE_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", " ".join(words))
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        with pytest.raises(SystemExit) as ended:
            cli.run()
        assert ended.value.code == 0
        return capsys.readouterr().out.split()

    return press


def test_the_names_are_those_that_the_settings_know():
    fields = CurateSettings.model_fields
    assert set(completion.ALGORITHMS) == set(get_args(Algorithm))
    assert set(completion.ENGINES) == set(get_args(EngineChoice))
    assert list(completion.ARMS) == list(BUILT_IN)
    assert set(completion.CONSTRUCTIONS) == set(get_args(fields["construction"].annotation))
    assert set(completion.BALANCES) == set(get_args(fields["balance"].annotation))
    assert set(completion.CONTROLLERS) == set(DRIVERS)


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("tra", ["train", "transfer"]),
        ("doc", ["doctor"]),
        ("train --algo ", ["ddpg", "td3"]),
        ("prefill --algo t", ["td3"]),
        ("transfer --engine n", ["native"]),
        ("train --arm p", ["prefill", "pid"]),
        ("curate --construction s", ["semi_markov", "simulated_next"]),
        ("curate --balance c", ["cells", "coverage"]),
        ("policy rollout --controller lqr", ["lqr", "lqr_held"]),
        ("policy export --format s", ["safetensors"]),
        ("prefill --format sb", ["sb3"]),
    ],
)
def test_names_are_completed(tab, line, offered):
    assert tab(line) == offered


def test_recipes_are_completed_here_and_one_folder_below(tab, tmp_path):
    (tmp_path / "pipelines").mkdir()
    for name in ("own.toml", "pipelines/study.toml", "pipelines/notes.md", ".hidden.toml"):
        (tmp_path / name).touch()
    assert tab("train --recipe ") == ["own.toml", "pipelines/study.toml"]
    assert tab("ingest -r pipelines/s") == ["pipelines/study.toml"]
    assert tab(f"ingest -r {tmp_path}/o") == [f"{tmp_path}/own.toml"]
    assert tab("train --recipe none/") == []


def test_arms_are_those_of_the_recipe_that_is_given_or_remembered(tab, tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    assert tab("train --recipe study.toml --arm g") == ["gentle"]
    assert tab("train --arm g") == []
    for folder in ("workspace", "other"):
        remember(tmp_path / folder, parse_recipe({"transfer": {"arm": {f"g-{folder}": {}}}}, "here"))
    assert tab("train --arm g") == ["g-workspace"]
    assert tab("policy export --workspace other --arm g") == ["g-other"]


@pytest.mark.parametrize("text", ["[transfer", "transfer = 3", "transfer.arm = 3", "\udcff"])
def test_a_damaged_recipe_offers_the_built_in_arms(tab, tmp_path, text):
    (tmp_path / "bad.toml").write_text(text, errors="surrogateescape")
    assert tab("train --recipe bad.toml --arm e") == ["empty"]


def test_a_tab_imports_nothing_heavy():
    script = "import maglev_offline.cli, sys; print(sorted({'numpy', 'pydantic', 'rich.table'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_command_gives_a_shell_its_script(shell, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["maglev-offline", "--show-completion", shell])
    with pytest.raises(SystemExit) as ended:
        cli.run()
    assert not ended.value.code
    assert "_MAGLEV_OFFLINE_COMPLETE" in capsys.readouterr().out
