"""Logs that are made to do harm: they cost no memory, run no code, and write nothing outside the output folder."""

import json
import struct
import time
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, Writer

from maglev_offline.errors import LogError
from maglev_offline.ingest.inspect import inspect_log
from maglev_offline.ingest.inspect_page import inspect_page
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.store import ingest_logs, log_id_of
from maglev_offline.logs.signals import SignalMap

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
N = 50
TOPIC = "/suspension/F1/state"
STATE = {"gap_mm": 8.0, "coil_current_a": 20.0, "coil_voltage_v": 24.0}
GRID = IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=50)
ANY_TOPIC = SignalMap.model_validate(
    {
        "topic": "(?s).*",
        "gap": {"field": "gap_mm", "unit": "mm"},
        "current": {"field": "coil_current_a", "unit": "A"},
        "voltage": {"field": "coil_voltage_v", "unit": "V"},
    }
)
HOSTILE = [
    "../../evil",
    "/../../../etc/passwd",
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "{{ 7 * 7 }}",
    "x" * 10_000,
    "\0\x1b[31m\r\n\t\u202e\ufeff",
    "",
    "/",
    "..",
    "a'; DROP TABLE samples; --",
]


class Log:
    """Writes a log with a channel of states, by the library's writer."""

    def __init__(self, path, topic=TOPIC, encoding="json", schema=None, **options):
        self.path, self.file, self.k = path, path.open("wb"), 0
        self.writer = Writer(self.file, **options)
        self.writer.start()
        self.channel = self.writer.register_channel(
            topic, encoding, self.writer.register_schema(*schema) if schema else 0
        )

    def add(self, *payloads):
        for payload in payloads:
            t = T0 + self.k * 10 * MS
            self.writer.add_message(self.channel, t, payload, t, self.k)
            self.k += 1
        return self

    def close(self):
        self.writer.finish()
        self.file.close()
        return self.path


def states(n=N):
    return [json.dumps({**STATE, "gap_mm": 8 + 0.1 * np.sin(k)}).encode() for k in range(n)]


def all_files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.fixture
def log(tmp_path):
    (tmp_path / "in").mkdir()
    return tmp_path / "in" / "a.mcap"


@pytest.fixture(scope="session")
def ingest(ingest_path):
    return lambda path, **options: ingest_path(path, **{"settings": GRID, **options})


class TestSizes:
    """A size that a log claims is no reason to ask for the memory."""

    @pytest.mark.parametrize("compression", list(CompressionType))
    def test_a_chunk_of_100_gb(self, log, ingest, compression):
        Log(log, compression=compression, chunk_size=500).add(*states()).close()
        data = bytearray(log.read_bytes())
        # The first chunk, whose opcode and length follow the header record.
        at = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]
        assert data[at] == 6
        for claimed in (100 * 10**9, 2**63, 2**64 - 1):
            data[at + 25 : at + 33] = struct.pack("<Q", claimed)
            log.write_bytes(data)
            tracemalloc.start()
            made = ingest(log)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < 64 * 2**20
            assert made.left_out.keys() == {"chunk_too_large"}
            assert made.counts["messages"] == N

    @pytest.mark.parametrize("opcode", [0x03, 0x04, 0x05, 0x06, 0x07, 0x09, 0x0C, 0x0F])
    @pytest.mark.parametrize("claimed", [100 * 10**6, 2**32 - 1, 2**64 - 1])
    def test_a_record_that_claims_more_than_there_is(self, log, ingest, opcode, claimed):
        whole = Log(log).add(*states()).close().read_bytes()
        begin = 8 + 9 + struct.unpack_from("<Q", whole, 9)[0]
        log.write_bytes(whole[:begin] + struct.pack("<BQ", opcode, claimed) + b"abc" * 20 + whole[begin:])
        tracemalloc.start()
        made = ingest(log)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 64 * 2**20
        assert made.counts["messages_used"] == N
        assert [f.severity for f in made.findings if f.code == "bytes_unreadable"] == ["error"]

    @pytest.mark.parametrize("inner", [100 * 10**6, 2**32 - 1])
    def test_a_metadata_record_whose_text_claims_100_mb(self, log, ingest, inner):
        whole = Log(log).add(*states()).close().read_bytes()
        begin = 8 + 9 + struct.unpack_from("<Q", whole, 9)[0]
        record = struct.pack("<BQI", 0x0C, 24, inner) + b"a" * 20
        log.write_bytes(whole[:begin] + record + whole[begin:])
        made = ingest(log)
        assert made.counts["messages_used"] == N
        assert made.facts["metadata"] == {}
        assert any(f.severity == "error" for f in made.findings)

    def test_a_zstd_bomb(self, log, ingest):
        Log(log, compression=CompressionType.ZSTD, chunk_size=2**30).add(*states(), b" " * (256 * 2**20)).close()
        assert log.stat().st_size < 2**20
        began = time.monotonic()
        made = ingest(log)
        assert time.monotonic() - began < 20
        assert made.left_out == {"not_decodable": 1}


class TestNames:
    @pytest.mark.parametrize("topic", HOSTILE, ids=range(len(HOSTILE)))
    def test_a_topic_is_text_and_nothing_else(self, tmp_path, log, workspace, topic):
        Log(log, topic).add(*states()).close()
        before = all_files(tmp_path)
        request = Request(ANY_TOPIC, GRID)
        result = ingest_logs([log], workspace, request)
        (outcome,) = result.logs
        assert outcome.status == "ingested", outcome.message
        assert outcome.counts["messages_used"] == N
        new = all_files(tmp_path) - before
        assert {path.split("/")[0] for path in new} == {"workspace"}
        assert all_files(workspace.root / "samples") == {
            outcome.log_id, *(f"{outcome.log_id}/{path.name}" for path in outcome.folder.iterdir())
        }  # fmt: skip
        assert not any(path.is_symlink() for path in workspace.root.rglob("*"))

        found = inspect_log(log, request)
        page = inspect_page([found.summary.as_dict()], found.findings)
        for tag in ("<script", "<img"):
            assert tag not in page
        assert "{{ 7" not in page or "{{ 7 * 7 }}" in page
        assert "\0" not in page

    @pytest.mark.parametrize(
        "name",
        ["..mcap", "...mcap.mcap", ".mcap", "-rf.mcap", "a b;rm -rf ~.mcap", "<script>.mcap", "a\nb\x1b.mcap",
         "~root.mcap", "%2e%2e%2f.mcap", "ä" * 100 + ".mcap", "x" * 240 + ".mcap", "C:\\..\\evil.mcap"],
    )  # fmt: skip
    def test_a_file_name_stays_within_the_workspace(self, tmp_path, workspace, name):
        path = tmp_path / name
        Log(path).add(*states()).close()
        before = all_files(tmp_path)
        (outcome,) = ingest_logs([path], workspace, Request(None, GRID)).logs
        assert outcome.status == "ingested", outcome.message
        assert outcome.folder.parent == workspace.root / "samples"
        assert {new.split("/")[0] for new in all_files(tmp_path) - before} == {"workspace"}

    @pytest.mark.parametrize(
        "where", ["s3://b/..", "s3://b/../..", "s3://b/a/%2e%2e", "s3://b/.hidden.mcap", "s3://b/"]
    )
    def test_so_does_an_address(self, workspace, where):
        log_id = log_id_of(where, "0123456789abcdef")
        assert "/" not in log_id
        assert not log_id.startswith(".")
        folder = workspace.path("samples", log_id)
        assert folder.resolve().parent == (workspace.root / "samples").resolve()

    def test_an_attachment_is_never_written(self, tmp_path, log, workspace):
        made = Log(log).add(*states())
        for name in ("../x", "/tmp/x", "x", "samples.parquet"):
            made.writer.add_attachment(T0, T0, name, "text/plain", b"evil content 4711")
        made.close()
        before = all_files(tmp_path)
        (outcome,) = ingest_logs([log], workspace, Request(None, GRID)).logs
        assert outcome.status == "ingested"
        new = all_files(tmp_path) - before
        assert {path.split("/")[0] for path in new} == {"workspace"}
        assert not any(path.endswith("/x") for path in new)
        for path in workspace.root.rglob("*"):
            assert path.is_dir() or b"evil content 4711" not in path.read_bytes()

    def test_metadata_is_text(self, log):
        made = Log(log).add(*states())
        made.writer.add_metadata("<script>alert(1)</script>", {"</td><script>": "<script>alert(2)</script>"})
        made.close()
        found = inspect_log(log, Request(None, GRID))
        page = inspect_page([found.summary.as_dict()], found.findings)
        assert "<script" not in page
        assert "&lt;script&gt;" in page


class TestPayloads:
    @pytest.mark.parametrize("brackets", [b"[", b'{"gap_mm":', b"[{"])
    @pytest.mark.parametrize("closed", [True, False])
    def test_100_000_nested_brackets(self, log, ingest, brackets, closed):
        depth = 100_000 // len(brackets)
        closing = bytes({ord("["): ord("]"), ord("{"): ord("}")}[c] for c in reversed(brackets) if c in b"[{")
        nested = brackets * depth + (b"8" + closing * depth if closed else b"")
        within = b'{"gap_mm": 8, "coil_current_a": 20, "coil_voltage_v": 24, "more": ' + nested + b"}"
        made = ingest(Log(log).add(*states(20), nested, within, *states(20)).close())
        assert made.counts["messages"] == 42
        assert made.counts["messages_used"] >= 40
        assert made.left_out.keys() <= {"not_decodable", "not_finite"}

    def test_as_the_first_message(self, log, ingest):
        fields = {"type": "object", "properties": {name: {"type": "number"} for name in STATE}}
        schema = ("State", "jsonschema", json.dumps(fields).encode())
        made = ingest(Log(log, schema=schema).add(b"[" * 100_000, *states()).close())
        assert made.left_out == {"not_decodable": 1}

    def recursive(self):
        F = FieldDescriptorProto
        file = FileDescriptorProto(name="state.proto", package="t", syntax="proto3")
        state = file.message_type.add(name="State")
        for number, name in enumerate(STATE, start=1):
            state.field.add(name=name, number=number, type=F.TYPE_DOUBLE, label=F.LABEL_OPTIONAL)
        state.field.add(name="child", number=4, type=F.TYPE_MESSAGE, type_name=".t.State", label=F.LABEL_OPTIONAL)
        return file

    def test_a_protobuf_type_that_holds_itself(self, log, ingest):
        file = self.recursive()
        pool = DescriptorPool()
        pool.Add(file)
        kind = GetMessageClass(pool.FindMessageTypeByName("t.State"))
        payloads = [kind(**STATE).SerializeToString() for _ in range(N)]
        # A message within a message, and so on: each is the field 4 of the one about it.
        deep = b""
        for _ in range(20_000):
            size, head = len(deep), b"\x22"
            while size > 127:
                head, size = head + bytes([size & 127 | 128]), size >> 7
            deep = head + bytes([size]) + deep
        schema = ("t.State", "protobuf", FileDescriptorSet(file=[file]).SerializeToString())
        made = ingest(Log(log, encoding="protobuf", schema=schema).add(*payloads, payloads[0] + deep).close())
        assert made.counts["messages"] == N + 1
        assert made.counts["messages_used"] >= N
        assert made.left_out.keys() <= {"not_decodable"}

    def test_a_protobuf_file_that_depends_on_itself(self, log, ingest):
        file = self.recursive()
        file.dependency.append("state.proto")
        schema = ("t.State", "protobuf", FileDescriptorSet(file=[file]).SerializeToString())
        with pytest.raises(LogError) as refused:
            ingest(Log(log, encoding="protobuf", schema=schema).add(*[b"\x09" + bytes(8)] * N).close())
        assert refused.value.todo

    def test_protobuf_files_that_depend_on_each_other(self, log, ingest):
        one, other = self.recursive(), FileDescriptorProto(name="b.proto", dependency=["state.proto"], syntax="proto3")
        one.dependency.append("b.proto")
        schema = ("t.State", "protobuf", FileDescriptorSet(file=[one, other]).SerializeToString())
        with pytest.raises(LogError):
            ingest(Log(log, encoding="protobuf", schema=schema).add(*[b"\x09" + bytes(8)] * N).close())

    def test_a_ros2_type_that_holds_itself(self, log, ingest):
        text = b"float64 gap_mm\nfloat64 coil_current_a\nfloat64 coil_voltage_v\nState child\n"
        text += b"=" * 80 + b"\nMSG: t/State\nfloat64 gap_mm\nState child\n"
        made = Log(log, encoding="cdr", schema=("t/msg/State", "ros2msg", text))
        with pytest.raises(LogError):
            ingest(made.add(*[b"\0\1\0\0" + struct.pack("<3d", 8, 20, 24)] * N).close())


class TestCode:
    STATE = "float64 gap_mm\nfloat64 coil_current_a\nfloat64 coil_voltage_v\n"

    def ros1(self, log, text, name="rig/State"):
        payloads = [struct.pack("<3d", 8 + 0.1 * np.sin(k), 20, 24) for k in range(N)]
        return Log(log, encoding="ros1", schema=(name, "ros1msg", text.encode())).add(*payloads).close()

    @pytest.mark.parametrize(
        "line",
        ["uint8 A={code}", "string A={code}", "string A='+{code}+'", 'string A=""" + {code} + """', "# {code}",
         "float64 A=1\n#\x0b{code}", "float64 A=1;{code}", "string A=x\r    {code}"],
    )  # fmt: skip
    @pytest.mark.parametrize("encoding", ["ros1", "cdr"])
    def test_a_constant_with_python_in_it_is_not_run(self, log, ingest, line, encoding, tmp_path):
        mark = tmp_path / "was_run"
        text = self.STATE + line.format(code=f"__import__('pathlib').Path({str(mark)!r}).touch()") + "\n"
        if encoding == "ros1":
            self.ros1(log, text)
        else:
            payload = b"\0\1\0\0" + struct.pack("<3d", 8, 20, 24)
            Log(log, encoding="cdr", schema=("rig/msg/State", "ros2msg", text.encode())).add(*[payload] * N).close()
        with suppress(LogError):
            assert ingest(log).counts["messages_used"] == N
        assert not mark.exists()

    @pytest.mark.parametrize("where", ["name", "type", "field", "mark"])
    def test_nor_is_a_name(self, log, ingest, tmp_path, where):
        mark = tmp_path / "was_run"
        code = f"__import__('pathlib').Path({str(mark)!r}).touch()"
        lines = {
            "type": f"{code} x\n",
            "field": f"float64 x={code}\nfloat64 {code}\n",
            "mark": f"{'=' * 80}\nMSG: {code}\n",
        }
        self.ros1(log, self.STATE + lines.get(where, ""), f"rig/State:\n {code}" if where == "name" else "rig/State")
        with pytest.raises(LogError):
            ingest(log)
        assert not mark.exists()
