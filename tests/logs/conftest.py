import importlib.util
import os
from pathlib import Path

import pytest


def _load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def mcap_files():
    """The helper that writes small MCAP files."""
    return _load(Path(__file__).with_name("mcap_files.py"))


@pytest.fixture(scope="session")
def containers():
    """The helper that writes MCAP files with known messages, and reads them span by span."""
    return _load(Path(__file__).with_name("containers.py"))


@pytest.fixture(scope="session")
def levitador():
    """Folder of the recorded logs of a laboratory levitator."""
    here = Path(__file__).parents[3] / "shared/data/levitador"
    folder = Path(os.environ.get("MAGLEV_OFFLINE_LEVITADOR", here))
    if not folder.is_dir():
        pytest.skip(f"the recorded levitator logs are not at {folder} (set MAGLEV_OFFLINE_LEVITADOR)")
    return folder
