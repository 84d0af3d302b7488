"""Logs that share content are told of by an artefact of its own, whatever their encoding, order and names."""

import numpy as np
import pytest

from maglev_offline.ingest.findings import FINDINGS, load_findings
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.shared_content import KIND, find_shared_content
from maglev_offline.ingest.store import ingest_logs
from maglev_offline.workspace import Manifest, Workspace


def drive(seed, messages=400):
    """Values of a drive; another seed is another drive."""
    rng = np.random.default_rng(seed)
    gap, current, voltage = (rng.normal(size=messages) for _ in range(3))
    return [
        {"gap_mm": 8 + 0.1 * g, "coil_current_a": 17 + i, "coil_voltage_v": 20 + u}
        for g, i, u in zip(gap.tolist(), current.tolist(), voltage.tolist(), strict=True)
    ]


@pytest.fixture
def log(tmp_path, write_log):
    """Write a log of one point, a message every 100 ms from `start_ms` on."""

    def write(name, values, start_ms=0, **options):
        t_ms = start_ms + 100 * np.arange(len(values))
        return write_log(tmp_path / f"{name}.mcap", t_ms, values=values, **options)

    return write


@pytest.fixture
def find(workspace):
    """Ingest logs into a workspace and hold them against each other."""

    def run(*logs, into=workspace, backwards=False):
        result = ingest_logs(logs, into, Request())
        assert [one.status for one in result.logs if one.status == "refused"] == []
        folders = into.list("samples")
        return find_shared_content(into, {f: into.manifest(f) for f in (folders[::-1] if backwards else folders)})

    return run


def told(findings):
    """Log and other log (without their hashes) of each finding, by code."""
    return {(one.code, one.log[:-9], str(one.numbers["other_log"])[:-9]) for one in findings}


@pytest.mark.parametrize("encoding", ["cdr", "protobuf"])
def test_a_copy_in_another_encoding_at_another_time_is_told(log, find, encoding):
    values = drive(1)
    found = find(
        log("json", values), log("copy", values, start_ms=86_400_000, encoding=encoding), log("other", drive(2))
    )
    assert told(found) == {("duplicate_content", "json", "copy"), ("duplicate_content", "copy", "json")}
    assert {one.severity for one in found} == {"error"}
    assert {one.point for one in found} == {"F1"}


def test_a_part_that_was_cut_out_is_told(log, find):
    values = drive(1)
    found = find(log("whole", values), log("part", values[100:250], encoding="cdr"))
    assert told(found) == {("contained_content", "whole", "part"), ("contained_content", "part", "whole")}
    (part,) = [one for one in found if one.log.startswith("part")]
    assert (part.numbers["other_first_row"], part.numbers["other_last_row"]) == (100, 249)


def test_logs_that_overlap_are_told_with_a_warning(log, find):
    values = drive(1)
    found = find(log("a", values[:300]), log("b", values[200:]))
    assert told(found) == {("overlapping_content", "a", "b"), ("overlapping_content", "b", "a")}
    assert {one.severity for one in found} == {"warning"}


def test_different_drives_share_nothing(log, find, workspace):
    assert find(log("a", drive(1)), log("b", drive(2))) == []
    assert load_findings(workspace.path(KIND) / FINDINGS) == []


def test_one_that_differs_in_a_single_value_is_no_copy_and_its_rest_is_told(log, find):
    values = drive(1)
    changed = [dict(one) for one in values]
    changed[200]["gap_mm"] += 0.001
    found = find(log("a", values), log("b", changed))
    assert {one.code for one in found} == {"contained_content"}
    assert all(0.95 < one.numbers["share"] < 1 for one in found)


class TestArtefact:
    @pytest.fixture
    def logs(self, log):
        values = drive(1)
        return log("a", values), log("b", values, encoding="cdr"), log("c", values[50:200], encoding="protobuf")

    def test_it_holds_what_was_found_and_from_what(self, logs, find, workspace):
        found = find(*logs)
        folder = workspace.path(KIND)
        assert load_findings(folder / FINDINGS) == found
        manifest = Manifest.read(folder)
        assert manifest.counts == {"findings": len(found)}
        assert set(manifest.inputs) == {folder.name for folder in workspace.list("samples")}

    def test_a_second_time_does_nothing(self, logs, find, workspace, monkeypatch):
        first = find(*logs)
        stamps = {path: path.stat().st_mtime_ns for path in workspace.path(KIND).iterdir()}
        monkeypatch.setattr("maglev_offline.ingest.shared_content.overlaps", None)  # what would do the work
        assert find(*logs) == first
        assert {path: path.stat().st_mtime_ns for path in workspace.path(KIND).iterdir()} == stamps

    def test_any_order_gives_the_same_bytes(self, logs, find, tmp_path):
        one, two = Workspace(tmp_path / "one"), Workspace(tmp_path / "two")
        assert find(*logs, into=one) == find(*logs[::-1], into=two, backwards=True)
        files = [{p.name: p.read_bytes() for p in space.path(KIND).iterdir()} for space in (one, two)]
        assert files[0] == files[1]
        assert set(files[0]) == {FINDINGS, "manifest.json"}

    def test_another_log_makes_it_anew(self, logs, find):
        assert find(logs[0]) == []
        assert {one.code for one in find(*logs[:2])} == {"duplicate_content"}

    def test_one_that_was_tampered_with_is_made_anew(self, logs, find, workspace):
        first = find(*logs)
        path = workspace.path(KIND) / FINDINGS
        whole = path.read_bytes()
        path.write_text("[]\n")
        assert find(*logs) == first
        assert path.read_bytes() == whole

    def test_a_log_does_not_depend_on_which_others_there_are(self, logs, find, tmp_path):
        alone, together = Workspace(tmp_path / "alone"), Workspace(tmp_path / "together")
        find(logs[0], into=alone)
        find(*logs, into=together)
        (folder,) = alone.list("samples")
        twin = together.path("samples", folder.name)
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == {p.name: p.read_bytes() for p in twin.iterdir()}
