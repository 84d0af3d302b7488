"""JSON messages that Arrow's parser may read otherwise than Python's, by what stands in their text."""

import re

import numpy as np

from maglev_offline.logs.decode.json_block import Block, Flags

_SHALLOW, _DEEPEST = 500, 200
"""A message of 500 bytes does not nest deeper than Python's decoder goes; nothing may nest deeper than 200."""

_WINDOW = 300
"""Python refuses integers from 640 digits on, or later, as it is configured: such a one fills a whole window."""

_MOST_BLANKS = 8
_BLANKS = np.frombuffer(b" \t\r\n", dtype=np.uint8)
_BEFORE_VALUE = np.frombuffer(b":,[ \t\r\n", dtype=np.uint8)
_AFTER_VALUE = np.frombuffer(b"},] \t\r\n", dtype=np.uint8)
_STRING = re.compile(rb'"(?:[^"\\]|\\.)*"?', re.DOTALL)


def doubtful(block: Block) -> Flags:
    """The rows [n] that Arrow must not see, or must not be believed.

    The others each begin with a brace and end with one. No brace follows another across a newline within one JSON
    text; so no text of Arrow's extends over two rows, and where it finds as many as there are rows, each is one.
    """
    raw = block.text.tobytes()
    found = _not_braced(block)
    found |= block.not_utf8()
    if b"\0" in raw:  # to Arrow the end of everything
        found |= block.rows_at(np.flatnonzero(block.text == 0))
    found |= _spelled_otherwise(block, raw)
    longest = int((block.end - block.start).max())
    if longest > _SHALLOW:
        found |= _deep(block, raw)
    if longest > 2 * _WINDOW:
        found |= _long_digits(block)
    return found


def _not_braced(block: Block) -> Flags:
    first, last = block.start.copy(), block.end - 1
    for _ in range(_MOST_BLANKS):
        before, after = np.isin(block.text[first], _BLANKS), np.isin(block.text[last], _BLANKS)
        if not before.any() and not after.any():
            break
        first += before & (first < last)
        last -= after & (last > first)
    found: Flags = (first >= last) | (block.text[first] != ord("{")) | (block.text[last] != ord("}"))
    return found


def _spelled_otherwise(block: Block, raw: bytes) -> Flags:
    """Arrow takes Inf and -NaN, which Python does not, and gives a sign to the integer -0."""
    text, places = block.text, []
    if b"I" in raw:
        places += [found.start() for found in re.finditer(rb"(?<=[-:,\[\s])Inf(?!inity)", raw)]
    if b"N" in raw:
        places += [found.start() for found in re.finditer(rb"-NaN", raw)]
    noughts = np.flatnonzero((text[:-2] == ord("-")) & (text[1:-1] == ord("0")))
    alone = np.isin(text[noughts - 1], _BEFORE_VALUE) & np.isin(text[noughts + 2], _AFTER_VALUE)
    noughts = noughts[alone]
    return block.rows_at(np.concatenate((np.array(places, dtype=np.int64), noughts)))


def _deep(block: Block, raw: bytes) -> Flags:
    places = np.flatnonzero((block.text == ord("{")) | (block.text == ord("[")))
    _, count = block.counts(places)
    deep: Flags = count > _DEEPEST
    for row in np.flatnonzero(deep).tolist():
        marks = np.frombuffer(_STRING.sub(b"", raw[block.start[row] : block.end[row]]), dtype=np.uint8)
        opened = np.isin(marks, np.frombuffer(b"{[", dtype=np.uint8)).astype(np.int64)
        closed = np.isin(marks, np.frombuffer(b"}]", dtype=np.uint8))
        deep[row] = int(np.cumsum(opened - closed).max(initial=0)) > _DEEPEST
    return deep


def _long_digits(block: Block) -> Flags:
    windows = len(block.text) // _WINDOW
    digits = (block.text[: windows * _WINDOW] - ord("0") <= 9).reshape(windows, _WINDOW)
    return block.rows_at(np.flatnonzero(digits.all(axis=1)) * _WINDOW)
