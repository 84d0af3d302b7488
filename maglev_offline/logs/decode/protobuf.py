"""Protobuf messages by one vector of positions: each field is read in all messages at once.

A serialiser writes the fields of a message in the order of their numbers. The cursor expects them so: it compares the
tag at each position, reads the rows that hold the field, and moves these on. A row that does not end where it must
(unknown, repeated or disordered fields, damage) is not sure, and the library decides what it means.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.payloads import ColumnDecoder, Decoded, Payloads, Wanted, nothing_sure
from maglev_offline.logs.decode.protobuf_columns import Columns
from maglev_offline.logs.decode.protobuf_plan import Plan, Want, plan_protobuf
from maglev_offline.logs.decode.protobuf_types import FIXED, FieldPlan, FixedRun, Kind, MessagePlan
from maglev_offline.logs.decode.varints import PADDING, Positions, Reads

DEEPEST = 32
"""Messages within messages; the library goes to 100."""

FEW_ROWS, MANY_OCCURRENCES = 8, 64
"""A list longer than this is followed only while it goes on in so many rows: a step costs the same for one row as for
a thousand, and the library reads the elements of one message faster."""

STEPS, STEPS_PER_ROW = 20_000, 4
"""No more steps than this over one batch, whatever schema and payloads claim."""

Rows = NDArray[np.int64] | None
"""Which rows of the batch the positions belong to; None: all, in order."""

_NOTHING = Want()


def compile_protobuf(schema_name: str, schema: bytes, wanted: Wanted) -> tuple[ColumnDecoder, ...]:
    """The decoders that can serve this schema, the fastest first; none where it is beyond them."""
    plan = plan_protobuf(schema_name, schema, wanted)
    return () if plan is None else (CursorDecoder(plan, wanted),)


class CursorDecoder:
    """Reads the wanted columns of one message type."""

    def __init__(self, plan: Plan, wanted: Wanted) -> None:
        self._plan = plan
        self._wanted = wanted

    @property
    def rung(self) -> str:
        """How messages read this way are counted."""
        return "cursor"

    def decode(self, payloads: Payloads) -> Decoded:
        """Read the wanted columns; sure is every row that ends where it must."""
        n, size = len(payloads), len(payloads.data)
        found = nothing_sure(self._wanted.paths, n, stamped=self._wanted.clock is not None)
        start, length = payloads.start, payloads.length
        there = (start >= 0) & (length >= 0) & (start <= size) & (length <= size - start)
        if not there.all():
            rows = np.flatnonzero(there)
            if len(rows):
                part = _part(found, rows)
                self._read(Payloads(payloads.data, start[rows], length[rows]), part)
                found.values[:, rows], found.sure[rows] = part.values, part.sure
                if found.stamp_ns is not None and part.stamp_ns is not None:
                    found.stamp_ns[rows] = part.stamp_ns
        elif n:
            self._read(payloads, found)
        return found

    def _read(self, payloads: Payloads, found: Decoded) -> None:
        first, last = int(payloads.start.min()), int((payloads.start + payloads.length).max())
        if last > len(payloads.data) - PADDING:
            # A copy with room behind takes less time than reading what stands last by itself.
            data = np.concatenate([payloads.data[first:last], np.zeros(PADDING, dtype=np.uint8)])
            payloads = Payloads(data, payloads.start - first, payloads.length)
        root = self._plan.messages[self._plan.root]
        cursor = _Cursor(self._plan, payloads, found)
        cursor.message(root, self._plan.want, payloads.start, payloads.start + payloads.length, None, 0)


def _part(found: Decoded, rows: slice | NDArray[np.intp]) -> Decoded:
    stamps = None if found.stamp_ns is None else found.stamp_ns[rows]
    return Decoded(found.values[:, rows], stamps, found.sure[rows])


class _Cursor:
    """The state over one batch: what was read, which rows are still sure, and the steps left.

    Positions and ends [k] belong to the rows `rows` [k]. A position may run at most `PADDING` beyond its end, and
    such a row moves no further.
    """

    def __init__(self, plan: Plan, payloads: Payloads, found: Decoded) -> None:
        found.sure[:] = True
        self._sure = found.sure
        self._columns = Columns(found, plan.slots, plan.ns_per_unit)
        self._messages = plan.messages
        self._data = payloads.data
        self._reads = Reads(payloads.data)
        self._steps = STEPS + STEPS_PER_ROW * len(payloads)

    def message(self, plan: MessagePlan, want: Want, start: Positions, end: Positions, rows: Rows, depth: int) -> None:
        """Read one message in each row, from `start` [k] to exactly `end` [k]."""
        self._steps -= len(plan.fields)
        if depth > DEEPEST or self._steps < 0:
            self._doubt_all(rows)
            return
        omitted = dict(want.defaults)
        pos = start.copy()
        head, open_ = self._reads.at(plan.head, pos), pos < end
        seen: dict[str, NDArray[np.bool_]] = {}
        ahead = iter(enumerate(plan.fields))
        for number, field in ahead:
            run = plan.runs.get(number)
            after = None if run is None else self._run(run, want, pos, end, rows)
            if run is not None and after is not None:
                for one in run.fields:
                    omitted.pop(one.number, None)
                for _ in run.fields[1:]:
                    next(ahead)
                pos, head, open_ = after, self._reads.at(plan.head, after), after < end
                if not (plan.needs_all or open_.any()):
                    break
                continue
            hit = _holds(head, plan.head, field) & open_
            count = np.count_nonzero(hit)
            if field.required and count < len(pos):
                self._doubt(~hit, rows)
            if count == 0:
                continue
            if field.oneof:
                # Of two fields of one oneof the later one counts, and the first must be taken back.
                before = seen.get(field.oneof)
                if before is not None:
                    self._doubt(before & hit, rows)
                seen[field.oneof] = hit if before is None else before | hit
            below, left_out = want.fields.get(field.number, _NOTHING), omitted.pop(field.number, ())
            if count == len(pos):
                pos = self._field(field, below, pos + field.tag_bytes, end, rows, depth)
                head = self._reads.at(plan.head, pos)
            else:
                self._columns.put_defaults(left_out, rows)
                some = np.flatnonzero(hit)
                after = self._field(field, below, pos[some] + field.tag_bytes, end[some], _of(rows, some), depth)
                pos[some] = after
                head[some] = self._reads.at(plan.head, after)
            open_ = pos < end
            if not (plan.needs_all or open_.any()):
                break
        self._doubt(pos != end, rows)
        for left_out in omitted.values():
            self._columns.put_defaults(left_out, rows)
        if want.time is not None:
            self._doubt(self._columns.put_time(want, rows), rows)

    def _run(self, run: FixedRun, want: Want, pos: Positions, end: Positions, rows: Rows) -> Positions | None:
        """Read fields of fixed size in one go; None, and nothing done, where a message lacks one of them."""
        after = pos + run.span
        if (after > end).any():
            return None
        records = self._reads.records(pos, run.span)

        def column(kind: np.dtype[Any], offset: int) -> NDArray[Any]:
            return np.ndarray((len(pos),), kind, buffer=records, offset=offset, strides=(run.span,))

        for field, offset in zip(run.fields, run.offsets, strict=True):
            if (column(np.dtype(f"<u{field.tag_bytes}"), offset) != field.tag).any():
                return None
        for field, offset in zip(run.fields, run.offsets, strict=True):
            below = want.fields.get(field.number, _NOTHING)
            if below is not _NOTHING:
                self._columns.put(below, column(FIXED[field.kind], offset + field.tag_bytes), rows)
        return after

    def _field(self, field: FieldPlan, want: Want, pos: Positions, end: Positions, rows: Rows, depth: int) -> Positions:
        """Read one field, its first tag behind; return the positions after it, all of its occurrences included."""
        if field.packed:
            stop = self._length(pos, end, rows)
            return self._packed(field, want, stop[0], stop[1], rows)
        if not field.repeated:
            return self._one(field, want, pos, end, rows, depth)
        return self._occurrences(field, want, pos, end, rows, depth)

    def _occurrences(
        self, field: FieldPlan, want: Want, pos: Positions, end: Positions, rows: Rows, depth: int
    ) -> Positions:
        """A list: each element with its tag, or packed ones without."""
        head = np.dtype(f"<u{1 << (field.tag_bytes - 1).bit_length()}")
        tag = 0 if field.packed else field.tag_bytes
        final = np.empty_like(pos)
        active = np.arange(len(pos))
        k = 0
        while len(active):
            self._steps -= 1
            if self._steps < 0 or (k >= MANY_OCCURRENCES and len(active) < FEW_ROWS):
                self._doubt_all(_of(rows, active))
                final[active] = end
                break
            below = want.elements.get(k, _NOTHING)
            after = self._one(field, below, pos, end, _of(rows, active), depth)
            k += 1
            more = after < end
            if not field.packed:
                more &= _holds(self._reads.at(head, after), head, field)
            final[active[~more]] = after[~more]
            active, pos, end = active[more], after[more] + tag, end[more]
        return final

    def _packed(self, field: FieldPlan, want: Want, pos: Positions, stop: Positions, rows: Rows) -> Positions:
        """Elements side by side from `pos` to exactly `stop`; returns `stop`."""
        fixed = FIXED.get(field.kind)
        if fixed is None:
            some = np.flatnonzero(pos < stop)
            if len(some):
                final = self._occurrences(field, want, pos[some], stop[some], _of(rows, some), 0)
                self._doubt(final != stop[some], _of(rows, some))
            return stop
        self._doubt((stop - pos) % fixed.itemsize != 0, rows)
        for k, below in want.elements.items():
            place = pos + k * fixed.itemsize
            some = np.flatnonzero(place + fixed.itemsize <= stop)
            if len(some):
                self._columns.put(below, self._reads.at(fixed, place[some]), _of(rows, some))
        return stop

    def _one(self, field: FieldPlan, want: Want, pos: Positions, end: Positions, rows: Rows, depth: int) -> Positions:
        """Read one value; return the positions after it."""
        fixed = FIXED.get(field.kind)
        if fixed is not None:
            if want is not _NOTHING:
                self._columns.put(want, self._reads.at(fixed, pos), rows)
            return pos + fixed.itemsize
        if field.kind in (Kind.TEXT, Kind.BYTES, Kind.MESSAGE):
            pos, stop = self._length(pos, end, rows)
            if field.kind is Kind.TEXT:
                self._doubt(self._not_text(pos, stop), rows)
            elif field.kind is Kind.MESSAGE:
                self.message(self._messages[field.message], want, pos, stop, rows, depth + 1)
            return stop
        value, after, bad = self._reads.varint(pos)
        if bad is not None:
            self._doubt(bad, rows)
        if field.known is not None:
            # A value that a closed enum does not know is no value of the field.
            self._doubt(~np.isin(value.view(np.int64), field.known), rows)
        if want is not _NOTHING:
            self._columns.put_varint(want, value, field.kind, rows)
        return after

    def _length(self, pos: Positions, end: Positions, rows: Rows) -> tuple[Positions, Positions]:
        """First and one past the last byte of what has its length before it, never beyond `end`."""
        value, after, _ = self._reads.varint(pos)
        claimed = np.minimum(value, np.uint64(len(self._data))).view(np.int64)
        stop = after + claimed
        beyond = (stop > end) | (after - pos > 4)
        if beyond.any():
            self._doubt(beyond, rows)
            stop = np.minimum(stop, end)
            after = np.minimum(after, stop)
        return after, stop

    def _not_text(self, pos: Positions, stop: Positions) -> NDArray[np.bool_]:
        """Where the bytes are no UTF-8, which the library refuses."""
        wrong = np.zeros(len(pos), dtype=np.bool_)
        for k in np.flatnonzero(self._not_ascii(pos, stop)).tolist():
            try:
                self._data[pos[k] : stop[k]].tobytes().decode()
            except UnicodeDecodeError:
                wrong[k] = True
        return wrong

    def _not_ascii(self, pos: Positions, stop: Positions) -> NDArray[np.bool_]:
        """Where a byte is over 127, or the text is too long to be looked at eight bytes at a time."""
        long = stop - pos > 64
        wrong = long.copy()
        active = np.flatnonzero((stop > pos) & ~long)
        at = pos[active]
        while len(active):
            left = np.minimum(stop[active] - at, 8).astype(np.uint64)
            kept = np.uint64(0x8080808080808080) >> (np.uint64(64) - left * np.uint64(8))
            wrong[active] |= (self._reads.at(np.dtype("<u8"), at) & kept) != 0
            more = left == 8
            active, at = active[more], at[more] + 8
            inside = at < stop[active]
            active, at = active[inside], at[inside]
        return wrong

    def _doubt(self, bad: NDArray[np.bool_], rows: Rows) -> None:
        if bad.any():
            self._sure[bad if rows is None else rows[bad]] = False

    def _doubt_all(self, rows: Rows) -> None:
        self._sure[slice(None) if rows is None else rows] = False


def _of(rows: Rows, some: NDArray[np.intp]) -> NDArray[np.int64]:
    return some if rows is None else rows[some]


def _holds(
    head: NDArray[np.unsignedinteger], width: np.dtype[np.unsignedinteger], field: FieldPlan
) -> NDArray[np.bool_]:
    """Where the first bytes are the field's tag."""
    if field.tag_bytes < width.itemsize:
        head = head & width.type((1 << 8 * field.tag_bytes) - 1)
    found: NDArray[np.bool_] = head == width.type(field.tag)
    return found
