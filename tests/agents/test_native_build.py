"""The package with and without its compiled kernel."""

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from maglev_offline.agents import native_library
from maglev_offline.agents.native import NativeLearner, availability
from maglev_offline.agents.native_library import (
    ISA_VARIABLE,
    LIBRARY,
    Kernel,
    KernelSettings,
    Layout,
    hash_of_sources,
    isas,
)
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.errors import InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

ROOT = Path(__file__).parents[2]

needs_kernel = pytest.mark.skipif(not availability()[0], reason=availability()[1])


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """What setup.py needs of the source tree, in a folder of its own."""
    folder = tmp_path_factory.mktemp("tree")
    shutil.copy(ROOT / "setup.py", folder)
    (folder / "pyproject.toml").write_text('[project]\nname = "maglev-offline"\nversion = "0"\n')
    package = folder / "maglev_offline" / "native"
    shutil.copytree(ROOT / "maglev_offline" / "native", package, ignore=shutil.ignore_patterns("*.so"))
    (folder / "maglev_offline" / "__init__.py").touch()
    return folder


def build(folder, **environment):
    return subprocess.run(
        [sys.executable, "setup.py", "build_ext", "--inplace"],
        cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def test_without_a_library_the_reason_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(native_library, "LIBRARY", tmp_path / "none.so")
    assert availability() == (False, "the kernel is not built (no C++ compiler when the package was installed?)")
    assert isas() == []
    with pytest.raises(InputError, match=r"not built.*torch engine"):
        NativeLearner("td3", [0], Plant(), Mdp(), TrainingSettings())


def test_a_library_that_is_none_is_not_taken(monkeypatch, tmp_path):
    (tmp_path / "broken.so").write_bytes(b"no library")
    monkeypatch.setattr(native_library, "LIBRARY", tmp_path / "broken.so")
    able, reason = availability()
    assert not able
    assert reason.startswith("the kernel cannot be loaded")


@needs_kernel
def test_a_library_of_other_sources_is_not_taken(monkeypatch, tmp_path):
    for path in (*native_library.SOURCES.glob("*.*pp"), *native_library.SOURCES.glob("*.h")):
        shutil.copy(path, tmp_path)
    shutil.copy(LIBRARY, tmp_path)
    monkeypatch.setattr(native_library, "SOURCES", tmp_path)
    monkeypatch.setattr(native_library, "LIBRARY", tmp_path / LIBRARY.name)
    assert availability()[0]
    shutil.copy(LIBRARY, tmp_path / "again.so")
    monkeypatch.setattr(native_library, "LIBRARY", tmp_path / "again.so")
    (tmp_path / "layout.hpp").write_text("// changed\n")
    able, reason = availability()
    assert not able
    assert "other sources" in reason


@needs_kernel
def test_the_reason_names_instruction_set_and_compiler():
    able, what = availability()
    assert able
    assert what.split(",")[0] in [isa.name for isa in isas()]
    assert "gcc" in what or "clang" in what


@needs_kernel
def test_a_lower_instruction_set_can_be_asked_for_and_an_unknown_one_is_refused(monkeypatch):
    for isa in isas():
        monkeypatch.setenv(ISA_VARIABLE, isa.name)
        able, what = availability()
        assert able == isa.runs_here
        assert isa.name in what
    monkeypatch.setenv(ISA_VARIABLE, "mmx")
    able, reason = availability()
    assert not able
    assert f"{ISA_VARIABLE} = mmx" in reason


@needs_kernel
def test_the_layout_that_the_library_fills_is_the_one_that_is_read_here():
    """A field too few on one side would shift all that follow."""
    settings = KernelSettings(critics=2, hidden_1=40, hidden_2=30, batch=100, batch_norm_actor=1)
    layout = native_library.kernel().layout(settings)
    assert isinstance(layout, Layout)
    assert layout.critic.inputs_2 == 41
    assert layout.actor.stride_1 >= 40
    assert layout.actor.mean_1 == layout.actor.trainable
    assert layout.state_size < layout.size
    assert all(offset % 16 == 0 for offset in (layout.actor_at, *layout.critic_v, layout.state_size, layout.size))


@pytest.mark.skipif(shutil.which("c++") is None and shutil.which("g++") is None, reason="needs a C++ compiler")
def test_setup_has_built_the_library_in_place():
    """By `make setup`: to build it once more would take half a minute and show the same."""
    built = ctypes.CDLL(str(LIBRARY))
    built.maglev_sources.restype = ctypes.c_char_p
    assert built.maglev_sources().decode() == hash_of_sources(ROOT / "maglev_offline" / "native")


def test_setup_does_without_a_compiler(tree):
    shutil.rmtree(tree / "build", ignore_errors=True)
    done = build(tree, CXX="/nonexistent/c++", CC="/nonexistent/cc")
    assert done.returncode == 0, done.stderr
    assert "libmaglev_kernel" in done.stderr + done.stdout
    assert not (tree / "maglev_offline" / "native" / LIBRARY.name).exists()


@pytest.fixture(scope="module")
def sixteen_lanes(tmp_path_factory):
    """The kernel with its AVX-512 source compiled for AVX2: another processor, the same arithmetic."""
    folder, sources = tmp_path_factory.mktemp("lanes"), native_library.SOURCES
    flags = ["-std=c++17", "-O1", "-fPIC", "-Wno-psabi", "-ffp-contract=fast", "-mavx2", "-mfma", "-DMAGLEV_X86"]
    flags.append(f'-DMAGLEV_SOURCES="{hash_of_sources(sources)}"')
    library = folder / LIBRARY.name
    paths = [str(path) for path in sorted(sources.glob("*.cpp"))]
    subprocess.run(["c++", *flags, "-shared", *paths, "-o", str(library)], check=True, timeout=300)
    return library


@pytest.mark.nightly
@needs_kernel
@pytest.mark.skipif(
    shutil.which("c++") is None or "avx2" not in [isa.name for isa in isas() if isa.runs_here],
    reason="needs a C++ compiler and a processor with AVX2",
)
@pytest.mark.parametrize("changes", [{}, {"hidden": (13, 50), "batch_norm_actor": True, "saturation_weight": 0.0}])
def test_sixteen_lanes_compute_the_bits_of_eight(sixteen_lanes, monkeypatch, changes):
    library = native_library._library(sixteen_lanes)
    numbers = {isa.name: isa for isa in isas()}
    states = []
    for name in ("avx2", "avx512"):
        kernel = Kernel(library, numbers[name])
        monkeypatch.setattr(native_library, "_choice", lambda kernel=kernel: kernel)
        training = TrainingSettings(steps=400, exploratory_steps=60, **changes)
        learner = NativeLearner("td3", [0], Plant(), Mdp(episode_duration_s=0.1), training)
        learner.advance(160)
        states.append({**learner.state(), "gap_m": learner.responses(np.linspace(0.004, 0.015, 21)).gap_m})
    for name, value in states[0].items():
        np.testing.assert_array_equal(value, states[1][name], err_msg=name)


def test_no_flag_makes_numbers_vanish():
    """-ffast-math would flush tiny numbers to zero in the whole process; NaN must stay NaN."""
    text = (ROOT / "setup.py").read_text()
    flags = [word for word in text.replace('"', " ").split() if word.startswith("-f")]
    assert flags
    assert not {"-ffast-math", "-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations"} & set(flags)
    assert np.float32(1e-40) * np.float32(1.0) > 0
