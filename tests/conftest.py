"""Plants that many tests try: the paper's train, and a laboratory levitator with an inductance offset."""

from pathlib import Path

import pytest

from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

TESTS = Path(__file__).parent
PIPELINES = TESTS.parent / "pipelines"

ONE_WORKSPACE = ("cli", "report")
"""Folders whose tests share a workspace that takes a process longer to make than most of them take."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Side by side, the tests of a file go to one process, and so do those of a folder of `ONE_WORKSPACE`."""
    for item in items:
        path = item.path.relative_to(TESTS)
        group = path.parts[0] if path.parts[0] in ONE_WORKSPACE else path.as_posix()
        item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture(scope="session")
def levitator() -> Plant:
    """The levitator as its recipe states it."""
    return load_recipe(PIPELINES / "levitator.toml").plant


@pytest.fixture(params=["train", "levitator"])
def any_plant(request: pytest.FixtureRequest, levitator: Plant) -> Plant:
    """Each of the two plants in turn."""
    return levitator if request.param == "levitator" else Plant()
