"""Plants that many tests try: the paper's train, and a laboratory levitator with an inductance offset."""

from pathlib import Path
from typing import Any

import pytest

from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

PIPELINES = Path(__file__).parents[1] / "pipelines"

ONE_WORKSPACE = ("cli", "report")
"""Folders whose tests share a workspace that takes a process longer to make than most of them take."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Side by side, the tests of a file go to one process, and so do those of a folder of `ONE_WORKSPACE`.

    Marks of `xdist_group` would say the same, but pytest-xdist 3.8 loses them under pytest 9.
    """
    from xdist.scheduler import LoadFileScheduling

    class LoadWorkspaceScheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            folder = nodeid.removeprefix("tests/").split("/")[0]
            return folder if folder in ONE_WORKSPACE else super()._split_scope(nodeid)

    return LoadWorkspaceScheduling(config, log)


@pytest.fixture(scope="session")
def levitator() -> Plant:
    """The levitator as its recipe states it."""
    return load_recipe(PIPELINES / "levitator.toml").plant


@pytest.fixture(params=["train", "levitator"])
def any_plant(request: pytest.FixtureRequest, levitator: Plant) -> Plant:
    """Each of the two plants in turn."""
    return levitator if request.param == "levitator" else Plant()
