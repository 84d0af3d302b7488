"""Decodes JSON messages by columns: with a template where they are all alike, else with Arrow's parser."""

from maglev_offline.logs.decode.json_by_arrow import ArrowJson
from maglev_offline.logs.decode.json_by_template import TemplateJson
from maglev_offline.logs.decode.payloads import ColumnDecoder, Wanted


def compile_json(wanted: Wanted) -> tuple[ColumnDecoder, ...]:
    """Return the decoders of JSON messages, the faster first."""
    if not all(wanted.paths):
        return ()  # the empty path is the whole message
    return TemplateJson(wanted), ArrowJson(wanted)
