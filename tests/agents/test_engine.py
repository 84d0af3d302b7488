import sys

import pytest

from maglev_offline.agents import engine as engines
from maglev_offline.agents.engine import choose_engine, native_availability, provenance
from maglev_offline.errors import InputError


@pytest.fixture
def native(monkeypatch):
    """Say whether the native engine can run here."""
    return lambda able, reason: monkeypatch.setattr(engines, "native_availability", lambda: (able, reason))


def test_auto_takes_the_native_engine_where_it_runs_and_says_so(native):
    native(True, "avx2")
    assert choose_engine("auto") == ("native", "it is the faster one (avx2)")


def test_auto_takes_torch_where_there_is_no_kernel_and_says_why(native):
    native(False, "the kernel is not built")
    assert choose_engine("auto") == ("torch", "the native one cannot run here: the kernel is not built")


@pytest.mark.parametrize("able", [True, False])
def test_torch_is_taken_when_asked_for_whatever_else_there_is(native, able):
    native(able, "")
    assert choose_engine("torch") == ("torch", "it was asked for")


def test_the_native_engine_is_not_replaced_in_silence(native):
    native(False, "the kernel is not built")
    with pytest.raises(InputError, match=r"--engine native: .*the kernel is not built.*Take --engine torch"):
        choose_engine("native")


def test_an_installation_without_the_native_module_is_one_without_the_engine(monkeypatch):
    monkeypatch.setitem(sys.modules, "maglev_offline.agents.native_library", None)
    assert native_availability() == (False, "it is not part of this installation")


def test_every_engine_names_its_instructions_and_its_compiler(engine):
    found = provenance(engine)
    assert set(found) == {"instruction_set", "compiler"}
    assert all(found.values())
