"""One process that forks commands, and one road, for all tests of faults."""

import importlib.util
import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def harness():
    """The module of the harness."""
    path = Path(__file__).with_name("harness.py")
    spec = importlib.util.spec_from_file_location("faults_harness", path)
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def nursery(harness, tmp_path_factory):
    made = harness.Nursery(tmp_path_factory.mktemp("said"))
    yield made
    made.close()


@pytest.fixture(scope="session")
def road(harness, nursery, tmp_path_factory):
    return harness.Road(tmp_path_factory.mktemp("road"), nursery)


@pytest.fixture(scope="session")
def count():
    """Faults of each kind and command in the long tests: `make faults FAULTS=200`."""
    return int(os.environ.get("FAULTS", "20"))
