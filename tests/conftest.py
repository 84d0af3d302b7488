"""Plants that many tests try: the paper's train, and a laboratory levitator with an inductance offset."""

from pathlib import Path

import pytest

from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

PIPELINES = Path(__file__).parents[1] / "pipelines"


@pytest.fixture(scope="session")
def levitator() -> Plant:
    """The levitator as its recipe states it."""
    return load_recipe(PIPELINES / "levitator.toml").plant


@pytest.fixture(params=["train", "levitator"])
def any_plant(request: pytest.FixtureRequest, levitator: Plant) -> Plant:
    """Each of the two plants in turn."""
    return levitator if request.param == "levitator" else Plant()
