"""Plants that many tests try: the paper's train, and a laboratory levitator with an inductance offset."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

settings.register_profile("quick", max_examples=40)
settings.register_profile("thorough", max_examples=400)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))

PIPELINES = Path(__file__).parents[1] / "pipelines"


@pytest.fixture(scope="session")
def levitator() -> Plant:
    """The levitator as its recipe states it."""
    return load_recipe(PIPELINES / "levitator.toml").plant


@pytest.fixture(params=["train", "levitator"])
def any_plant(request: pytest.FixtureRequest, levitator: Plant) -> Plant:
    """Each of the two plants in turn."""
    return levitator if request.param == "levitator" else Plant()
