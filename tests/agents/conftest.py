"""Small worlds for tests of learning: seconds, not minutes."""

import numpy as np
import pytest

from maglev_offline.agents.engine import native_availability
from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.agents.stage import World
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import Silent
from maglev_offline.replay.buffer import WIDTH


@pytest.fixture(params=["torch", "native"])
def engine(request: pytest.FixtureRequest) -> str:
    """Each engine that can run here."""
    able, reason = native_availability()
    if request.param == "native" and not able:
        pytest.skip(reason)
    return str(request.param)


@pytest.fixture
def training() -> TrainingSettings:
    return TrainingSettings(
        seeds=3, block=3, steps=120, exploratory_steps=60, batch_size=16, hidden=(8, 8), buffer_capacity=500,
        engine="torch",
    )  # fmt: skip


@pytest.fixture
def evaluation() -> EvaluationSettings:
    return EvaluationSettings(every_steps=60, start_gaps_m=(0.006, 0.015), selection_gaps_m=(0.010,))


@pytest.fixture
def world(training: TrainingSettings, evaluation: EvaluationSettings) -> World:
    return World(Plant(), Mdp(episode_duration_s=0.1), training, evaluation)


@pytest.fixture
def prefilled_rows() -> np.ndarray:
    """Forty packed rows that no log ever held."""
    rng = np.random.default_rng(1)
    packed = rng.normal(size=(40, WIDTH)).astype(np.float32)
    packed[:, 3] = rng.uniform(-1, 1, 40)
    packed[:, 8:] = 0.9, 1.0
    return packed


class Heard(Silent):
    """Listens to everything, and remembers it."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.warned: list[str] = []
        self.total = self.done = 0

    def say(self, text):
        self.said.append(text)

    def warn(self, text):
        self.warned.append(text)

    def task(self, title, total, unit):
        self.total = total
        return self

    def __enter__(self):
        return self.tick

    def __exit__(self, *exc):
        return None

    def tick(self, done):
        self.done += done


@pytest.fixture
def heard() -> Heard:
    return Heard()
