import errno
import json
import os

import pytest
from safetensors import SafetensorError

from maglev_offline import pipeline
from maglev_offline.workspace import Workspace

SIGNALS = """
[signals]
topic = "/(?P<point>.+)"
gap = { field = "gap", unit = "kg" }
current = { field = "current", unit = "A" }
voltage = { field = "voltage", unit = "V" }
"""

BAD_INPUT = [
    (("ingest", "empty"), "empty: no MCAP file is there."),
    (("ingest", "none/*.mcap"), "none/*.mcap: no MCAP file is there."),
    (("ingest", "logs", "--recipe", "none.toml"), "none.toml: there is no such recipe."),
    (("ingest", "logs", "--recipe", "key.toml"), "[curate] target_row: unknown key (did you mean `target_rows`?)"),
    (("ingest", "logs", "--recipe", "unit.toml"), "unit 'kg' cannot be turned into 'm'"),
    (("ingest", "logs", "--workspace", "tiny.toml"), "tiny.toml: this is a file, and a workspace is a folder."),
    (("surrogate", "tiny.toml"), "tiny.toml: it cannot be used"),
    (("surrogate", "new", "--points", "0"), "--points"),
    (("surrogate", "new", "--duration-s", "nan"), "--duration-s"),
    (("surrogate", "new", "--duration-s", "inf"), "--duration-s"),
    (("curate",), "there are no samples in the workspace."),
    (("prefill",), "there are no curated transitions"),
    (("prefill", "--algo", "sac"), "there is no algorithm 'sac'."),
    (("train", "--arm", "full"), "there is no arm 'full'."),
    (("train", "--recipe", "short.toml"), "[training]: exploratory_steps = 1000 leaves no gradient step in steps = 10"),
    (("train", "--steps", "many"), "--steps"),
    (("transfer", "--recipe", "tiny.toml"), "there are no curated transitions"),
    (("transfer", "--recipe", "coarse.toml"), "1 evaluations after the first gradient step are too few"),
    (("run",), "give a recipe"),
    (("run", "none.toml"), "there is no such recipe."),
    (("bogus",), "No such command 'bogus'."),
    (("ingst",), "Did you mean 'ingest'"),
    (("card",), "there are no transitions in the workspace."),
    (("ingest",), "Missing"),
    (("ingest", "logs", "--colour"), "--colour"),
]  # fmt: skip


@pytest.fixture
def folder(here):
    (here / "empty").mkdir()
    (here / "key.toml").write_text("[curate]\ntarget_row = 5\n")
    (here / "unit.toml").write_text(SIGNALS)
    (here / "short.toml").write_text("[training]\nsteps = 10\n")
    (here / "coarse.toml").write_text("[evaluation]\nevery_steps = 20_000\n")
    return here


@pytest.mark.parametrize(("arguments", "said"), BAD_INPUT, ids=lambda x: " ".join(x) if isinstance(x, tuple) else "")
def test_bad_input_is_told_in_one_paragraph_with_exit_code_2(folder, call, arguments, said):
    called = call(*arguments)
    assert called.code == 2
    assert called.err.startswith("error: ")
    assert called.err.count("\n") == 1
    assert said in called.err
    assert called.out == ""
    assert not list(folder.rglob("*.draft"))


@pytest.mark.parametrize(("arguments", "said"), BAD_INPUT, ids=lambda x: " ".join(x) if isinstance(x, tuple) else "")
@pytest.mark.usefixtures("folder")
def test_a_script_gets_the_same_error_as_json(call, arguments, said):
    called = call(*arguments, "--json")
    data = called.json
    assert called.code == 2
    assert data["status"] == "error"
    assert said in f"{data['where']}: {data['what']}"
    assert set(data) == {"status", "what", "where", "todo"}


@pytest.fixture
def broken(here, monkeypatch):
    def fail(*_):
        raise RuntimeError("a bug of ours")

    monkeypatch.setattr(pipeline, "curate", fail)
    return here


@pytest.mark.usefixtures("broken")
def test_a_failure_of_ours_is_told_without_a_traceback_and_with_exit_code_1(call):
    called = call("curate", "--json")
    assert called.code == 1
    assert called.err.startswith("error: a failure of maglev-offline itself: RuntimeError: a bug of ours.")
    assert "MAGLEV_OFFLINE_DEBUG" in called.err
    assert "Traceback" not in called.err
    assert called.json["status"] == "error"


def test_a_failure_gives_the_workspace_back(broken, call):
    call("curate")
    with Workspace(broken / "workspace").lock("run"):
        pass


@pytest.mark.usefixtures("broken")
def test_where_a_failure_came_from_can_be_asked_for(call, monkeypatch):
    monkeypatch.setenv("MAGLEV_OFFLINE_DEBUG", "1")
    with pytest.raises(RuntimeError, match="a bug of ours"):
        call("curate")


def test_bad_input_is_no_failure_to_look_into(here, call, monkeypatch):
    monkeypatch.setenv("MAGLEV_OFFLINE_DEBUG", "1")
    assert call("curate", "--workspace", here / "none").code == 2


@pytest.mark.usefixtures("here")
def test_a_command_that_is_stopped_says_that_it_can_go_on(call, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "curate", stop)
    called = call("curate")
    assert called.code == 130
    assert called.err == "stopped. What is finished is kept; a training goes on at its last checkpoint.\n"


def test_a_workspace_in_use_is_refused_with_exit_code_1(here, call):
    with Workspace(here / "workspace").lock("train"):
        called = call("ingest", "logs", "--json")
    assert called.code == 1
    assert "the workspace is in use by `maglev-offline train`" in json.loads(called.out)["what"]


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "samples.parquet")


@pytest.mark.parametrize(
    ("failure", "code", "said"),
    [
        (FULL, 1, "samples.parquet: there is no room left to write. Make room"),
        (OSError(errno.EFBIG, "Error writing bytes to file"), 1, "there is no room left to write."),
        (SafetensorError("I/O error: No space left on device (os error 28)"), 1, "there is no room left to write."),
        (FileNotFoundError(errno.ENOENT, "gone", "a.parquet"), 2, "a.parquet: it is not there, or was removed"),
        (OSError(errno.EROFS, "Read-only file system", "a"), 2, "a: it cannot be used (Read-only file system)."),
    ],
)
@pytest.mark.usefixtures("here")
def test_what_the_disk_refuses_is_told_in_plain_words(call, monkeypatch, failure, code, said):
    def fail(*_):
        raise failure

    monkeypatch.setattr(pipeline, "curate", fail)
    called = call("curate")
    assert called.code == code
    assert said in called.err
    assert "failure of maglev-offline itself" not in called.err
