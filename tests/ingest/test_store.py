"""The stage: one artefact for each log, the same bytes whatever the order and the number of jobs."""

import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from maglev_offline.errors import ArtefactError
from maglev_offline.ingest import store
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.resample import ORIGINS
from maglev_offline.ingest.store import ingest_logs, load_samples, log_id_of
from maglev_offline.progress import Silent
from maglev_offline.workspace import Manifest, Workspace

REGULAR = range(0, 300, 10)


@pytest.fixture
def run(workspace, plant, grid_10):
    def run(paths, where=workspace, *, using=grid_10, **options):
        return ingest_logs(paths, where, Request(None, using, plant), **options)

    return run


@pytest.fixture
def logs(tmp_path, write_log):
    """Three different logs."""
    return [
        write_log(tmp_path / f"{name}.mcap", REGULAR, np.full(30, g)) for name, g in zip("abc", (7, 8, 9), strict=True)
    ]


def test_each_log_is_an_artefact_of_its_own(run, workspace, logs):
    result = run(logs)
    assert [log.status for log in result.logs] == ["ingested"] * 3
    assert result.folders == tuple(workspace.list("samples"))
    manifest = Manifest.read(result.folders[0])
    assert sorted(manifest.files) == ["content.parquet", "findings.json", "quarantine.parquet", "samples.parquet"]
    assert manifest.counts["rows"] == 30
    assert manifest.facts["file"] == "a.mcap"
    assert manifest.facts["signals_detected"]
    assert manifest.facts["signals"]["gap"]["field"] == "gap_mm"
    assert manifest.inputs["log"].startswith(result.logs[0].log_id[-8:])


def test_what_is_there_unchanged_is_skipped_without_reading_it_again(run, logs, monkeypatch):
    first = run(logs)
    monkeypatch.setattr("maglev_offline.ingest.log.ingest_log", lambda *_, **__: pytest.fail("decoded again"))
    again = run(logs)
    assert [log.status for log in again.logs] == ["skipped"] * 3
    assert again.logs[0].counts == first.logs[0].counts
    assert again.folders == first.folders


def test_other_settings_make_it_anew(run, logs, grid_10):
    run(logs)
    assert run(logs, using=grid_10.model_copy(update={"grid_ms": 20.0})).logs[0].counts["rows"] == 15


def everything(workspace):
    return {p.relative_to(workspace.root): p.read_bytes() for p in workspace.root.rglob("*") if p.is_file()}


def test_order_jobs_and_place_change_no_byte(run, logs, tmp_path):
    one, two = Workspace(tmp_path / "one"), Workspace(tmp_path / "two")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    moved = [shutil.copy(path, elsewhere / path.name) for path in logs]
    first = run(logs, one)
    second = run(moved[::-1], two, jobs=2)
    assert everything(one) == everything(two)
    assert [log.log_id for log in first.logs] == [log.log_id for log in second.logs]
    assert not any(str(tmp_path).encode() in content for content in everything(one).values())


def test_a_bad_log_is_refused_and_the_others_are_ingested(run, logs, tmp_path, write_log, mcap_files):
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "text.mcap").write_text("t,gap\n")
    write_log(tmp_path / "short.mcap", [0])
    mcap_files.write(tmp_path / "other.mcap", [mcap_files.Msg("/rosout", 1, {"level": 1})])
    bad = [tmp_path / f"{name}.mcap" for name in ("empty", "text", "short", "other", "missing")]
    result = run([*bad, *logs])
    said = {log.path.stem: log.message for log in result.refused}
    assert set(said) == {path.stem for path in bad}
    assert "0 bytes" in said["empty"]
    assert "not an MCAP file" in said["text"]
    assert "fewer than two usable samples" in said["short"]
    assert "have to be named" in said["other"]
    assert "cannot be opened" in said["missing"]
    assert all(str(log.path) in log.message for log in result.refused)
    assert len(result.folders) == 3


def test_the_same_content_under_another_name_is_a_duplicate(run, logs, tmp_path, workspace):
    copy = shutil.copy(logs[1], tmp_path / "z.mcap")
    result = run([copy, *logs])
    assert [log.status for log in result.logs] == ["ingested", "ingested", "ingested", "duplicate"]
    assert "the same content as b.mcap" in result.logs[3].message
    assert len(result.folders) == 3
    later = run([copy])
    assert [log.status for log in later.logs] == ["duplicate"]
    assert later.folders == (workspace.path("samples", result.logs[1].log_id),)


def test_other_settings_under_another_name_take_the_place_of_the_old(run, logs, tmp_path, workspace, grid_10):
    run(logs[:1])
    copy = shutil.copy(logs[0], tmp_path / "z.mcap")
    result = run([copy], using=grid_10.model_copy(update={"grid_ms": 20.0}))
    assert result.logs[0].status == "ingested"
    assert workspace.list("samples") == list(result.folders)


def test_a_log_id_is_safe_for_a_file_name(tmp_path):
    assert log_id_of(tmp_path / "Über uns (1).mcap", "0123456789abcdef") == "_ber_uns_1_-01234567"
    assert log_id_of(tmp_path / "...mcap", "0123456789abcdef") == "log-01234567"


def test_simulated_logs_say_so(run, tmp_path, write_log):
    path = write_log(tmp_path / "s.mcap", REGULAR, metadata={"surrogate": {"simulated": "true"}})
    facts = Manifest.read(run([path]).folders[0]).facts
    assert facts["simulated"] is True


def test_progress_hears_of_each_log(run, logs, tmp_path):
    class Listener(Silent):
        def __init__(self):
            self.said, self.errors = [], []

        say = property(lambda self: self.said.append)
        error = property(lambda self: self.errors.append)

    (tmp_path / "empty.mcap").touch()
    listener = Listener()
    run([*logs, tmp_path / "empty.mcap"], progress=listener)
    assert len(listener.said) == 3
    assert len(listener.errors) == 1
    assert "30 of 30 messages became 30 samples of 1 point in 1 segment." in listener.said[0]


class TestLoad:
    def test_logs_with_different_context_are_joined(self, run, tmp_path, write_log):
        state = {"gap_mm": 8.0, "coil_current_a": 20.0, "coil_voltage_v": 24.0}
        paths = [
            write_log(tmp_path / "a.mcap", REGULAR, values=[{**state, "load_kg": 700.0}] * 30),
            write_log(tmp_path / "b.mcap", REGULAR, values=[{**state, "speed_km_h": 36.0}] * 30),
        ]
        frame = load_samples(run(paths).folders)
        assert len(frame) == 60
        assert frame["load_kg"].isna().sum() == 30
        assert frame["speed_m_s"].isna().sum() == 30
        assert isinstance(frame["gap_origin"].dtype, pd.CategoricalDtype)
        assert list(frame["gap_origin"].cat.categories) == list(ORIGINS)
        assert str(frame["t"].dtype) == "datetime64[ns, UTC]"
        assert frame.columns[-1] == "contact"

    def test_nothing(self):
        assert len(load_samples([])) == 0

    def test_what_is_not_there(self, tmp_path):
        with pytest.raises(ArtefactError, match="cannot be read"):
            load_samples([tmp_path])


def test_ingest_needs_neither_torch_nor_matplotlib():
    code = (
        "import sys, maglev_offline.ingest.store, maglev_offline.ingest.inspect; "
        "sys.exit(bool({'torch', 'matplotlib'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("what", ["changed", "removed"])
def test_a_log_that_changes_while_it_is_read_is_refused(run, logs, workspace, monkeypatch, what):
    """Else its samples would lie under the hash of what it was."""
    real = store.Manifest

    def meanwhile(*args, **named):
        if what == "changed":
            logs[0].write_bytes(logs[1].read_bytes())
        else:
            logs[0].unlink()
        return real(*args, **named)

    monkeypatch.setattr(store, "Manifest", meanwhile)
    (log,) = run(logs[:1]).logs
    assert log.status == "refused"
    assert logs[0].name in log.message
    assert workspace.list("samples") == []
