"""Logs damaged on purpose, from the file to the ledger: what is used, what is not, why not, and where it lay."""

import importlib.util
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from maglev_offline.errors import LogError
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.signals import SignalMap
from maglev_offline.physics.parameters import Plant

_spec = importlib.util.spec_from_file_location("containers", Path(__file__).parents[1] / "logs/containers.py")
containers = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(containers)

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
N = 10_000
TOPICS = ("/suspension/F1/state", "/suspension/F2/state")
SCHEMA = b"float64 gap_mm\nfloat64 coil_current_a\nfloat64 coil_voltage_v\n"
COMPRESSION = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}
GRID = IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=50)
MESSAGE_HEAD = 31


def states(n, seed=0):
    """Gap (mm), current (A) and voltage (V) of n messages, shape [n, 3]; noise, so that chunks have a size."""
    rng = np.random.default_rng(seed)
    return np.array([8.0, 20.0, 24.0]) + rng.normal(0, [0.1, 0.5, 2.0], (n, 3))


def cdr(state, order="<"):
    return struct.pack(order + "3d", *state)


def little(state):
    return b"\0\1\0\0" + cdr(state)


def write(path, n=N, *, compression="zstd", chunk_size=16_384, chunked=True, encode=little, payloads=(), **more):
    """Write n messages of two points in turn, each point every 10 ms; `payloads` replaces those of some messages."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=COMPRESSION[compression], use_chunking=chunked, **more)
        writer.start()
        schema = writer.register_schema("test/msg/State", "ros2msg", SCHEMA)
        channels = [writer.register_channel(topic, "cdr", schema) for topic in TOPICS]
        for k, state in enumerate(states(n)):
            t = T0 + (k // 2) * 10 * MS
            writer.add_message(channels[k % 2], t, dict(payloads).get(k, encode(state)), t, k)
        writer.finish()
    return path


def per_chunk(path):
    """Messages in each chunk, by the sizes of its index records as the library reads them."""
    return [
        (index.message_index_length - 15 * len(index.message_index_offsets)) // 16
        for index in containers.chunk_indexes(path)
    ]


def counts_hold(made, came_in):
    """What came in is used or in the ledger, once; the ledger's rows add up to what is told of it."""
    ledger = made.quarantine.to_pandas()
    messages, rows = (ledger[ledger["level"] == level] for level in ("message", "sample"))
    assert made.counts["messages"] == came_in == made.counts["messages_used"] + messages["count"].sum()
    assert made.counts["messages_quarantined"] == messages["count"].sum()
    assert made.counts["grid_rows"] == len(made.samples) + rows["count"].sum()
    assert ledger.groupby("code")["count"].sum().to_dict() == made.left_out
    assert set(ledger["log_id"]) <= {"a"}
    return messages


def severities(made):
    """The highest severity of the findings of each code."""
    return {finding.code: finding.severity for finding in reversed(made.findings)}


def place(made, code):
    """First byte place of the finding of one code."""
    (found,) = [finding for finding in made.findings if finding.code == code]
    return found.places[0].byte_offset


@pytest.fixture
def log(tmp_path):
    return tmp_path / "a.mcap"


@pytest.fixture(scope="session")
def ingest(ingest_path, plant):
    """Ingest with a 10 ms grid."""
    return lambda path, **options: ingest_path(path, **{"settings": GRID, "plant": plant, **options})


class TestUndamaged:
    @pytest.mark.parametrize("compression", COMPRESSION)
    def test_all_is_used_and_no_damage_is_told(self, log, ingest, compression):
        made = ingest(write(log, 2000, compression=compression))
        assert len(counts_hold(made, 2000)) == 0
        assert made.counts["messages_used"] == len(made.samples) == 2000
        assert made.facts["whole_file"]
        assert "error" not in severities(made).values()


class TestEndOfTheFile:
    @pytest.mark.parametrize("compression", COMPRESSION)
    def test_truncated_at_70_percent(self, log, ingest, compression):
        write(log, compression=compression)
        cut = int(0.7 * log.stat().st_size)
        ends = [i.chunk_start_offset + i.chunk_length for i in containers.chunk_indexes(log)]
        saved = sum(n for n, end in zip(per_chunk(log), ends, strict=True) if end <= cut)
        log.write_bytes(log.read_bytes()[:cut])
        made = ingest(log)
        assert len(counts_hold(made, saved)) == 0
        assert 0.6 * N < saved == made.counts["messages_used"] < 0.8 * N
        assert severities(made)["truncated"] == "error"
        assert place(made, "truncated") <= cut
        assert not made.facts["whole_file"]

    def test_no_footer_and_no_summary(self, log, ingest):
        made = ingest(containers.without_summary(write(log)))
        counts_hold(made, N)
        assert made.counts["messages_used"] == N
        assert "no_footer" in severities(made)
        assert not made.facts["whole_file"]

    def test_a_writer_that_writes_no_summary(self, log, ingest):
        nothing = dict.fromkeys(("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets"), False)
        made = ingest(write(log, index_types=IndexType.NONE, **nothing))
        counts_hold(made, N)
        assert made.counts["messages_used"] == N
        assert "error" not in severities(made).values()

    @pytest.mark.parametrize("chunked", [True, False])
    def test_trailing_zeros(self, log, ingest, chunked):
        write(log, 2000, chunked=chunked)
        size = log.stat().st_size
        log.write_bytes(log.read_bytes() + bytes(50_000))
        made = ingest(log)
        counts_hold(made, 2000)
        assert made.counts["messages_used"] == 2000
        assert severities(made)["trailing_bytes"] == "warning"
        assert place(made, "trailing_bytes") == size

    def test_an_empty_file_and_one_of_magic_bytes_are_refused(self, log, ingest):
        for content in (b"", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" * 2, bytes(100)):
            log.write_bytes(content)
            with pytest.raises(LogError):
                ingest(log)


class TestChunks:
    def lost_chunk(self, log, made, number, code, n=N):
        """The messages of one chunk are in the ledger, under its offset, and nothing else is."""
        index, lost = containers.chunk_indexes(log)[number], per_chunk(log)[number]
        messages = counts_hold(made, n)
        assert made.left_out == {code: lost}
        assert made.counts["messages_used"] == n - lost
        assert sorted(messages["topic"]) == list(TOPICS)
        assert set(messages["byte_offset"]) == {index.chunk_start_offset}
        assert set(messages["message_index"]) == {-1}
        assert severities(made)[code] == "error"
        assert place(made, code) == index.chunk_start_offset
        assert made.samples.to_pandas().groupby("point")["segment"].nunique().tolist() == [2, 2]

    @pytest.mark.parametrize("compression", ["zstd", "lz4"])
    def test_a_flipped_byte_in_a_compressed_chunk(self, log, ingest, compression):
        write(log, compression=compression)
        index = containers.chunk_indexes(log)[5]
        for share in (0.3, 0.6, 0.9):
            whole = log.read_bytes()
            containers.flip(log, index.chunk_start_offset + int(share * index.chunk_length))
            made = ingest(log)
            (code,) = made.left_out
            assert code in ("chunk_unreadable", "chunk_crc_mismatch", "chunk_size_mismatch")
            self.lost_chunk(log, made, 5, code)
            log.write_bytes(whole)

    def test_a_flipped_payload_byte_in_an_uncompressed_chunk(self, log, ingest):
        write(log, compression="none")
        containers.flip(log, log.read_bytes().index(little(states(N)[3000])) + 6)
        made = ingest(log)
        which = np.searchsorted(np.cumsum(per_chunk(log)), 3000, side="right")
        self.lost_chunk(log, made, which, "chunk_crc_mismatch")

    def test_unknown_compression(self, log, ingest):
        write(log)
        containers.damage(log, containers.chunk_indexes(log)[7].chunk_start_offset + 41, b"zpaq")
        self.lost_chunk(log, ingest(log), 7, "unknown_compression")

    def test_unknown_compression_of_all_chunks_is_refused_with_the_reason(self, log, ingest):
        write(log, 1000)
        for index in containers.chunk_indexes(log):
            containers.damage(log, index.chunk_start_offset + 41, b"zpaq")
        with pytest.raises(LogError, match=r"unknown_compression 1,000"):
            ingest(log)

    @pytest.mark.parametrize("compression", COMPRESSION)
    def test_a_chunk_that_claims_100_gb(self, log, ingest, compression):
        write(log, compression=compression)
        at = containers.chunk_indexes(log)[4].chunk_start_offset
        containers.damage(log, at + 25, struct.pack("<Q", 100 * 10**9))
        self.lost_chunk(log, ingest(log), 4, "chunk_too_large")

    @pytest.mark.parametrize("summary", [True, False])
    def test_a_hole_of_200_kb(self, log, ingest, summary):
        write(log)
        first, size = 150_000, 200_000
        indexes = containers.chunk_indexes(log)
        touched = [
            i.chunk_start_offset < first + size and i.chunk_start_offset + i.chunk_length > first for i in indexes
        ]
        lost = sum(n for n, gone in zip(per_chunk(log), touched, strict=True) if gone)
        containers.damage(log, first, bytes(size))
        if not summary:
            log.write_bytes(log.read_bytes()[:-37])
        made = ingest(log)
        assert 1000 < lost < N - 1000
        assert made.counts["messages_used"] == N - lost
        if summary:
            messages = counts_hold(made, N)
            assert made.left_out.keys() <= {"chunk_unreadable", "chunk_crc_mismatch", "missing"}
            assert (messages["byte_offset"] >= indexes[touched.index(True)].chunk_start_offset).all()
            assert (messages["byte_offset"] < first + size).all()
        else:
            # Nobody knows how many there were.
            assert len(counts_hold(made, N - lost)) == 0
            assert severities(made)["bytes_unreadable"] == "error"
        assert "error" in severities(made).values()

    @pytest.mark.parametrize("byte", [1, 3, 7])
    def test_a_flipped_length_of_a_chunk_record_costs_nothing(self, log, ingest, byte):
        write(log)
        at = containers.chunk_indexes(log)[5].chunk_start_offset
        containers.flip(log, at + byte)
        made = ingest(log)
        counts_hold(made, N)
        assert made.counts["messages_used"] == N
        assert severities(made)["record_length_mismatch"] == "warning"
        assert place(made, "record_length_mismatch") == at

    def test_a_flipped_length_of_a_message_in_a_chunk(self, log, ingest):
        write(log, compression="none")
        containers.flip(log, log.read_bytes().index(little(states(N)[3000])) - MESSAGE_HEAD + 1)
        which = np.searchsorted(np.cumsum(per_chunk(log)), 3000, side="right")
        self.lost_chunk(log, ingest(log), which, "chunk_crc_mismatch")

    def test_no_message_index(self, log, ingest):
        made = ingest(write(log, index_types=IndexType.NONE))
        counts_hold(made, N)
        assert made.counts["messages_used"] == N
        assert "error" not in severities(made).values()

    def test_no_message_index_and_a_broken_chunk(self, log, ingest):
        per = per_chunk(write(log))
        write(log, index_types=IndexType.ALL & ~IndexType.MESSAGE)
        index = containers.chunk_indexes(log)[5]
        containers.flip(log, index.chunk_start_offset + index.chunk_length // 2)
        made = ingest(log)
        messages = counts_hold(made, N)
        # What the broken content tells of its channels is not to be trusted; the statistics are.
        assert sum(made.left_out.values()) == per[5]
        assert messages.groupby("topic")["count"].sum().tolist() == [per[5] // 2] * 2
        assert set(messages["byte_offset"]) <= {index.chunk_start_offset, -1}

    def test_a_message_index_that_lies_costs_nothing(self, log, ingest):
        write(log)
        index = containers.chunk_indexes(log)[5]
        containers.flip(log, index.chunk_start_offset + index.chunk_length + 30)
        made = ingest(log)
        counts_hold(made, N)
        assert made.counts["messages_used"] == N
        assert severities(made)["message_index_mismatch"] == "warning"


class TestUnchunked:
    def test_all_is_used(self, log, ingest):
        made = ingest(write(log, chunked=False))
        counts_hold(made, N)
        assert made.counts["messages_used"] == N
        assert "error" not in severities(made).values()

    def test_a_flipped_record_length_costs_that_message(self, log, ingest):
        write(log, chunked=False)
        at = log.read_bytes().index(little(states(N)[3001])) - MESSAGE_HEAD
        containers.flip(log, at + 1)
        made = ingest(log)
        messages = counts_hold(made, N)
        assert made.left_out == {"missing": 1}
        assert messages["topic"].tolist() == [TOPICS[1]]
        assert messages["byte_offset"].tolist() == [at]
        assert severities(made)["bytes_unreadable"] == "error"
        assert severities(made)["messages_missing"] == "error"

    def test_a_flipped_payload_byte_is_told_where_there_is_a_check_sum(self, log, ingest):
        write(log, 1000, chunked=False, enable_data_crcs=True)
        containers.flip(log, log.read_bytes().index(little(states(1000)[300])) + 6)
        with pytest.raises(LogError, match="data_crc_mismatch"):
            ingest(log)


class TestDeclarations:
    def test_schema_id_0(self, tmp_path, write_log, ingest):
        made = ingest(write_log(tmp_path / "a.mcap", range(0, 500, 10), json_schema=False))
        counts_hold(made, 50)
        assert made.counts["messages_used"] == 50
        assert "error" not in severities(made).values()

    def test_cdr_with_schema_id_0_is_refused_in_words(self, log, ingest):
        with log.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel(TOPICS[0], "cdr", 0)
            for k, state in enumerate(states(50)):
                writer.add_message(channel, T0 + k * 10 * MS, little(state), T0 + k * 10 * MS)
            writer.finish()
        with pytest.raises(LogError, match="signals have to be named"):
            ingest(log)

    @pytest.mark.parametrize("second", ["cdr", "json"])
    def test_two_channels_on_one_topic(self, log, ingest, second):
        with log.open("wb") as file:
            writer = Writer(file, chunk_size=2000)
            writer.start()
            cdr_schema = writer.register_schema("test/msg/State", "ros2msg", SCHEMA)
            fields = {n: {"type": "number"} for n in ("gap_mm", "coil_current_a", "coil_voltage_v")}
            json_schema = writer.register_schema(
                "State", "jsonschema", json.dumps({"type": "object", "properties": fields}).encode()
            )
            first = writer.register_channel(TOPICS[0], "cdr", cdr_schema)
            other = writer.register_channel(
                TOPICS[0], second, cdr_schema if second == "cdr" else json_schema, {"n": "2"}
            )
            for k, state in enumerate(states(500)):
                t = T0 + k * 10 * MS
                as_json = json.dumps(dict(zip(fields, state, strict=True))).encode()
                payload = as_json if k % 3 == 0 and second == "json" else little(state)
                writer.add_message(other if k % 3 == 0 else first, t, payload, t, k)
            writer.finish()
        made = ingest(log)
        assert len(counts_hold(made, 500)) == 0
        assert made.counts["messages_used"] == len(made.samples) == 500
        assert set(made.samples["segment"].to_pylist()) == {0}
        np.testing.assert_allclose(made.samples["gap_m"], states(500)[:, 0] / 1000, rtol=1e-15)

    def test_big_endian_cdr(self, log, ingest):
        made = ingest(write(log, 2000, encode=lambda state: b"\0\0\0\0" + cdr(state, ">")))
        counts_hold(made, 2000)
        assert made.counts["messages_used"] == 2000
        in_order = np.concatenate([states(2000)[k::2] for k in (0, 1)])
        np.testing.assert_allclose(made.samples["gap_m"], in_order[:, 0] / 1000, rtol=1e-15)
        np.testing.assert_array_equal(made.samples["voltage_v"], in_order[:, 2])

    def test_both_byte_orders_and_nonsense_in_turn(self, log, ingest):
        some = {k: b"\0\0\0\0" + cdr(states(2000)[k], ">") for k in range(100, 200)}
        bad = {500: b"", 501: b"\0\1\0", 502: b"\0\1\0\0" + bytes(23), 503: b"\0\1\0\0"}
        made = ingest(write(log, 2000, payloads={**some, **bad}))
        messages = counts_hold(made, 2000)
        assert made.left_out == {"not_decodable": 4}
        assert messages["message_index"].tolist() == [250, 251, 250, 251]
        assert severities(made)["not_decodable"] == "error"


def rig(tmp_path, mcap_files, t_ms, gap_mm=None, *, publish_ms=None, more=None):
    """A json log of F1; times in ms after T0."""
    gap_mm = 8 + 0.1 * np.sin(np.arange(len(t_ms)) / 3) if gap_mm is None else gap_mm
    publish_ms = t_ms if publish_ms is None else publish_ms
    messages = [
        mcap_files.Msg(
            TOPICS[0],
            T0 + round(t * MS),
            {"gap_mm": float(g), "coil_current_a": 20.0 + 0.01 * (k % 7), "coil_voltage_v": 24.0 - 0.01 * (k % 11)}
            | (more(k) if more else {}),
            T0 + round(p * MS),
        )
        for k, (t, g, p) in enumerate(zip(t_ms, gap_mm, publish_ms, strict=True))
    ]
    return mcap_files.write(tmp_path / "a.mcap", messages)


class TestTimes:
    def test_back_within_the_reordering(self, tmp_path, mcap_files, ingest):
        t = list(range(0, 2000, 10))
        t.insert(103, t.pop(100))
        made = ingest(rig(tmp_path, mcap_files, t))
        assert len(counts_hold(made, 200)) == 0
        assert len(made.samples) == 200
        assert severities(made)["out_of_order"] == "warning"

    def test_a_reset(self, tmp_path, mcap_files, ingest):
        made = ingest(rig(tmp_path, mcap_files, [*range(5000, 6000, 10), *range(0, 1000, 10)]))
        assert len(counts_hold(made, 200)) == 0
        assert made.samples.to_pandas().groupby("segment").size().tolist() == [100, 100]
        assert severities(made)["clock_reset"] == "warning"

    def test_repeated(self, tmp_path, mcap_files, ingest):
        t = list(range(0, 2000, 10))
        t[100] = t[99]
        made = ingest(rig(tmp_path, mcap_files, t))
        messages = counts_hold(made, 200)
        assert made.left_out == {"time_conflict": 1}
        assert messages["message_index"].tolist() == [100]
        assert severities(made)["time_conflict"] == "warning"

    def test_a_clock_that_stands(self, tmp_path, mcap_files, ingest):
        t = [*range(0, 1000, 10), *[1000] * 20, *range(1010, 2000, 10)]
        made = ingest(rig(tmp_path, mcap_files, t))
        counts_hold(made, len(t))
        assert made.left_out == {"time_conflict": 19}
        assert severities(made)["clock_frozen"] == "error"

    def test_a_jump_ahead(self, tmp_path, mcap_files, ingest):
        made = ingest(rig(tmp_path, mcap_files, [*range(0, 1000, 10), *range(60_000, 61_000, 10)]))
        assert len(counts_hold(made, 200)) == 0
        assert made.samples.to_pandas().groupby("segment").size().tolist() == [100, 100]
        # The sequence numbers go on, so nothing is missing.
        assert severities(made)["pause"] == "info"

    @pytest.mark.parametrize("far", [0, 2**62, 2**63 - 1, 2**64 - 1])
    def test_a_single_time_out_of_this_world(self, log, ingest, far):
        with log.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel(TOPICS[0], "cdr", writer.register_schema("a/msg/B", "ros2msg", SCHEMA))
            for k, state in enumerate(states(200)):
                t = far if k == 50 else T0 + k * 10 * MS
                writer.add_message(channel, t, little(state), t, k)
            writer.finish()
        made = ingest(log)
        messages = counts_hold(made, 200)
        assert messages["message_index"].tolist() == [50]
        assert made.left_out.keys() <= {"too_short", "no_time"}

    def test_the_clock_that_is_chosen_counts(self, tmp_path, mcap_files, ingest):
        stamp = np.arange(0, 2000, 10)
        log_ms = stamp + 30 + 8 * (np.arange(200) % 5 == 0)
        path = rig(
            tmp_path, mcap_files, log_ms, publish_ms=stamp + 3,
            more=lambda k: {"stamp": mcap_files.Stamp(1_700_000_000, int(stamp[k]) * MS)} if stamp[k] < 1000
            else {"stamp": mcap_files.Stamp(1_700_000_001, int(stamp[k] - 1000) * MS)},
        )  # fmt: skip
        first = {}
        for clock in ("log_time", "publish_time", "header"):
            signals = SignalMap.model_validate(
                {
                    "topic": "/suspension/(?P<point>[^/]+)/state", "clock": clock,
                    "clock_field": "stamp" if clock == "header" else None,
                    "gap": {"field": "gap_mm", "unit": "mm"},
                    "current": {"field": "coil_current_a", "unit": "A"},
                    "voltage": {"field": "coil_voltage_v", "unit": "V"},
                }
            )  # fmt: skip
            made = ingest(path, signals=signals)
            counts_hold(made, 200)
            t = made.samples["t"].cast("int64").to_numpy() - T0
            first[clock] = int(t[0]) / MS
            assert set(np.diff(t)) == {10 * MS}
            if clock != "log_time":
                assert set(made.samples["gap_origin"].to_pylist()) == {"measured"}
                assert severities(made)["latency"] == "warning"
        assert (first["publish_time"], first["header"]) == (3.0, 0.0)
        assert 30.0 <= first["log_time"] <= 48.0


class TestValues:
    def test_a_unit_that_is_declared_wrong(self, tmp_path, mcap_files, ingest):
        signals = SignalMap.model_validate(
            {
                "topic": "/suspension/(?P<point>[^/]+)/state",
                "gap": {"field": "gap_mm", "unit": "um"},
                "current": {"field": "coil_current_a", "unit": "A"},
                "voltage": {"field": "coil_voltage_v", "unit": "V"},
            }
        )
        free = Plant(gap_min_m=1e-9, gap_max_m=0.016)
        made = ingest(rig(tmp_path, mcap_files, range(0, 2000, 10)), signals=signals, plant=free)
        counts_hold(made, 200)
        (found,) = [f for f in made.findings if f.code == "unit_suspect" and f.numbers["signal"] == "gap"]
        assert found.severity == "error"
        assert found.numbers["suggested"] == "mm"

    def test_a_sensor_that_is_stuck(self, tmp_path, mcap_files, ingest):
        gap = 8 + 0.1 * np.sin(np.arange(600) / 3)
        gap[200:400] = gap[200]
        made = ingest(
            rig(tmp_path, mcap_files, range(0, 6000, 10), gap, more=lambda k: {"coil_current_a": 20 + np.sin(k / 5)})
        )
        assert len(counts_hold(made, 600)) == 0
        (found,) = [f for f in made.findings if f.code == "stuck"]
        assert (found.severity, found.numbers["signal"]) == ("error", "gap")
        assert (found.places[0].first_message, found.places[0].last_message) == (200, 399)

    def test_values_that_are_no_numbers(self, log, ingest):
        nan, inf = float("nan"), float("inf")
        bad = {100: (nan, 20, 24), 201: (8, inf, 24), 302: (8, 20, -inf), 303: (nan, nan, nan)}
        made = ingest(write(log, 2000, payloads={k: little(state) for k, state in bad.items()}))
        messages = counts_hold(made, 2000)
        assert made.left_out == {"not_finite": 4}
        assert messages["message_index"].tolist() == [50, 151, 100, 151]
        assert messages["detail"].tolist() == ["gap", "voltage", "current", "gap, current, voltage"]
        assert severities(made)["not_finite"] == "warning"
        assert np.isfinite(made.samples["gap_m"]).all()


OPTIONS = (
    *({"compression": c} for c in COMPRESSION),
    {"chunked": False, "enable_data_crcs": True},
    {"chunked": False},
    {"compression": "none", "index_types": IndexType.NONE},
)


@pytest.fixture(scope="session")
def wholes(tmp_path_factory, ingest):
    """Small logs, and the rows that come of each."""
    made = []
    for options in OPTIONS:
        path = write(tmp_path_factory.mktemp("whole") / "a.mcap", 120, chunk_size=1500, **options)
        made.append((path.read_bytes(), len(ingest(path).samples)))
    return lambda which: made[which]  # a failure would print the list in full


def damaged(whole, kind, place, length, value):
    """A log with one more damage at `place` millionths of its length."""
    at = 8 + place * (len(whole) - 8) // 10**6
    before, part, behind = whole[:at], whole[at : at + length], whole[at + length :]
    return {
        "flip": before + bytes(b ^ value for b in part[:1]) + part[1:] + behind,
        "zeros": before + bytes(len(part)) + behind,
        "ones": before + b"\xff" * len(part) + behind,
        "cut": before,
        "gone": before + behind,
        "again": before + part + part + behind,
    }[kind]


@given(
    which=st.integers(0, len(OPTIONS) - 1),
    damages=st.lists(
        st.tuples(
            st.sampled_from(["flip", "zeros", "ones", "cut", "gone", "again"]),
            st.integers(0, 10**6),
            st.integers(1, 2000),
            st.integers(1, 255),
        ),
        min_size=1,
        max_size=4,
    ),
)
@settings(max_examples=60, deadline=None)
def test_cuts_flips_and_holes_in_any_number(tmp_path_factory, ingest, wholes, which, damages):
    whole, rows = wholes(which)
    content = whole
    for damage in damages:
        content = damaged(content, *damage)
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    path.write_bytes(content)
    try:
        made = ingest(path)
    except LogError:
        return
    counts_hold(made, made.counts["messages"])
    # Outside chunks no check sum says that a time is wrong, and a wrong time may make a stretch longer. A chunk that
    # is in the file twice looks like a recording that went back in time.
    if OPTIONS[which].get("chunked", True) and not any(kind == "again" for kind, *_ in damages):
        assert made.counts["messages_used"] <= 120
        assert len(made.samples) <= rows
        assert made.counts["messages_used"] == 120 or "error" in severities(made).values()


def test_what_is_told_of_the_findings_counts_damage_too(log, ingest):
    write(log)
    containers.flip(log, containers.chunk_indexes(log)[5].chunk_start_offset + 500)
    made = ingest(log)
    assert made.facts["findings"]["error"] == sum(finding.severity == "error" for finding in made.findings) > 0
