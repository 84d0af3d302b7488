"""Small worlds for tests of learning: seconds, not minutes."""

import pytest

from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.agents.stage import World
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


@pytest.fixture
def training() -> TrainingSettings:
    return TrainingSettings(
        seeds=3, block=3, steps=120, exploratory_steps=60, batch_size=16, hidden=(8, 8), buffer_capacity=500
    )


@pytest.fixture
def evaluation() -> EvaluationSettings:
    return EvaluationSettings(every_steps=60, start_gaps_m=(0.006, 0.015), selection_gaps_m=(0.010,))


@pytest.fixture
def world(training: TrainingSettings, evaluation: EvaluationSettings) -> World:
    return World(Plant(), Mdp(episode_duration_s=0.1), training, evaluation)
