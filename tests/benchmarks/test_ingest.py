"""The benchmark of ingestion: its readers read the same numbers, and what is missed is named."""

import json
import os
import subprocess
import sys
from pathlib import Path

import ingest
import ingest_logs
import ingest_peers
import pytest
from mcap.reader import make_reader

pytestmark = pytest.mark.nightly

FOLDER = Path(__file__).parents[2] / "benchmarks"
MESSAGES = 900


@pytest.fixture(scope="module", params=ingest_logs.ENCODINGS)
def log(request, tmp_path_factory):
    """A small log of each encoding."""
    path = tmp_path_factory.mktemp("logs") / f"{request.param}.mcap"
    ingest_logs.write_log(path, request.param, MESSAGES)
    return path


def row(reader, encoding="cdr", **more):
    return {"encoding": encoding, "reader": reader, "messages": 10, "failure": "", "digest": ""} | more


def test_ours_reads_the_numbers_that_the_mcap_reader_reads(log):
    ours, others = ingest_peers.ours(log), [ingest_peers.mcap(log), ingest_peers.mcap_default_order(log)]
    assert ours.messages == MESSAGES
    for other in others:
        assert other.messages == MESSAGES
        assert ingest_peers.digest(other.table) == ingest_peers.digest(ours.table)


def test_one_number_changed_changes_the_digest(log):
    table = ingest_peers.ours(log).table
    for name in ("gap_mm", "stamp_ns", "sequence"):
        column = table.column(name).to_numpy().copy()
        column[7] += 1
        changed = table.set_column(table.schema.get_field_index(name), name, [column])
        assert ingest_peers.digest(changed) != ingest_peers.digest(table)


def test_all_messages_of_the_logs_are_used_by_an_ingest(log):
    assert ingest_peers.ours_ingest(log).messages == MESSAGES


def test_the_floor_checks_the_sums(log, tmp_path):
    assert ingest_peers.floor(log).messages == MESSAGES
    with log.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[0]
    damaged = bytearray(log.read_bytes())
    damaged[chunk.chunk_start_offset + 9 + 24] ^= 1  # in the checksum itself
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    with pytest.raises(ValueError, match="checksum"):
        ingest_peers.floor(tmp_path / "damaged.mcap")


def test_the_logs_hold_sixty_points_in_turn_every_100_ms():
    blocks = list(ingest_logs.blocks(130_000))
    assert sum(len(block.sequence) for block in blocks) == 130_000
    first = blocks[0]
    assert first.sequence[:61].tolist() == [0] * 60 + [1]
    steps = first.stamp_ns[60:] - first.stamp_ns[:-60]
    assert abs(steps - 100_000_000).max() < 50_000
    assert (first.log_time_ns > first.stamp_ns).all()
    assert first.values.shape == (60_000, len(ingest_logs.FIELDS))


def test_a_peer_that_is_not_installed_is_named_as_missing(tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho No module named rosbags >&2\nexit 3\n")
    python.chmod(0o755)
    runner = ingest.Runner(tmp_path, str(python))
    assert runner.run(ingest.ROSBAGS, "cdr", 600) == "not installed (No module named rosbags)"


def test_ratios_are_to_what_does_the_same_work():
    rows = ingest.with_ratios(
        [
            row(ingest.OURS, ns_per_message=100.0),
            row(ingest.OURS_INGEST, ns_per_message=1000.0),
            row(ingest.MCAP, ns_per_message=3000.0),
            row(ingest.MCAP_PARQUET, ns_per_message=30_000.0),
            row(ingest.MCAP, "json", ns_per_message=5.0),
            row(ingest.RERUN, failure="not installed"),
        ]
    )
    assert [one["ours_is_faster"] for one in rows] == [None, None, 30.0, 30.0, None, None]
    assert ingest.missed_ratios(rows) == ["maglev-offline on cdr is 30 times as fast as mcap, file order, wanted: 40"]


def test_a_reader_of_other_numbers_is_named_and_so_is_one_of_ours_that_fails():
    rows = [row(name, digest="a") for name in (ingest.OURS, ingest.MCAP)]
    rows += [row(ingest.RERUN, digest="b"), row(ingest.ROSBAGS, failure="not installed")]
    assert ingest.disagreements(rows) == ["rerun-sdk reads other numbers from the cdr log than the others"]
    assert ingest.disagreements([row(ingest.OURS_INGEST, failure="boom")]) == ["maglev-offline ingest on cdr: boom"]


def growth(cpu_s, peak_mb):
    return [
        {"times": times, "messages": times, "cpu_s": cpu, "peak_bytes": peak * 1e6, "failure": ""}
        for times, cpu, peak in zip((1, 4, 16), cpu_s, peak_mb, strict=True)
    ]


def test_growth_has_to_be_linear_in_time_and_flat_in_memory():
    assert ingest.missed_growth(growth((2, 4, 16), (100, 200, 210))) == []
    assert len(ingest.missed_growth(growth((1, 4, 30), (100, 100, 100)))) == 1
    assert len(ingest.missed_growth(growth((1, 4, 16), (100, 100, 200)))) == 1
    assert len(ingest.missed_growth(growth((1, 4, 16), (500, 600, 600)))) == 1
    assert ingest.missed_growth([{"times": 4, "failure": "boom"}]) == ["ingest of 4x: boom"]


def test_it_prints_a_table_and_writes_everything(tmp_path):
    command = [sys.executable, "-W", "error", str(FOLDER / "ingest.py"), "--messages", "600", "--rounds", "1"]
    command += ["--growth-messages", "0", "--encodings", "json", "--json", str(tmp_path / "out.json")]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"COLUMNS": "200"})
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert [one["reader"] for one in result["rows"]] == list(ingest.READS["json"])
    for one in result["rows"]:
        assert 0 < one["fastest_ns"] <= one["ns_per_message"] <= one["slowest_ns"]
        assert f"| json | {one['reader']} | 600 |" in done.stdout
    for name in ("cpu", "mcap", "pyarrow", "maglev-offline"):
        assert f"{name}: {result['machine'][name]}\n" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("--messages", "5"), "--messages must be 600 or more, not 5"), (("--rounds", "0"), "--rounds must be 1 or more")],
)
def test_sizes_that_will_not_do_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit):
        ingest.options(list(arguments))
    assert words in capsys.readouterr().err
