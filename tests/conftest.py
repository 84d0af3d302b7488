"""What many tests use: two plants, real recordings, small MCAP files; and which tests share a process."""

import glob
import importlib.util
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from markupsafe import Markup

from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

PIPELINES = Path(__file__).parents[1] / "pipelines"

ONE_WORKSPACE = ("cli", "faults", "report")
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


@pytest.fixture(scope="session")
def levitador() -> Path:
    """Folder of the recorded logs of a laboratory levitator."""
    here = Path(__file__).parents[2] / "shared/data/levitador"
    folder = Path(os.environ.get("MAGLEV_OFFLINE_LEVITADOR", here))
    if not folder.is_dir():
        pytest.skip(f"the recorded levitator logs are not at {folder} (set MAGLEV_OFFLINE_LEVITADOR)")
    return folder


@pytest.fixture(scope="session")
def mcap_files() -> ModuleType:
    """The helper that writes small MCAP files."""
    return load_module(Path(__file__).with_name("logs") / "mcap_files.py")


def load_module(path: Path) -> ModuleType:
    """A module of the tests that is no package's."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], None]]:
    """A reader in an empty folder, who types what a document says: each line has to end with exit code 0.

    All in this process, since to start one takes longer than most commands, and without figures, which are tested where
    they are drawn.
    """
    from maglev_offline import cli
    from maglev_offline.report import stage

    def typed(script: str) -> None:
        for line in script.splitlines():
            name, *words = shlex.split(line)
            assert name == "maglev-offline", line
            sys.argv = [name, *(path for word in words for path in sorted(glob.glob(word)) or [word])]  # noqa: PTH207
            assert cli.run() == 0, line

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("reader"))
        patch.setattr(sys, "argv", [])
        patch.setattr(os, "sched_getaffinity", lambda _: {0})  # no worker processes, which would outlive the test
        patch.delenv("MAGLEV_OFFLINE_WORKSPACE", raising=False)
        patch.setattr(stage, "drawn", lambda plot: Markup('<svg viewBox="0 0 1 1"></svg>'))
        yield typed
