"""Checks of a log: each looks at arrays and says what it finds."""

from maglev_offline.ingest.checks.codes import CODES, Code
from maglev_offline.ingest.checks.merge import merge
from maglev_offline.ingest.checks.point import point_findings
from maglev_offline.ingest.checks.recording import recording_findings
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.checks.signals import signal_findings

__all__ = ["CODES", "CheckSettings", "Code", "merge", "point_findings", "recording_findings", "signal_findings"]
