"""All that the samples of a log depend on beside the log: the recipe tables of ingestion."""

from dataclasses import dataclass, field
from typing import Any

from maglev_offline.ingest.check_settings import CheckSettings
from maglev_offline.ingest.ledger import RULE_VERSION
from maglev_offline.ingest.select import Selection
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.signals import SignalMap
from maglev_offline.physics.parameters import Plant
from maglev_offline.workspace import fingerprint


@dataclass(frozen=True)
class Request:
    """`signals` is None where they are to be found by names and units."""

    signals: SignalMap | None = None
    settings: IngestSettings = field(default_factory=IngestSettings)
    plant: Plant = field(default_factory=Plant)
    checks: CheckSettings = field(default_factory=CheckSettings)
    select: Selection = field(default_factory=Selection)

    def tables(self) -> dict[str, Any]:
        """The recipe tables, JSON-able."""
        return {
            "ingest": self.settings.model_dump(mode="json"),
            "plant": self.plant.model_dump(mode="json"),
            "signals": self.signals.model_dump(mode="json") if self.signals is not None else None,
            "checks": self.checks.model_dump(mode="json"),
            "select": self.select.model_dump(mode="json"),
        }

    def fingerprint(self, kind: str, sha256: str) -> str:
        """What the artefact of a log with this hash is known by."""
        return fingerprint(kind, {"log": sha256}, **self.tables(), rule_version=RULE_VERSION)
