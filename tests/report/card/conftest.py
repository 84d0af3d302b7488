"""Transitions of two small logs with a rule, a held-out log and a balance, and their card."""

from pathlib import Path

import numpy as np
import pytest

from maglev_offline.curate.rules import Rule
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.curate.stage import curate
from maglev_offline.ingest.shared_content import find_shared_content
from maglev_offline.ingest.store import ingest_logs
from maglev_offline.logs.writer import Messages, MessageType, write_log
from maglev_offline.recipe import Recipe
from maglev_offline.report.card.stage import build_card
from maglev_offline.workspace import Workspace

RULE = Rule(gap_error_m=(-0.0002, -0.0001), cost=(0.0, 1e9))
RECIPE = Recipe(
    name="tiny",
    description="Two runs.",
    curate=CurateSettings(target_rows=100, validation_share=0.5, exclude=(RULE,)),
)
UNITS = {"gap_mm": "mm", "gap_velocity_mm_s": "mm/s", "coil_current_a": "A", "coil_voltage_v": "V"}


def wandering_log(path: Path, seed: int, rows: int = 400) -> Path:
    """A log of one point that says it is simulated: values about the equilibrium, and one message that comes twice."""
    rng = np.random.default_rng(seed)
    steps = np.r_[0:rows, rows - 1]
    values = (np.array([8, 0, 20.9, 25]) + np.array([1, 20, 1, 20]) * rng.standard_normal((rows, 4)).clip(-3, 3))[steps]
    times = 1_704_096_000 * 10**9 + seed * 3600 * 10**9 + steps * 10**8
    messages = Messages(np.zeros(len(steps), dtype=np.int64), times, times, steps, values.round(2))
    metadata = {"maglev-offline surrogate": {"simulated": "true"}}
    topics, kind = ["/suspension/P1/state"], MessageType("maglev/msg/State", UNITS)
    write_log(path, topics, kind, messages, encoding="json", metadata=metadata)
    return path


@pytest.fixture(scope="session")
def recipe() -> Recipe:
    return RECIPE


@pytest.fixture(scope="session")
def carded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The root of a workspace with a card; tests copy it rather than change it."""
    home = tmp_path_factory.mktemp("card")
    workspace = Workspace(home / "workspace")
    logs = [wandering_log(home / f"run-{seed}.mcap", seed) for seed in range(2)]
    ingest_logs(logs, workspace, RECIPE.request)
    find_shared_content(workspace, {folder: workspace.manifest(folder) for folder in workspace.list("samples")})
    curate(workspace, RECIPE.curate, RECIPE.plant, RECIPE.mdp)
    build_card(workspace, RECIPE.name, RECIPE.description)
    return workspace.root
