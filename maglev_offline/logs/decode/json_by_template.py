"""JSON messages that differ from a first one in their scalars only: a compare of bytes, then a parse of columns."""

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from maglev_offline.logs.decode.json_block import Block, Flags, in_bounds, part, slices
from maglev_offline.logs.decode.json_scalars import Match, Scalars
from maglev_offline.logs.decode.json_template import LONGEST_TEMPLATE, NoTemplateError, Template
from maglev_offline.logs.decode.payloads import Decoded, Payloads, Wanted, nothing_sure

_MOST_TEMPLATES = 4
"""So many kinds of messages may share a schema; the rest, and all smaller groups, go to the next rung."""

_FEWEST_ROWS = 16


class TemplateJson:
    """Makes a template of a message and reads all that match it."""

    rung = "template"

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted

    def decode(self, payloads: Payloads) -> Decoded:
        """Read the wanted columns."""
        n = len(payloads)
        found = nothing_sure(self._wanted.paths, n, stamped=self._wanted.clock is not None)
        if not in_bounds(payloads):
            return found
        rest = np.flatnonzero(payloads.length <= LONGEST_TEMPLATE)
        for _ in range(_MOST_TEMPLATES):
            if len(rest) < _FEWEST_ROWS:
                break
            first, rest = int(rest[0]), rest[1:]
            try:
                template = Template.of(payloads.of(first), self._wanted)
            except NoTemplateError:
                continue
            rest = rest[~self._read(payloads, np.append(first, rest), template, found)[1:]]
        return found

    def _read(self, payloads: Payloads, rows: NDArray[np.intp], template: Template, found: Decoded) -> Flags:
        """Fill in what the rows hold that match the template, and return which [rows] these are."""
        match = Match(template)
        matched = np.zeros(len(rows), dtype=np.bool_)
        those = payloads if len(rows) == len(payloads) else part(payloads, rows)
        for first, last in slices(those):
            block = Block(part(those, slice(first, last)), match.room)
            try:
                sure = self._fill(match.read(block), template, found, rows[first:last])
            except pa.ArrowException:
                continue  # a number is none; the next rung finds out which
            matched[first + sure] = True
        return matched

    def _fill(self, scalars: Scalars, template: Template, found: Decoded, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Put the numbers of a block with these `rows` in their places, and return which of them are certain."""
        places = rows[scalars.rows]
        for column, source in zip(found.values, template.sources, strict=True):
            column[places] = scalars.numbers(source)
        if found.stamp_ns is not None and self._wanted.clock is not None:
            found.stamp_ns[places] = scalars.stamps(template.clock, self._wanted.clock.ns_per_unit)
        found.sure[places] = scalars.sure
        return scalars.rows[scalars.sure]
