"""Content across logs: what is the same is found whatever carries it, what is different shares nothing."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.content import (
    DENSE_ROWS,
    SHINGLE,
    ContentHasher,
    ContentSketch,
    fingerprint_rows,
    load_content,
    row_hashes,
    save_content,
)
from maglev_offline.ingest.content_findings import content_findings
from maglev_offline.ingest.content_overlaps import overlaps
from maglev_offline.logs.writer import Encoding, Messages, MessageType, write_log

COMMITTED = Path(__file__).parents[2] / "data_raw"
NAMES = ("gap", "current", "voltage")
FIELDS = {"gap": "gap_mm", "current": "coil_current_a", "voltage": "coil_voltage_v"}

Values = dict[str, np.ndarray]


def values(rows: int, seed: int = 0) -> Values:
    """Readings of a levitated magnet, rounded as a sensor rounds them."""
    rng = np.random.default_rng(seed)
    return {name: np.round(9 + rng.normal(size=rows), 3) for name in NAMES}


def cut(logged: Values, rows: slice | np.ndarray) -> Values:
    return {name: column[rows] for name, column in logged.items()}


def joined(*parts: Values) -> Values:
    return {name: np.concatenate([part[name] for part in parts]) for name in NAMES}


def assert_same(one: ContentSketch, other: ContentSketch) -> None:
    assert (one.rows, one.whole) == (other.rows, other.whole)
    np.testing.assert_array_equal(one.anchors, other.anchors)
    np.testing.assert_array_equal(one.position, other.position)


def written(path: Path, logged: Values, encoding: Encoding, topic: str, start_ns: int) -> Path:
    n = len(logged["gap"])
    t = start_ns + np.arange(n) * 10_000_000
    messages = Messages(np.zeros(n, int), t + 1, t, np.arange(n), np.stack([logged[name] for name in NAMES], axis=-1))
    kind = MessageType("maglev/msg/State", {FIELDS[name]: "" for name in NAMES})
    write_log(path, [topic], kind, messages, encoding=encoding, metadata={})
    return path


class JsonDecoders:
    def decoder_for(self, message_encoding: str, schema: object) -> Callable[[bytes], dict[str, float]] | None:
        return json.loads if message_encoding == "json" else None


def read(path: Path) -> dict[str, ContentSketch]:
    """Sketch each topic of a log, decoded by the libraries, in order of publish time."""
    rows: dict[str, list[list[float]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[Protobuf(), Ros2(), JsonDecoders()])
        for _, channel, message, value in reader.iter_decoded_messages():
            row = [value[f] if isinstance(value, dict) else getattr(value, f) for f in FIELDS.values()]
            rows.setdefault(channel.topic, []).append([message.publish_time, *row])
    sketches = {}
    for topic, its_rows in rows.items():
        table = np.array(sorted(its_rows))
        sketches[topic] = fingerprint_rows({name: table[:, 1 + k].copy() for k, name in enumerate(NAMES)})
    return sketches


def test_a_log_under_another_encoding_topic_and_clock_is_identical(tmp_path: Path) -> None:
    logged = values(5000)
    one = read(written(tmp_path / "a.mcap", logged, "json", "/p1", 10**18))["/p1"]
    for encoding in ("cdr", "protobuf"):
        other = read(written(tmp_path / f"{encoding}.mcap", logged, encoding, "/x/y", 5 * 10**17))["/x/y"]
        (overlap,) = overlaps({("a", "P1"): one, ("b", "Y"): other})
        assert (overlap.kind, overlap.a, overlap.b) == ("identical", ("b", "Y"), ("a", "P1"))
        assert overlap.stretches[0][:4] == (0, 4999, 0, 4999)


def test_the_logs_of_the_repository_share_nothing() -> None:
    sketches = {
        (path.name, topic): sketch for path in sorted(COMMITTED.glob("*.mcap")) for topic, sketch in read(path).items()
    }
    assert len(sketches) == 12
    assert all(len(sketch.anchors) > 200 for sketch in sketches.values())
    assert overlaps(sketches) == []


@pytest.mark.parametrize("rows", [3000, 30_000])  # a dense sketch, and a sparse one
def test_a_cut_from_the_middle_is_contained_at_its_place(rows: int) -> None:
    whole = values(rows)
    sketches = {("whole", "P"): fingerprint_rows(whole), ("cut", "P"): fingerprint_rows(cut(whole, slice(700, 2200)))}
    (overlap,) = overlaps(sketches)
    assert (overlap.kind, overlap.a, overlap.b) == ("contained", ("cut", "P"), ("whole", "P"))
    assert overlap.share_of_a == 1.0
    assert overlap.share_of_b == pytest.approx(1500 / rows, rel=0.25)
    assert [stretch[:4] for stretch in overlap.stretches] == [(0, 1499, 700, 2199)]


@settings(deadline=None, max_examples=40)
@given(data=st.data(), rows=st.sampled_from([600, 6000]))
def test_any_cut_is_found_at_its_place(data: st.DataObject, rows: int) -> None:
    whole = values(rows, seed=1)
    first = data.draw(st.integers(0, rows - 400))
    last = data.draw(st.integers(first + 400, rows))
    both = {("w", ""): fingerprint_rows(whole), ("c", ""): fingerprint_rows(cut(whole, slice(first, last)))}
    (overlap,) = overlaps(both)
    if (first, last) == (0, rows):
        assert overlap.kind == "identical"
    else:
        assert overlap.kind == "contained"
        assert overlap.stretches[0][:4] == (0, last - first - 1, first, last - 1)


def test_a_common_part_is_found_in_both() -> None:
    shared, a, b = values(8000, 1), values(5000, 2), values(9000, 3)
    one, other = joined(a, shared), joined(shared, b)
    (overlap,) = overlaps({("one", ""): fingerprint_rows(one), ("other", ""): fingerprint_rows(other)})
    assert (overlap.kind, overlap.a, overlap.b) == ("partial", ("one", ""), ("other", ""))
    (stretch,) = overlap.stretches
    np.testing.assert_allclose(stretch[:4], (5000, 12_999, 0, 7999), atol=150)
    assert stretch.first_a - stretch.first_b == 5000
    assert overlap.share_of_a == pytest.approx(8 / 13, abs=0.05)
    assert overlap.share_of_b == pytest.approx(8 / 17, abs=0.05)


def test_a_copy_with_lost_messages_is_found_in_stretches() -> None:
    whole = values(20_000)
    kept = np.random.default_rng(1).random(20_000) > 0.001
    (overlap,) = overlaps({("w", ""): fingerprint_rows(whole), ("c", ""): fingerprint_rows(cut(whole, kept))})
    assert overlap.kind == "contained"
    assert overlap.share_of_a > 0.95
    for stretch in overlap.stretches:
        lost = (~kept[: stretch.first_b]).sum()
        assert stretch.first_b - stretch.first_a == pytest.approx(lost, abs=2)


def test_a_block_that_comes_again_in_the_same_log_is_found() -> None:
    logged = joined(values(9000, 1), cut(values(9000, 1), slice(2000, 3000)), values(500, 2))
    (overlap,) = overlaps({("log", "P1"): fingerprint_rows(logged, np.arange(10_500) * 10)})
    assert overlap.a == overlap.b == ("log", "P1")
    (stretch,) = overlap.stretches
    assert stretch.first_a - stretch.first_b == 7000
    assert stretch.first_b == pytest.approx(2000, abs=100)
    (finding,) = content_findings([overlap])
    assert (finding.code, finding.severity) == ("overlapping_content", "warning")
    assert [place.start_ns for place in finding.places] == [10 * stretch.first_b, 10 * stretch.first_a]


def test_rest_says_nothing() -> None:
    """Two logs with the same gap at the stop and no current for most of the time are not the same log."""
    rest = {name: np.full(3000, x) for name, x in zip(NAMES, (16.0, 0.0, 0.0), strict=True)}
    sketches = {("a", ""): fingerprint_rows(joined(rest, values(300, 1))), ("b", ""): fingerprint_rows(rest)}
    sketches["c", ""] = fingerprint_rows(joined(values(300, 2), rest))
    sketches["d", ""] = fingerprint_rows(rest)
    assert len(sketches["b", ""].anchors) == 0
    assert overlaps(sketches) == []


def test_a_sensor_that_toggles_says_nothing() -> None:
    toggling = np.where(np.arange(3000) % 2 == 0, 16.0, 16.002)
    logged = {"gap": toggling, "current": np.zeros(3000), "voltage": np.zeros(3000)}
    both = {("a", ""): fingerprint_rows(logged), ("b", ""): fingerprint_rows(cut(logged, slice(1, 2500)))}
    assert overlaps(both) == []


def test_repeats_of_a_row_do_not_hide_a_copy() -> None:
    """A sensor slower than its messages is held: its rows repeat, and count once in a shingle."""
    held = {name: np.repeat(column, 10) for name, column in values(1500).items()}
    both = {("a", ""): fingerprint_rows(held), ("b", ""): fingerprint_rows(cut(held, slice(3000, 12_000)))}
    (overlap,) = overlaps(both)
    assert overlap.kind == "contained"
    assert overlap.stretches[0].first_b - overlap.stretches[0].first_a == 3000


@settings(deadline=None, max_examples=40)
@given(
    rows=st.sampled_from([0, 1, SHINGLE, 300, DENSE_ROWS, DENSE_ROWS + 1, 6000]),
    cuts=st.lists(st.integers(0, 6000), max_size=6),
    repeat=st.booleans(),
)
def test_any_cut_into_windows_gives_the_same_sketch(rows: int, cuts: list[int], repeat: bool) -> None:
    logged = values(rows)
    if repeat:
        logged = {name: np.repeat(column[: (rows + 2) // 3], 3)[:rows] for name, column in logged.items()}
    t_ns = np.arange(rows) * 7
    hasher = ContentHasher()
    edges = [0, *sorted(min(c, rows) for c in cuts), rows]
    for first, last in itertools.pairwise(edges):
        hasher.add(cut(logged, slice(first, last)), t_ns[first:last])
    sketch = hasher.sketch()
    assert_same(sketch, fingerprint_rows(logged, t_ns))
    np.testing.assert_array_equal(sketch.t_ns, 7 * sketch.position)


@settings(deadline=None)
@given(st.lists(st.floats(width=64), min_size=1, max_size=20), st.integers(0, 19), st.floats(allow_nan=False))
def test_a_row_hash_is_that_of_the_values(gap: list[float], at: int, other: float) -> None:
    column = np.array(gap)
    changed = column.copy()
    changed[at % len(gap)] = other
    one, two = (row_hashes({"gap": x, "current": np.zeros(len(gap))}) for x in (column, changed))
    same = (column == changed) | (np.isnan(column) & np.isnan(changed))
    np.testing.assert_array_equal(one == two, same)


def test_minus_zero_is_zero_and_every_nan_is_the_same() -> None:
    odd_nan = np.array([0x7FF8000000000123], dtype=np.uint64).view(np.float64)
    plain = row_hashes({"gap": np.array([0.0, np.nan])})
    np.testing.assert_array_equal(plain, row_hashes({"gap": np.array([-0.0, odd_nan[0]])}))


def test_round_numbers_do_not_collide() -> None:
    """Counts of a converter have few digits, and every one of them counts."""
    a, b = (x.ravel() for x in np.meshgrid(np.arange(512.0), np.arange(512.0)))
    assert len(np.unique(row_hashes({"a": a, "b": b}))) == 512 * 512
    assert len(np.unique(row_hashes({"a": a, "b": b}) >> np.uint64(40))) > 200_000


def test_swapped_signals_are_another_content() -> None:
    logged = values(500)
    swapped = {"gap": logged["current"], "current": logged["gap"], "voltage": logged["voltage"]}
    assert overlaps({("a", ""): fingerprint_rows(logged), ("b", ""): fingerprint_rows(swapped)}) == []


def test_another_order_of_rows_is_not_identical() -> None:
    logged = values(500)
    turned = cut(logged, np.arange(500)[::-1])
    assert overlaps({("a", ""): fingerprint_rows(logged), ("b", ""): fingerprint_rows(turned)}) == []


def test_many_cuts_of_one_log_are_each_found_in_it() -> None:
    """An anchor that is in more logs than can be paired with each other still leads to the longest."""
    whole = values(6000)
    sketches = {("whole", ""): fingerprint_rows(whole)}
    for k in range(100):
        sketches[f"cut{k:02d}", ""] = fingerprint_rows(cut(whole, slice(20 * k, 20 * k + 3500)))
    contained = {o.a for o in overlaps(sketches) if o.kind == "contained" and o.b == ("whole", "")}
    assert contained == set(sketches) - {("whole", "")}


def test_the_order_of_the_logs_changes_nothing() -> None:
    whole = values(6000)
    sketches = {("w", ""): fingerprint_rows(whole), ("x", ""): fingerprint_rows(whole)}
    sketches |= {(f"c{k}", ""): fingerprint_rows(cut(whole, slice(500 * k, 500 * k + 3000))) for k in range(4)}
    found = overlaps(sketches)
    assert len(found) > 5
    assert found == overlaps(dict(reversed(sketches.items())))


def test_findings_speak_to_both_logs() -> None:
    whole = values(6000)
    t_ns = 10**18 + np.arange(6000) * 10**7
    sketches = {
        ("a.mcap", "P1"): fingerprint_rows(whole, t_ns),
        ("b.mcap", "P7"): fingerprint_rows(whole, t_ns + 5),
        ("c.mcap", "P1"): fingerprint_rows(cut(whole, slice(1000, 3000)), t_ns[:2000]),
    }
    found = content_findings(overlaps(sketches))
    told = [(f.log, f.code, f.severity, f.numbers["other_log"]) for f in found]
    assert told == [
        ("a.mcap", "contained_content", "error", "c.mcap"),
        ("a.mcap", "duplicate_content", "error", "b.mcap"),
        ("b.mcap", "duplicate_content", "error", "a.mcap"),
        ("c.mcap", "contained_content", "error", "a.mcap"),
    ]
    assert all(f.about == "recording" and f.what and f.todo for f in found)
    place = found[0].places[0]
    assert abs(place.start_ns - t_ns[1000]) < 200 * 10**7
    assert found[0].numbers["first_row"] == 1000
    assert found[3].numbers["other_last_row"] == 2999


def test_sketches_are_read_as_they_were_written(tmp_path: Path) -> None:
    sketches = {
        "P1": fingerprint_rows(values(6000), np.arange(6000)),
        "P2": fingerprint_rows(values(100, 1)),
        "empty": fingerprint_rows(values(0)),
    }
    save_content(sketches, tmp_path / "content.parquet")
    again = load_content(tmp_path / "content.parquet")
    assert list(again) == list(sketches)
    for point, sketch in sketches.items():
        assert_same(again[point], sketch)
        assert (again[point].t_ns is None) == (sketch.t_ns is None)
    save_content(sketches, tmp_path / "again.parquet")
    assert (tmp_path / "again.parquet").read_bytes() == (tmp_path / "content.parquet").read_bytes()


def test_a_file_that_holds_no_sketches_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"PAR1 no parquet PAR1"):
        (tmp_path / "content.parquet").write_bytes(content)
        with pytest.raises(ArtefactError, match="cannot be read"):
            load_content(tmp_path / "content.parquet")


def test_signals_must_have_one_length() -> None:
    with pytest.raises(ValueError, match="one length"):
        fingerprint_rows({"gap": np.zeros(3), "current": np.zeros(4)})
    with pytest.raises(ValueError, match="no signal"):
        fingerprint_rows({})
