"""A study that takes a second: tiny networks' worth of steps on a few hand-made transitions."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.agents.stage import World
from maglev_offline.control.settings import ControlSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.stage import run_transfer
from maglev_offline.workspace import Manifest, Workspace


@pytest.fixture(scope="session")
def tiny_world():
    training = TrainingSettings(
        algorithms=("ddpg",), seeds=2, block=2, steps=300, exploratory_steps=100, batch_size=16, hidden=(8, 8)
    )
    evaluation = EvaluationSettings(every_steps=50, start_gaps_m=(0.006, 0.015), selection_gaps_m=(0.010,))
    return World(Plant(), Mdp(episode_duration_s=0.1), training, evaluation)


@pytest.fixture(scope="session")
def judged():
    return TransferSettings(first_evaluations=2, last_evaluations=2, resamples=200)


@pytest.fixture(scope="session")
def with_transitions(tiny_world):
    """Make a workspace that holds thirty curated transitions."""

    def make(root):
        rng = np.random.default_rng(0)
        states = ["gap_error_m", "gap_velocity_m_s", "current_error_a"]
        table = pd.DataFrame(rng.normal(0, [0.002, 0.05, 2.0], (30, 3)), columns=states)
        table[[f"next_{name}" for name in states]] = table[states].to_numpy()
        table["voltage_deviation_v"] = rng.uniform(-150, 150, 30)
        table = table.assign(
            cost=0.1, discount=tiny_world.mdp.discount, terminated=False, truncated=False, split="train"
        )
        workspace = Workspace(root)
        manifest = Manifest("transitions", "by hand", {})
        manifest.settings = {name: getattr(tiny_world, name).model_dump(mode="json") for name in ("plant", "mdp")}
        with workspace.commit(workspace.path("transitions"), manifest) as draft:
            table.to_parquet(draft / "transitions.parquet")
        return workspace

    return make


@pytest.fixture(scope="session")
def study_in(tiny_world, judged):
    """Run the study in a workspace, with changes to its training or its judgement."""

    def study(workspace, *, jobs=1, transfer=judged, evaluation=None, **training):
        world = tiny_world._replace(training=tiny_world.training.model_copy(update=training))
        world = world if evaluation is None else world._replace(evaluation=evaluation)
        return run_transfer(workspace, world, transfer, PrefillSettings(), ControlSettings(), jobs=jobs)

    return study


@pytest.fixture(scope="session")
def finished(tmp_path_factory, with_transitions, study_in):
    """The workspace of the finished study, to look at only."""
    workspace = with_transitions(tmp_path_factory.mktemp("study"))
    study_in(workspace)
    return workspace
