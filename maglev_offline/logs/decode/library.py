"""From a message's bytes to its numbers: the decoders by encoding, and how a dotted path finds its way."""

import io
import json
import math
import re
import struct
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from typing import Any, NamedTuple

from google.protobuf.message import DecodeError
from google.protobuf.message import Message as ProtobufMessage
from mcap.decoder import DecoderFactory
from mcap.exceptions import McapError
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
from mcap_ros1.decoder import DecoderFactory as Ros1LibraryFactory
from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory

from maglev_offline.logs.schema_fields import TIME_PARTS

Decoder = Callable[[bytes], Any]

UNDECODABLE = (
    McapError,
    DecodeError,
    ValueError,  # UnicodeDecodeError and JSONDecodeError among them
    struct.error,
    LookupError,
    EOFError,
    TypeError,
    ArithmeticError,
    NotImplementedError,
    RecursionError,
    MemoryError,
)
"""What the decoders raise on bytes that they cannot read."""


class JsonDecoderFactory(DecoderFactory):
    """Decodes `json` payloads with the standard library; NaN and Infinity are taken as Python takes them."""

    def decoder_for(self, message_encoding: str, schema: Schema | None) -> Decoder | None:  # noqa: ARG002
        """Return the decoder where the channel holds JSON, whatever its schema."""
        return json.loads if message_encoding == "json" else None


_ROS1_FIELD = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)?(\[\d*\])?\s+[A-Za-z]\w*", re.ASCII)
_ROS1_NAME = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*", re.ASCII)


class Ros1DecoderFactory(DecoderFactory):
    """Decodes `ros1` payloads with the library, which writes Python code from the schema and runs it.

    A log is not trusted with that: of its schema only type names, member names and the marks between types are
    handed on. Constants and comments, which no message holds, are dropped.
    """

    def __init__(self) -> None:
        self._library = Ros1LibraryFactory()

    def decoder_for(self, message_encoding: str, schema: Schema | None) -> Decoder | None:
        """Return the decoder where the channel holds ROS 1 messages with their schema."""
        if message_encoding != "ros1" or schema is None or schema.encoding != "ros1msg":
            return None
        if not _ROS1_NAME.fullmatch(schema.name):
            raise ValueError(f"{schema.name[:80]!r} is no name of a ROS 1 message")
        plain = Schema(id=schema.id, name=schema.name, encoding="ros1msg", data=plain_ros1(schema.data.decode()))
        return _told(self._library.decoder_for(message_encoding, plain))


def _told(decoder: Decoder | None) -> Decoder | None:
    """The library's decoder, whose exceptions are of types of its own, made to raise a ValueError."""
    if decoder is None:
        return None

    def decode(data: bytes) -> Any:
        try:
            return decoder(data)
        except Exception as error:
            raise ValueError(f"{type(error).__name__}: {error}") from None

    return decode


def plain_ros1(text: str) -> bytes:
    """The fields of a ROS 1 message definition and of those it refers to, and nothing else.

    Raises
    ------
    ValueError: a line is neither a field, a constant, a comment, nor a mark between two types.
    """
    kept = []
    for raw in text.splitlines():
        line = raw.partition("#")[0].strip()
        if not line or "=" in line.replace("=" * 80, ""):
            continue
        if (
            line == "=" * 80
            or (line.startswith("MSG:") and _ROS1_NAME.fullmatch(line.removeprefix("MSG:").strip()))
            or _ROS1_FIELD.fullmatch(line)
        ):
            kept.append(line)
        else:
            raise ValueError(f"{line[:80]!r} is no line of a ROS 1 message definition")
    return "\n".join([*kept, ""]).encode()


class Decoders:
    """The decoders of one file; each channel's is made once."""

    def __init__(self) -> None:
        self._factories: tuple[DecoderFactory, ...] = (
            Ros2DecoderFactory(),
            Ros1DecoderFactory(),
            ProtobufDecoderFactory(),
            JsonDecoderFactory(),
        )

    def of(self, channel: Channel, schema: Schema | None) -> Decoder | None:
        """Return the channel's decoder, or None for an encoding that none of them reads.

        Raises
        ------
        ValueError: the schema itself cannot be read.
        """
        for factory in self._factories:
            try:
                # The parser of ROS 2 schemas prints what it then raises.
                with redirect_stderr(io.StringIO()):
                    decoder = factory.decoder_for(channel.message_encoding, schema)
            except Exception as error:  # the schema parsers have exception types of their own, private ones
                raise ValueError(f"{type(error).__name__}: {error}") from None
            if decoder is not None:
                return decoder
        return None


def can_decode(message_encoding: str, schema_encoding: str) -> bool:
    """Whether there is a decoder for this pair of encodings."""
    return message_encoding == "json" or (message_encoding, schema_encoding) in {
        ("cdr", "ros2msg"),
        ("ros1", "ros1msg"),
        ("protobuf", "protobuf"),
    }


def value_at(message: Any, parts: Sequence[str]) -> Any:
    """Return what the path leads to in a decoded message, or None where something on it is missing."""
    for part in parts:
        message = _step(message, part)
        if message is None:
            return None
    return message


def _step(message: Any, part: str) -> Any:
    if isinstance(message, dict):
        return message.get(part)
    if isinstance(message, ProtobufMessage):
        field = message.DESCRIPTOR.fields_by_name.get(part)
        # A field with presence that was not set was not measured; its default value would be an invented zero.
        if field is None or (field.has_presence and not message.HasField(part)):
            return None
        return getattr(message, part)
    if part.isdigit():
        try:
            return message[int(part)]
        except (TypeError, LookupError):
            return None
    return getattr(message, part, None)


def number(value: Any) -> float:
    """Return the value as a float; NaN for all that is no number (a truth value is none), seconds for a time."""
    if type(value) is float:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            return math.nan
    nanoseconds = _time_parts_ns(value)
    return math.nan if nanoseconds is None else nanoseconds / 1e9


class ClockField(NamedTuple):
    """A time stamp inside the messages: its dotted path, and the nanoseconds in one unit of a plain number."""

    path: str
    ns_per_unit: float = 1e9


def clock_ns(value: Any, ns_per_unit: float) -> int | None:
    """Return a time stamp in integer nanoseconds, or None where it is missing or out of the range of int64.

    A time of two parts and an integer lose nothing; a floating-point number of seconds has lost some 0.2
    microseconds before it was logged.
    """
    nanoseconds = _time_parts_ns(value)
    if nanoseconds is None and isinstance(value, int) and not isinstance(value, bool):
        whole = round(ns_per_unit)
        exact = math.isclose(whole, ns_per_unit, rel_tol=1e-12)
        nanoseconds = value * whole if exact else round(value * ns_per_unit)
    elif nanoseconds is None and isinstance(value, float) and math.isfinite(value * ns_per_unit):
        nanoseconds = round(value * ns_per_unit)
    if nanoseconds is None or not -(2**63) < nanoseconds < 2**63:
        return None
    return nanoseconds


def _time_parts_ns(value: Any) -> int | None:
    if value is None or isinstance(value, int | float | str):
        return None
    for whole, rest in TIME_PARTS:
        seconds = value.get(whole) if isinstance(value, dict) else getattr(value, whole, None)
        nanoseconds = value.get(rest) if isinstance(value, dict) else getattr(value, rest, None)
        if isinstance(seconds, int) and isinstance(nanoseconds, int):
            return seconds * 1_000_000_000 + nanoseconds
    return None
