"""A study of five arms whose effects are planted: no training, but the statistics of `transfer` itself."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.rules import Rule
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.streams import stream
from maglev_offline.tables import write_parquet
from maglev_offline.transfer.attribution import Part, attribute
from maglev_offline.transfer.cure import candidates_of, confirmed_cures
from maglev_offline.transfer.foretelling import foretelling
from maglev_offline.transfer.judgement import correct, plain
from maglev_offline.transfer.settings import ArmSettings, TransferSettings
from maglev_offline.transfer.verdict import paired_effect
from maglev_offline.workspace import Manifest

SEEDS, STEPS, BASE = 12, 1_000, 20.0
PLANTED = {
    "ddpg": {"prefill": -4.0, "good": 6.0, "bad": -12.0, "same": 0.0},
    "td3": {"prefill": -4.0, "good": -9.0, "bad": -12.0, "same": 0.0},
}
"""By how much each arm is better than the empty buffer, in the area under the curve."""

ERRORS = {"prefill": 2.0, "good": 0.0, "bad": 5.0, "same": 0.5}
PARTS = [
    Part("logs", "log-1", Rule(log_id=("log <a>",)), 0.6),
    Part("logs", "log-2", Rule(log_id=("log-b",)), 0.4),
    Part("cells", "cell-far-still", Rule(gap_error_m=(0.00125, 1e6), gap_velocity_m_s=(-0.0375, 0.0375)), 0.0412),
    Part("cost_bands", "cost-1-of-4", Rule(cost=(-1e6, 0.0085)), 0.25),
]
WITHOUT = {"log-1": 3.0, "log-2": -3.0, "cell-far-still": 0.0, "cost-1-of-4": 0.0}
"""By how much the prefill is better without a part: the first log harms, the second helps."""


def runs(planted: dict[str, dict[str, float]]) -> pd.DataFrame:
    """The metrics of every run: equal noise in all metrics, a worse arm reaches the threshold later or never."""
    rows = []
    for algorithm, better in planted.items():
        for arm, by in {"empty": 0.0, **better}.items():
            noise = 0.2 * stream(1, f"{algorithm} {arm}").standard_normal(SEEDS)
            area = BASE - by + noise
            rows.append(
                pd.DataFrame(
                    {
                        **{"algorithm": algorithm, "arm": arm, "seed": np.arange(SEEDS)},
                        **{"asymptote": area, "area": area},
                        "time_to_threshold": np.minimum(40 * area, STEPS),
                        "reached": 40 * area < STEPS,
                    }
                )
            )
    return pd.concat(rows, ignore_index=True)


def effects_of(table: pd.DataFrame, settings: TransferSettings) -> dict[str, dict[str, Any]]:
    """The effects of one algorithm on the area, by arm, before Holm's correction; of parts left out only the means."""
    area = table.pivot(index="seed", columns="arm", values="area")
    found = {}
    for arm in (arm for arm in area if arm != "empty"):
        difference = area["empty"] - area[arm]
        effect = {
            "difference": float(difference.mean()),
            "verdict": "negative" if difference.mean() < 0 else "positive",
        }
        if arm in settings.arms:
            judged = paired_effect(
                area["empty"].to_numpy(),
                area[arm].to_numpy(),
                margin=0.5,
                confidence=settings.confidence,
                resamples=settings.resamples,
                rng=stream(0, arm),
            )
            effect = plain(judged._asdict())
        found[arm] = {"area": effect}
    return found


def facts_of(table: pd.DataFrame, settings: TransferSettings, *, parted: bool) -> dict[str, Any]:
    """The facts of a study, as its stage makes them."""
    margins = {"area": 0.5}
    names = list(dict.fromkeys(table["algorithm"]))
    whole = {name: {"effects": effects_of(table[table["algorithm"] == name], settings)} for name in names}
    algorithms: dict[Any, dict[str, Any]] = {}
    for name in names:
        groups = table[table["algorithm"] == name].groupby("arm")["reached"]
        algorithms[name] = {
            "arms": {
                arm: {"seeds": SEEDS, "share_reached": float(groups.get_group(arm).mean())} for arm in settings.arms
            },
            "effects": {arm: effects for arm, effects in whole[name]["effects"].items() if arm in settings.arms},
        }
    correct(algorithms, settings.confidence)
    verdicts = {True: "harmful", False: "fit"}
    rows = {
        arm: {
            "rows_from": "log",
            "rows": 1_234,
            "diagnostic": {
                "error_over_advantage_std": ERRORS.get(arm, 2.1),
                "correlation_with_advantage": 1 - ERRORS.get(arm, 2.1) / 5,
                "verdict": verdicts[ERRORS.get(arm, 2.1) > 1],
            },
        }
        for arm in whole[names[0]]["effects"]
    }
    facts = {
        **{"direction": "costs", "reference_cost": {"lqr_held": 10.0}, "threshold_cost": 15.0},
        **{"primary_metric": "area", "arms": list(settings.arms), "algorithms": algorithms, "rows": rows},
        "foretelling": foretelling(
            rows, whole, "area", 0.95, 200, stream(0, "foretelling"), {arm: arm for arm in rows}
        ),
    }
    if candidates_of(settings):
        facts["cure"] = confirmed_cures(table, candidates_of(settings), settings, margins, names)
    if parted:
        facts["attribution"] = attribute(table, PARTS, "prefill", settings, margins, names)
    return facts


def evidence_of(folder: Path, table: pd.DataFrame, facts: dict[str, Any], settings: TransferSettings) -> Evidence:
    """The study as the report reads it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_parquet(table, folder / "metrics.parquet")
    tables = {"transfer": settings.model_dump(mode="json"), "training": {"steps": STEPS}}
    return Evidence(
        {"transfer": Artefact("transfer", folder, Manifest("transfer", "", {}, facts=facts, settings=tables), "")}
    )


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    """Four arms against the empty buffer, two of them cures, and the four parts of the prefill."""
    settings = TransferSettings(
        arms=("empty", "prefill", "good", "bad", "same"),
        arm={"good": ArmSettings(cure=True), "bad": ArmSettings(cure=True), "same": ArmSettings()},
        resamples=200,
    )
    parts = {f"prefill-without-{part}": by for part, by in WITHOUT.items()}
    planted = {
        name: better | {arm: better["prefill"] + by for arm, by in parts.items()} for name, better in PLANTED.items()
    }
    table = runs(planted)
    return evidence_of(tmp_path_factory.mktemp("study"), table, facts_of(table, settings, parted=True), settings)


@pytest.fixture(scope="session")
def plain_study(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    """The empty buffer and the prefill, and nothing else."""
    settings = TransferSettings(resamples=200)
    table = runs({name: {"prefill": better["prefill"]} for name, better in PLANTED.items()})
    return evidence_of(tmp_path_factory.mktemp("plain"), table, facts_of(table, settings, parted=False), settings)


@pytest.fixture
def with_facts(study: Evidence) -> Callable[..., Evidence]:
    """The study with some of its facts changed."""

    def change(**facts: Any) -> Evidence:
        made = study.artefacts["transfer"]
        manifest = Manifest("transfer", "", {}, facts={**made.facts, **facts}, settings=made.manifest.settings)
        return Evidence({"transfer": Artefact("transfer", made.folder, manifest, "")})

    return change
