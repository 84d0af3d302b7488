"""Small topics and points, clean until a test plants something."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_offline.ingest.checks import CheckSettings, point_findings, recording_findings, signal_findings
from maglev_offline.ingest.points import PointSamples
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.topics import clean
from maglev_offline.logs.columns import ChannelColumns
from maglev_offline.logs.mapping import TopicPlan
from maglev_offline.logs.signals import Signal, SignalMap
from maglev_offline.physics.parameters import Plant

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
TOPIC = "/suspension/F1/state"

UNITS = {"gap": "m", "velocity": "m/s", "current": "A", "voltage": "V"}


def signal_map(**more):
    signals = {name: Signal(field=name, unit=unit) for name, unit in UNITS.items()}
    return SignalMap(topic="/suspension/(?P<point>[^/]+)/state", **{**signals, **more})


def smooth_values(n, seed=0):
    """Free of every defect: the signals swing slowly about the operating point, with noise."""
    k, rng = np.arange(n), np.random.default_rng(seed)
    swing = np.sin(k / 20 + rng.uniform(0, 6))
    return {
        "gap": 0.008 + 5e-4 * swing + 2e-6 * rng.normal(size=n),
        "velocity": 0.01 * np.cos(k / 20) + 1e-4 * rng.normal(size=n),
        "current": 17 + swing + 0.01 * rng.normal(size=n),
        "voltage": 20 + 3 * swing + rng.normal(size=n),
    }


def columns_of(n=1000, *, period_ms=10, seed=0, **more):
    t_ns = T0 + np.arange(n) * round(period_ms * MS)
    made = ChannelColumns(
        topic=TOPIC,
        log_time_ns=t_ns + MS // 2,
        publish_time_ns=t_ns,
        sequence=np.arange(n),
        file_index=np.arange(n),
        values=smooth_values(n, seed),
        decoded=np.ones(n, dtype=np.bool_),
    )
    return replace(made, **more)


@pytest.fixture(scope="session")
def checked():
    """Check a topic: `run(columns)` gives its findings by code, those of the recording and those of its signals."""
    ingest = IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=50)

    def run(columns, *, using=None, ingest=ingest, settings=None, message=None):
        signals, settings, plant = using or signal_map(), settings or CheckSettings(), Plant()
        plan = TopicPlan(columns.topic, signals.signals(), ("F1",))
        topic, entries = clean(columns, plan, signals, ingest)
        found = recording_findings("a-1", columns, topic, entries, signals, ingest, settings, message=message)
        found += signal_findings("a-1", topic, plan, plant, settings)
        codes = {}
        for finding in found:
            codes.setdefault(finding.code, []).append(finding)
        return codes

    return run


@pytest.fixture(scope="session")
def topics():
    """The makers of columns and signal maps."""
    return SimpleNamespace(columns=columns_of, map=signal_map, values=smooth_values, t0=T0, ms=MS)


@pytest.fixture(scope="session")
def samples():
    """A maker of points: `make(gap=..., current=..., voltage=..., velocity=...)` on one segment of 10 ms rows."""

    def make(*, gap, current, voltage, velocity=None, segment=None, contact=None, entries=(), period_ms=10):
        n = len(gap)
        segment = np.zeros(n, dtype=np.int32) if segment is None else np.asarray(segment, dtype=np.int32)
        return PointSamples(
            point="F1",
            # A hole of a second between segments.
            t_ns=T0 + np.arange(n) * period_ms * MS + segment.astype(np.int64) * 1000 * MS,
            segment=segment,
            step=np.arange(n, dtype=np.int32),
            values={
                "gap_m": np.asarray(gap, dtype=float),
                "gap_velocity_m_s": np.gradient(gap, period_ms / 1e3) if velocity is None else velocity,
                "current_a": np.asarray(current, dtype=float),
                "voltage_v": np.asarray(voltage, dtype=float),
                "set_point_m": np.full(n, 0.008),
            },
            origins={},
            contact=np.zeros(n, dtype=np.bool_) if contact is None else np.asarray(contact),
            grid_rows=n + sum(len(entry.t_ns) for entry in entries),
            entries=list(entries),
            within={},
            used={},
        )

    return make


@pytest.fixture(scope="session")
def point_codes():
    """Findings of a point by code."""

    def run(point, settings=None):
        return {f.code: f for f in point_findings("a-1", point, Plant(), settings or CheckSettings())}

    return run


@pytest.fixture(scope="session")
def pipelines():
    """Folder of the recipes."""
    return Path(__file__).parents[3] / "pipelines"
