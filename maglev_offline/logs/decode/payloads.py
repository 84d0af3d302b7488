"""What goes into the vectorised decoders and what comes out of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.library import ClockField

NO_TIME = int(np.iinfo(np.int64).min)
"""In an array of nanoseconds: there is no time here."""

Path = tuple[str, ...]
"""A dotted path in its parts: `("magnets", "2", "gap")`."""


class Wanted(NamedTuple):
    """What to read from the messages of one schema: the paths of its numbers, and the stamp inside them, if any."""

    paths: tuple[Path, ...]
    clock: ClockField | None = None


@dataclass(frozen=True)
class Payloads:
    """The payloads of n messages of one schema in one buffer, in file order.

    `data` [bytes] holds the whole chunk, checked; `start` and `length` [n] say where each payload lies in it. They
    may not be trusted to hold what the schema says.
    """

    data: NDArray[np.uint8]
    start: NDArray[np.int64]
    length: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start)

    def of(self, row: int) -> bytes:
        """The bytes of one payload."""
        first = int(self.start[row])
        return self.data[first : first + int(self.length[row])].tobytes()


class Decoded(NamedTuple):
    """Columns of n messages.

    `values` [paths, n] holds float64, NaN where the field is missing or no number; `stamp_ns` [n] the stamps inside
    the messages (`NO_TIME` where missing), None where none was wanted. `sure` [n] is True where the row is, to the
    last bit, what the library's decoder would have given; every other row goes to the next rung of the ladder, and
    what stands in it here means nothing.
    """

    values: NDArray[np.float64]
    stamp_ns: NDArray[np.int64] | None
    sure: NDArray[np.bool_]


class ColumnDecoder(Protocol):
    """Decodes all messages of one schema at once. It never raises on what a payload holds."""

    @property
    def rung(self) -> str:
        """Name of this way of decoding, as it is counted in the manifest."""

    def decode(self, payloads: Payloads) -> Decoded:
        """Read the wanted columns."""


def nothing_sure(paths: Sequence[Path], n: int, *, stamped: bool) -> Decoded:
    """The result of a decoder that vouches for no row."""
    stamps = np.full(n, NO_TIME, dtype=np.int64) if stamped else None
    return Decoded(np.full((len(paths), n), np.nan), stamps, np.zeros(n, dtype=np.bool_))


def unwritten(paths: int, n: int, *, stamped: bool) -> Decoded:
    """The same with any numbers in it, for a decoder that writes all rows of which it is sure."""
    stamps = np.empty(n, dtype=np.int64) if stamped else None
    return Decoded(np.empty((paths, n)), stamps, np.zeros(n, dtype=np.bool_))
