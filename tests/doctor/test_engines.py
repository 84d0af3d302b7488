import shutil

import pytest

from maglev_offline.agents import native_library
from maglev_offline.doctor.engines import ISA_VARIABLE, engines, native, torch, training
from maglev_offline.doctor.trial import Found, Native, Torch, Trained

SETS = [("sse2", True), ("avx2", True), ("avx512", False)]
NATIVE = Native(True, "avx2, gcc 12.2.0", "avx2", "gcc 12.2.0", SETS)
MISSING = Native(False, "the kernel is not built", None, None, [])
TORCH = Torch("2.13.0+cpu", 2, None)
TRAINED = Trained("native", "it is the faster one", 0.04)


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.delenv(ISA_VARIABLE, raising=False)


def test_all_is_well_where_all_is_there():
    checks = engines(Found(NATIVE, TORCH, TRAINED), "auto")
    assert [check.state for check in checks] == ["ok"] * 3
    assert checks[0].what == "avx2 (built for sse2, avx2, avx512; gcc 12.2.0)"
    assert checks[0].facts["instruction_sets"] == {"sse2": True, "avx2": True, "avx512": False}


@pytest.mark.parametrize(("choice", "state"), [("auto", "note"), ("torch", "note"), ("native", "problem")])
def test_a_missing_kernel_is_a_problem_only_where_the_recipe_asks_for_it(choice, state):
    check = native(MISSING, choice)
    assert (check.state, check.facts["here"]) == (state, False)
    assert "not built" in check.what


@pytest.mark.parametrize(
    ("compiler", "words"), [("/usr/bin/g++", "A C++ compiler is here"), (None, "Install a C++ compiler")]
)
def test_the_way_to_the_kernel_depends_on_whether_there_is_a_compiler(monkeypatch, compiler, words):
    monkeypatch.setattr(shutil, "which", lambda name: compiler)
    assert native(MISSING, "auto").todo.startswith(words)


def test_an_instruction_set_that_was_asked_for_and_is_not_the_best_is_noted(monkeypatch):
    assert ISA_VARIABLE == native_library.ISA_VARIABLE
    monkeypatch.setenv(ISA_VARIABLE, "sse2")
    slow = native(NATIVE._replace(isa="sse2"), "auto")
    assert (slow.state, slow.todo) == ("note", f"Unset {ISA_VARIABLE} for avx2, which is faster.")
    assert native(MISSING, "auto").todo == f"Unset {ISA_VARIABLE}."


def test_a_torch_that_does_not_load_is_a_problem_and_one_without_cuda_is_none():
    assert torch("libgomp.so.1: cannot open shared object file").state == "problem"
    assert (torch(TORCH).state, torch(TORCH).facts["cuda_device"]) == ("ok", None)
    assert "CUDA on X" in torch(TORCH._replace(device="X")).what


def test_a_training_that_fails_is_a_problem():
    check = training("it learned nothing.")
    assert (check.state, check.what, check.facts) == (
        "problem",
        "it learned nothing.",
        {"engine": None, "seconds": None},
    )


@pytest.mark.parametrize("found", [Found(NATIVE, TORCH, TRAINED), Found("it crashed", "not tried", "not tried")])
def test_the_facts_have_the_same_keys_whatever_was_found(found):
    keys = [set(check.facts) for check in engines(found, "auto")]
    assert keys == [
        {"here", "instruction_set", "compiler", "instruction_sets"},
        {"version", "threads", "cuda_device"},
        {"engine", "seconds"},
    ]
