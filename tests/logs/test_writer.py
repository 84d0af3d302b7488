"""Writing MCAP: every encoding gives the same values to the libraries' own decoders, and nothing half-written stays."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

from maglev_offline.logs.writer import ENCODINGS, Encoding, Messages, MessageType, write_log

KIND = MessageType("maglev/msg/Pair", {"gap_mm": "mm", "coil_current_a": "A"})
TOPICS = ["/a", "/b"]
MESSAGES = Messages(
    topic=np.array([0, 1, 0, 1]),
    log_time_ns=np.array([10, 20, 15, 40]) + 10**18,
    publish_time_ns=np.array([9, 18, 14, 39]) + 10**18,
    sequence=np.array([0, 0, 1, 1]),
    values=np.array([[8.002, -1e-9], [0.0, 17.125], [1e300, 3.0], [0.1, 2 / 3]]),
)


def decoded(path: Path) -> list[tuple[str, int, int, int, float, float]]:
    """Messages by the libraries' own decoders, in the order of the file."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[Protobuf(), Ros2(), _Json()])
        found = []
        for _, channel, message, value in reader.iter_decoded_messages(log_time_order=False):
            stamps = (message.sequence, message.log_time, message.publish_time)
            found.append((channel.topic, *stamps, value.gap_mm, value.coil_current_a))
        return found


class _Json:
    def decoder_for(self, encoding: str, schema: object):  # type: ignore[no-untyped-def]
        import json
        from types import SimpleNamespace

        return (lambda data: SimpleNamespace(**json.loads(data))) if encoding == "json" and schema else None


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_reads_back(tmp_path: Path, encoding: Encoding) -> None:
    path = tmp_path / "new" / "x.mcap"
    write_log(path, TOPICS, KIND, MESSAGES, encoding=encoding, metadata={"origin": {"simulated": "true"}})
    m = MESSAGES
    columns = (m.topic, m.sequence, m.log_time_ns, m.publish_time_ns, m.values[:, 0], m.values[:, 1])
    wanted = [(TOPICS[topic], *rest) for topic, *rest in zip(*(c.tolist() for c in columns), strict=True)]
    assert decoded(path) == wanted
    with path.open("rb") as file:
        metadata = list(make_reader(file).iter_metadata())
    assert [(x.name, x.metadata) for x in metadata] == [("origin", {"simulated": "true"})]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_same_bytes(tmp_path: Path, encoding: Encoding) -> None:
    for name in ("a.mcap", "b.mcap"):
        write_log(tmp_path / name, TOPICS, KIND, MESSAGES, encoding=encoding, metadata={})
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_failure_leaves_the_old_file_and_no_draft(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(b"old")
    with pytest.raises(IndexError):
        write_log(path, TOPICS[:1], KIND, MESSAGES, encoding="json", metadata={})
    assert [p.name for p in tmp_path.iterdir()] == ["x.mcap"]
    assert path.read_bytes() == b"old"
