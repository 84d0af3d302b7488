"""Windows of a long log: each message is in exactly one, and what comes of them is what comes of the whole."""

import hashlib
import struct
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.windows import windows
from maglev_offline.logs.columns import ChannelColumns
from maglev_offline.logs.reader import TopicWanted
from maglev_offline.logs.slabs import MemorySlab, Piece

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
SETTINGS = IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=50)
WANTED = TopicWanted(("gap",))


def columns(topic, t_ms, file_index):
    """Messages of a topic; the value of each is its place within the topic."""
    t_ns = T0 + np.round(np.asarray(t_ms, dtype=float) * MS).astype(np.int64)
    n = len(t_ns)
    values = {"gap": np.arange(n, dtype=float)}
    return ChannelColumns(topic, t_ns, t_ns, np.arange(n), np.asarray(file_index), values, np.ones(n, dtype=bool))


def slabs_of(messages, cuts):
    """Slabs of messages (topic, ms) in file order, cut at places of the file."""
    topics = {}
    for k, (topic, t) in enumerate(messages):
        topics.setdefault(topic, []).append((k, t))
    whole = {topic: columns(topic, [t for _, t in rows], [k for k, _ in rows]) for topic, rows in topics.items()}
    made = []
    bounds = sorted({0, len(messages), *cuts})
    for first, last in pairwise(bounds):
        parts = {}
        for topic, its in whole.items():
            part = its.take((its.file_index >= first) & (its.file_index < last))
            if len(part):
                integers = np.stack([part.log_time_ns, part.publish_time_ns, part.sequence, part.file_index - first])
                piece = Piece(integers, np.stack(list(part.values.values())), part.decoded)
                parts[topic] = (piece, 0, len(piece))
        made.append((MemorySlab(parts), last - first))
    return whole, made


def cut(messages, cuts, most, using=SETTINGS):
    """For each window and topic its columns and the places within the topic; and the whole topics."""
    whole, slabs = slabs_of(messages, cuts)
    wanted = dict.fromkeys(whole, WANTED)
    return whole, [
        {topic: window.columns(topic, WANTED, "log_time", using) for topic in whole}
        for window in windows(slabs, wanted, "log_time", using, most=most)
    ]


def each_is_in_exactly_one(whole, made):
    for topic, its in whole.items():
        index = np.concatenate([part[topic][1] for part in made])
        assert sorted(index.tolist()) == list(range(len(its)))
        for part in made:
            found, place = part[topic]
            assert len(found) == len(place)
            assert (np.diff(place) > 0).all()
            for name in ("log_time_ns", "publish_time_ns", "sequence", "file_index"):
                np.testing.assert_array_equal(getattr(found, name), getattr(its, name)[place])
            np.testing.assert_array_equal(found.values["gap"], place)


steps = st.one_of(st.integers(0, 30), st.integers(-60, 5), st.sampled_from([500, -5000, 60_000]))


@given(
    st.lists(st.tuples(st.sampled_from("abc"), steps), min_size=1, max_size=150),
    st.lists(st.integers(0, 150), max_size=20),
    st.integers(1, 40),
    st.sampled_from([0, 10, 50, 500]),
)
@settings(max_examples=150, deadline=None)
def test_every_message_is_in_exactly_one_window(moves, cuts, most, reorder_ms):
    t = np.cumsum([step for _, step in moves])
    messages = [(topic, float(at)) for (topic, _), at in zip(moves, t, strict=True)]
    using = IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=reorder_ms)
    each_is_in_exactly_one(*cut(messages, [k for k in cuts if k < len(messages)], most, using))


class TestBorders:
    def test_a_log_that_is_short_is_one_window(self):
        whole, made = cut([("a", 10.0 * k) for k in range(100)], range(0, 100, 10), most=100)
        assert len(made) == 1
        each_is_in_exactly_one(whole, made)

    def test_windows_hold_about_so_many_messages(self):
        whole, made = cut([("a", 10.0 * k) for k in range(1000)], range(0, 1000, 10), most=100)
        assert len(made) == 10
        assert max(len(part["a"][0]) for part in made) <= 110
        each_is_in_exactly_one(whole, made)

    def test_one_slab_that_is_larger_is_a_window_all_the_same(self):
        whole, made = cut([("a", 10.0 * k) for k in range(300)], [100], most=10)
        assert len(made) == 2
        each_is_in_exactly_one(whole, made)

    def test_a_message_that_comes_late_across_a_border_joins_those_of_its_time(self):
        t = [10.0 * k for k in range(200)]
        t.insert(103, t.pop(99))  # 40 ms late, and in the second slab
        _, made = cut([("a", at) for at in t], [100], most=100)
        assert len(made) == 2
        times = [part["a"][0].log_time_ns for part in made]
        assert times[0].max() < times[1].min()
        assert (T0 + 990 * MS) in times[1].tolist()

    def test_one_that_is_as_late_as_can_be_joins_those_of_its_very_time(self):
        t = [*(10.0 * k for k in range(100)), 940.0, *(10.0 * k for k in range(100, 200))]
        _, made = cut([("a", at) for at in t], [100], most=100)
        times = [part["a"][0].log_time_ns for part in made]
        assert [(T0 + 940 * MS) in its.tolist() for its in times] == [False, True]

    def test_a_silence_near_the_end_is_preferred(self):
        t = [*(10.0 * k for k in range(80)), *(1500 + 10.0 * k for k in range(120))]
        _, made = cut([("a", at) for at in t], [100], most=100)
        assert [len(part["a"][0]) for part in made] == [80, 120]

    def test_but_not_one_that_late_messages_may_still_fill(self):
        t = [*(10.0 * k for k in range(98)), 1010.0, 1020.0, *(1030 + 10.0 * k for k in range(100))]
        _, made = cut([("a", at) for at in t], [100], most=100)
        assert made[0]["a"][0].log_time_ns.max() < T0 + 970 * MS

    @pytest.mark.parametrize("before", [1, 3, 8, 50])
    @pytest.mark.parametrize("back_ms", [70.0, 900.0, 10_000.0])
    def test_a_reset_of_the_clock_near_a_border_parts_no_times(self, before, back_ms):
        end = 20_000 + 10.0 * (100 - before)
        t = [
            *(20_000 + 10.0 * k for k in range(100 - before)),
            *(end - back_ms + 10.0 * k for k in range(100 + before)),
        ]
        whole, made = cut([("a", at) for at in t], [100], most=100)
        each_is_in_exactly_one(whole, made)
        # What comes before the reset is not left to the window after it.
        assert made[0]["a"][1].tolist()[: 100 - before] == list(range(100 - before))

    def test_a_topic_that_fell_silent_holds_nothing_up(self):
        messages = [("b", 0.0), ("b", 10.0)] + [("a", 10.0 * k) for k in range(3000)]
        _, made = cut(messages, range(0, 3000, 50), most=1000)
        assert max(len(part["a"][0]) for part in made) <= 1100

    def test_of_a_topic_that_lags_behind_the_times_are_kept_together(self):
        """Topic b is recorded 200 ms after a."""
        messages = []
        for k in range(400):
            messages += [("a", 10.0 * k), ("b", 10.0 * k - 200)]
        _, made = cut(messages, range(0, 800, 40), most=200)
        assert len(made) > 1
        for one, other in pairwise(made):
            last = max(one[topic][0].log_time_ns.max() for topic in "ab")
            assert last < min(other[topic][0].log_time_ns.min() for topic in "ab")

    def test_stamps_that_are_missing_stop_nothing(self):
        whole, slabs = slabs_of([("a", 10.0 * k) for k in range(200)], [100])
        using = SETTINGS
        made = []
        for window in windows(slabs, {"a": WANTED, "silent": WANTED}, "publish_time", using, most=100):
            assert len(window.columns("silent", WANTED, "publish_time", using)[0]) == 0
            made.append({"a": window.columns("a", WANTED, "publish_time", using)})
        each_is_in_exactly_one(whole, made)


TOPICS = ("/suspension/F1/state", "/suspension/F2/state")
SCHEMA = b"float64 gap_mm\nfloat64 coil_current_a\nfloat64 coil_voltage_v\n"


def write(path, messages, *, blob=0, chunk_size=2000, seed=0):
    """Messages (topic number, ms) in file order; `blob` bytes make each longer."""
    rng = np.random.default_rng(seed)
    values = np.array([8.0, 20.0, 24.0]) + rng.normal(0, [0.1, 0.5, 2.0], (len(messages), 3))
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=CompressionType.NONE, enable_crcs=blob == 0)
        writer.start()
        text = SCHEMA + (f"uint8[{blob}] raw\n".encode() if blob else b"")
        schema = writer.register_schema("test/msg/State", "ros2msg", text)
        channels = [writer.register_channel(topic, "cdr", schema) for topic in TOPICS]
        filler = bytes(blob)
        for k, ((topic, t_ms), state) in enumerate(zip(messages, values.tolist(), strict=True)):
            t = T0 + round(t_ms * MS)
            writer.add_message(channels[topic], t, b"\0\1\0\0" + struct.pack("<3d", *state) + filler, t, k)
        writer.finish()
    return path


def eventful(n, seed):
    """Messages of two topics on a 10 ms grid: some late, repeated or missing, with holes and resets of the clock."""
    rng = np.random.default_rng(seed)
    now, messages, late = 100_000.0, [], []
    for _ in range(n):
        now += 10
        if rng.random() < 0.005:
            now += rng.choice([70.0, 1000.0])
        if rng.random() < 0.002:
            now -= rng.choice([3000.0, 20_000.0])
            late.clear()
        for topic in (0, 1):
            draw = rng.random()
            if draw < 0.02:
                late.append((len(messages) + int(rng.integers(1, 6)), (topic, now)))
            elif draw > 0.01 + 0.02:
                messages.append((topic, now))
            if draw > 0.99:
                messages.append((topic, now))
        for place, message in [pair for pair in late if pair[0] <= len(messages)]:
            late.remove((place, message))
            messages.append(message)
    return messages


@pytest.fixture
def small(monkeypatch):
    """Small slabs, and windows of at most `most` messages of a topic."""

    def use(most):
        monkeypatch.setattr("maglev_offline.logs.reader.ROWS", 64)
        monkeypatch.setattr("maglev_offline.ingest.examine.windows", partial(windows, most=most))

    return use


class TestIngest:
    @pytest.mark.parametrize("seed", range(4))
    def test_many_windows_give_what_one_gives_but_for_a_cut_at_each_border(self, tmp_path, ingest_path, small, seed):
        path = write(tmp_path / "a.mcap", eventful(3000, seed))
        one = ingest_path(path, settings=SETTINGS)
        small(400)
        many = ingest_path(path, settings=SETTINGS)
        borders = one.counts["messages"] // 800 + 1
        for made in (one, many):
            ledger = made.quarantine.to_pandas()
            messages = ledger[ledger["level"] == "message"]
            assert made.counts["messages"] == made.counts["messages_used"] + messages["count"].sum()
            assert not messages.duplicated(["topic", "message_index"]).any()
            assert ledger.groupby("code")["count"].sum().to_dict() == made.left_out
            samples = made.samples.to_pandas()
            for _, segment in samples.groupby(["point", "segment"]):
                assert segment["step"].tolist() == list(range(len(segment)))
                assert (np.diff(segment["t"].astype("int64")) == 10 * MS).all()
        assert one.counts["messages"] == many.counts["messages"]
        key = ["point", "t", "gap_m", "current_a", "voltage_v"]
        alone, joined = (made.samples.to_pandas()[key].value_counts() for made in (one, many))
        both = alone.to_frame("a").join(joined.to_frame("b"), how="outer").fillna(0)
        # A cut costs the rows between two messages, and may part a message from the rest of its stretch.
        assert (both["a"] - both["b"]).abs().sum() <= 2 * 2 * borders
        assert many.counts["segments"] - one.counts["segments"] <= 2 * borders
        assert abs(one.counts["messages_used"] - many.counts["messages_used"]) <= 2 * 2 * borders
        assert [f.code for f in one.findings if f.code == "hole"] == [f.code for f in many.findings if f.code == "hole"]

    def test_the_number_of_the_segments_and_of_the_messages_goes_on(self, tmp_path, ingest_path, small):
        messages = [(0, 10.0 * k) for k in range(1000) if k % 250]
        messages[900] = messages[899]
        small(200)
        made = ingest_path(write(tmp_path / "a.mcap", messages), settings=SETTINGS)
        samples = made.samples.to_pandas()
        assert sorted(set(samples["segment"])) == list(range(made.counts["segments"]))
        assert (np.diff(samples["segment"]) >= 0).all()
        assert made.quarantine["message_index"].to_pylist() == [900]
        assert made.quarantine["code"].to_pylist() == ["time_conflict"]

    def test_a_silence_costs_no_segment(self, tmp_path, ingest_path, small):
        messages = [(0, 10.0 * k + 500 * (k // 100)) for k in range(1000)]
        path = write(tmp_path / "a.mcap", messages)
        one = ingest_path(path, settings=SETTINGS)
        small(250)
        many = ingest_path(path, settings=SETTINGS)
        assert many.samples.equals(one.samples)
        assert many.counts == one.counts
        assert many.left_out == one.left_out


def all_bytes(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


def test_the_number_of_processes_changes_no_byte(tmp_path, ingest_path):
    """A log of more than two runs of 16 MiB."""
    messages = eventful(3600, seed=9)
    path = write(tmp_path / "a.mcap", messages, blob=6000, chunk_size=2**20)
    assert path.stat().st_size > 2.2 * 16 * 2**20
    alone = ingest_path(path, settings=SETTINGS, jobs=1)
    together = ingest_path(path, settings=SETTINGS, jobs=2)
    assert all_bytes(alone.folder).keys() == {
        "samples.parquet",
        "quarantine.parquet",
        "findings.json",
        "content.parquet",
    }
    assert all_bytes(together.folder) == all_bytes(alone.folder)
    assert (together.counts, together.left_out, together.facts) == (alone.counts, alone.left_out, alone.facts)
