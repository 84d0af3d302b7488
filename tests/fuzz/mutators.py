"""Changes bytes and texts at random; the same seed gives the same change."""

import random
import re
import struct

EDGES = [0, 1, 0x7F, 0x80, 0xFF, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1]

VALUES = [
    *("0", "-1", "1e308", "-1e-308", "1e-400", "nan", "inf", "-inf", "9" * 30, "9" * 5000, "0x7fffffffffffffff"),
    *("true", "2024-01-01", '""', '"a"', '"(?P<point>.+"', '"\\u0000"', "[]", "[[1]]", "[1, 'a']", "{}", "{a = 1}"),
]


def mutated(data: bytes, other: bytes, seed: str) -> bytes:
    """One to four changes of `data`; some take a piece of `other`."""
    draw = random.Random(seed)
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        data = draw.choice(_BINARY)(data, other, draw)
    return data


def mutated_text(data: bytes, other: bytes, seed: str) -> bytes:
    """The same for TOML and JSON: values, lines, brackets; now and then bytes."""
    draw, text = random.Random(seed), data.decode()
    for _ in range(draw.choice((1, 1, 2, 4))):
        text = draw.choice(_TEXT)(text, other.decode(), draw)
    return mutated(text.encode(), other, seed) if draw.random() < 0.2 else text.encode()


def _place(data, draw):
    # Heads and tails hold most of what a reader trusts.
    edge = min(len(data), 256)
    return draw.choice((draw.randrange(len(data) + 1), draw.randrange(edge + 1), len(data) - draw.randrange(edge + 1)))


def _flip(data, other, draw):
    at = _place(data, draw)
    return data[:at] + bytes(b ^ (1 << draw.randrange(8)) for b in data[at : at + 1]) + data[at + 1 :]


def _number(data, other, draw):
    at, size = _place(data, draw), draw.choice("BHIQ")
    value = draw.choice(EDGES) % 2 ** (8 * struct.calcsize(size))
    return data[:at] + struct.pack(f"<{size}", value) + data[at + struct.calcsize(size) :]


def _float(data, other, draw):
    at = _place(data, draw)
    value = draw.choice((float("nan"), float("inf"), -float("inf"), 1e308, -0.0, 5e-324))
    return data[:at] + struct.pack("<d", value) + data[at + 8 :]


def _cut(data, other, draw):
    return data[: _place(data, draw)]


def _gone(data, other, draw):
    at = _place(data, draw)
    return data[:at] + data[at + draw.randrange(1, 64) :]


def _again(data, other, draw):
    at, length = _place(data, draw), draw.randrange(1, 256)
    return data[: at + length] + data[at:]


def _noise(data, other, draw):
    at = _place(data, draw)
    return data[:at] + draw.randbytes(draw.randrange(1, 64)) + data[at + draw.randrange(64) :]


def _piece(data, other, draw):
    at, start = _place(data, draw), _place(other, draw)
    piece = other[start : start + draw.randrange(1, 512)]
    return data[:at] + piece + data[at + draw.choice((0, len(piece))) :]


_BINARY = (_flip, _flip, _number, _number, _float, _cut, _gone, _again, _noise, _piece)


def _value(text, other, draw):
    found = list(re.finditer(r"(?<=[=:,\[] )[^,\]}\n]+", text))
    if not found:
        return text + "= 1"
    one = draw.choice(found)
    return text[: one.start()] + draw.choice(VALUES) + text[one.end() :]


def _line(text, other, draw):
    lines, more = text.splitlines(), other.splitlines() or [""]
    at = draw.randrange(len(lines) + 1)
    lines[at : at + draw.choice((0, 0, 1))] = draw.choice(([], [draw.choice(more)], [draw.choice(lines or [""])]))
    return "\n".join(lines)


def _brackets(text, other, draw):
    at = draw.randrange(len(text) + 1)
    return text[:at] + draw.choice("[{(\"'") * draw.choice((1, 2, 3000)) + text[at:]


def _key(text, other, draw):
    found = list(re.finditer(r"^\w+", text, re.MULTILINE))
    if not found:
        return text
    one = draw.choice(found)
    return text[: one.start()] + draw.choice(("x", "plant", "discount", one[0] * 2)) + text[one.end() :]


_TEXT = (_value, _value, _value, _value, _line, _line, _key, _brackets)
