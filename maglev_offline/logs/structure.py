"""Where everything lies in an MCAP file: chunks, loose messages, channels, and what is damaged."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray


@dataclass(frozen=True)
class ChunkSpan:
    """One Chunk record: `offset` of its opcode in the file, `length` of the whole record.

    `index_offset` and `index_length` say where the MessageIndex records lie that follow it; length 0 without any.
    """

    offset: int
    length: int
    index_offset: int
    index_length: int


@dataclass(frozen=True)
class LooseSpan:
    """A run of whole records outside chunks, among which are messages."""

    offset: int
    length: int


Span = ChunkSpan | LooseSpan


DAMAGES = {
    "truncated": "The file ends within a record.",
    "no_footer": "The file ends between two records, without its footer: the recorder was stopped hard.",
    "trailing_bytes": "Bytes lie behind the end of the MCAP file.",
    "bytes_unreadable": "A stretch of the file is no sequence of records; reading goes on behind it.",
    "summary_unusable": "The summary at the end does not hold, so the whole file was read instead.",
    "record_length_mismatch": "The length in a chunk record is wrong; the chunk itself holds and was used.",
    "record_too_large": "A schema, channel or metadata record is larger than any sensible one, and was passed over.",
    "metadata_unreadable": "A metadata record cannot be read.",
    "chunk_unreadable": "There is no chunk where one should be, or it cannot be decompressed.",
    "chunk_crc_mismatch": "The content of a chunk does not match its check sum.",
    "chunk_size_mismatch": "A chunk holds more or fewer bytes than it claims.",
    "chunk_too_large": "A chunk claims a size that cannot be, or that is beyond any sensible one.",
    "unknown_compression": "A chunk is compressed in a way that is not known here.",
    "message_index_mismatch": "The index of a chunk does not fit its messages; the messages themselves were used.",
    "records_unreadable": "Within a span, what follows a certain byte is no record.",
    "data_crc_mismatch": "The data section does not match its check sum; the messages outside chunks were not used.",
    "unknown_channel": "Messages belong to a channel that is declared nowhere.",
    "declaration_unreadable": "A schema or channel record cannot be read.",
    "declaration_conflict": "A schema or channel is declared twice under one id, differently; the first counts.",
    "missing_schema": "A channel names a schema that is declared nowhere.",
}
"""What each code of a `Damage` means."""


@dataclass(frozen=True)
class Damage:
    """A stretch of the file that could not be used. `code` is stable, and one of `DAMAGES`.

    `messages` is how many messages were lost by channel id, as far as an index or the statistics tell; None where
    nobody knows.
    """

    code: str
    offset: int
    length: int
    messages: Mapping[int, int] | None
    detail: str


@dataclass(frozen=True)
class Structure:
    """What a file holds, spans in file order.

    `claimed` is how many messages each channel has by the Statistics record, None where there is none. `whole` says
    that the file ends with its footer and that its summary could be read and used.
    """

    spans: tuple[Span, ...]
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    metadata: dict[str, dict[str, str]]
    attachments: tuple[tuple[str, int], ...]
    compressions: tuple[str, ...]
    claimed: dict[int, int] | None
    damages: tuple[Damage, ...]
    whole: bool


@dataclass(frozen=True)
class MessageTable:
    """The n messages of a span in file order: header fields, and where each payload lies in the span's bytes."""

    channel_id: NDArray[np.uint16]
    sequence: NDArray[np.uint32]
    log_time_ns: NDArray[np.uint64]
    publish_time_ns: NDArray[np.uint64]
    start: NDArray[np.int64]
    length: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start)


@dataclass(frozen=True)
class Loaded:
    """The checked bytes of one span and the messages in them; `damages` tells what of the span could not be used.

    `counts` are messages by channel id. `schemas` and `channels` are those whose records lie in the span itself.
    """

    data: NDArray[np.uint8]
    messages: MessageTable
    counts: dict[int, int]
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    damages: tuple[Damage, ...]
