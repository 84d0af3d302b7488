"""The stages joined: what each command of the command line does.

A stage is imported by the command that runs it: a second run on unchanged logs is over sooner than pandas is imported.
"""

from maglev_offline.pipeline.data import curate, export_prefill, ingest, prefill, would_ingest
from maglev_offline.pipeline.learning import algorithms, train, transfer
from maglev_offline.pipeline.plant import control, control_page, identify
from maglev_offline.pipeline.whole import card, report, run

__all__ = [
    "algorithms", "card", "control", "control_page", "curate", "export_prefill", "identify", "ingest", "prefill",
    "report", "run", "train", "transfer", "would_ingest",
]  # fmt: skip
