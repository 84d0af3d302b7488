import importlib.util
from pathlib import Path

import pytest


def _load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def containers():
    """The helper that writes MCAP files with known messages, and reads them span by span."""
    return _load(Path(__file__).with_name("containers.py"))
