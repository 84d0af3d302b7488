import numpy as np
from google.protobuf.internal.encoder import _VarintBytes
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.logs.decode.varints import PADDING, Reads, unzigzag

WHOLE = st.one_of(st.integers(0, 127), st.integers(0, 2**35), st.integers(0, 2**64 - 1))


def reads(*parts: bytes) -> tuple[Reads, np.ndarray]:
    """The parts side by side, and where each begins."""
    start = np.cumsum([0, *map(len, parts)])[:-1]
    return Reads(np.frombuffer(b"".join(parts) + bytes(PADDING), dtype=np.uint8)), start


@given(st.lists(WHOLE, min_size=1))
def test_a_varint_is_read_as_it_was_written(values):
    coded = [_VarintBytes(v) for v in values]
    read, start = reads(*coded)
    value, after, bad = read.varint(start)
    assert value.tolist() == values
    assert (after - start).tolist() == [len(c) for c in coded]
    assert bad is None or not bad.any()


def test_a_varint_of_more_than_64_bits_is_bad():
    read, start = reads(b"\xff" * 9 + b"\x01", b"\xff" * 9 + b"\x02", b"\x80" * 10 + b"\x01", b"\x05")
    value, _, bad = read.varint(start)
    assert bad.tolist() == [False, True, True, False]
    assert int(value[0]) == 2**64 - 1


def test_a_varint_with_more_bytes_than_it_needs_has_the_same_value():
    read, start = reads(b"\x85\x80\x00", b"\x80" * 9 + b"\x00", b"\x00")
    value, after, _ = read.varint(start)
    assert value.tolist() == [5, 0, 0]
    assert (after - start).tolist() == [3, 10, 1]


@given(st.lists(st.integers(-(2**63), 2**63 - 1)))
def test_zigzag(values):
    coded = np.array([(v << 1 ^ v >> 63) & (2**64 - 1) for v in values], dtype=np.uint64)
    assert unzigzag(coded).tolist() == values


@given(st.binary(min_size=PADDING, max_size=200), st.sampled_from(["<f8", "<f4", "<u2", "<i8"]))
def test_a_number_may_begin_at_any_byte(data, dtype):
    kind = np.dtype(dtype)
    read = Reads(np.frombuffer(data, dtype=np.uint8)).at(kind, np.arange(len(data) - 7))
    expected = [data[k : k + kind.itemsize] for k in range(len(data) - 7)]
    assert [read[k : k + 1].tobytes() for k in range(len(read))] == expected
