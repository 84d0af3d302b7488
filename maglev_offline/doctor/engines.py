"""What the trial of the engines says: what is there, what is missing, and whether a training can run."""

import os
import shutil
from typing import Any

from maglev_offline.doctor.check import Check
from maglev_offline.doctor.trial import Found, Native, Torch, Trained

ISA_VARIABLE = "MAGLEV_OFFLINE_ISA"
COMPILERS = ("c++", "g++", "clang++")


def engines(found: Found, choice: str) -> list[Check]:
    """All checks of this module; `choice`: the engine that the recipe asks for (auto, native, torch)."""
    return [native(found.native, choice), torch(found.torch), training(found.trained)]


def native(found: Native | str, choice: str) -> Check:
    """The compiled kernel; a problem only where the recipe asks for it, since torch takes its place."""
    seen = found if isinstance(found, Native) else Native(False, found, None, None, [])
    facts: dict[str, Any] = {
        "here": seen.here,
        "instruction_set": seen.isa,
        "compiler": seen.compiler,
        "instruction_sets": dict(seen.isas),
    }
    if seen.here:
        best = [name for name, runs in seen.isas if runs][-1:]
        what = f"{seen.isa} (built for {', '.join(name for name, _ in seen.isas)}; {seen.compiler})"
        if best and best != [seen.isa]:
            todo = f"Unset {ISA_VARIABLE} for {best[0]}, which is faster."
            return Check("native", "native engine", "note", f"{what}; {ISA_VARIABLE} asks for {seen.isa}", todo, facts)
        return Check("native", "native engine", "ok", what, "", facts)
    if choice == "native":
        what = f"{seen.why}; the recipe asks for it ([training] engine)"
        return Check("native", "native engine", "problem", what, f"{_remedy()} Or take engine = 'auto'.", facts)
    what = f"{seen.why}. Trainings take the torch engine, which is many times slower"
    return Check("native", "native engine", "note", what, _remedy(), facts)


def _remedy() -> str:
    """What gets the kernel: mostly a compiler."""
    if ISA_VARIABLE in os.environ:
        return f"Unset {ISA_VARIABLE}."
    again = "install the package again: pip install --force-reinstall --no-deps, with what you installed it from."
    if any(map(shutil.which, COMPILERS)):
        return f"A C++ compiler is here: {again}"
    return f"Install a C++ compiler (Debian: apt install g++; macOS: xcode-select --install), and {again}"


def torch(found: Torch | str) -> Check:
    """PyTorch as it loads; CUDA is not needed."""
    facts: dict[str, Any] = {"version": None, "threads": None, "cuda_device": None}
    if isinstance(found, str):
        return Check(
            "torch", "PyTorch", "problem", found, "Install it again: pip install --force-reinstall torch", facts
        )
    facts = {"version": found.version, "threads": found.threads, "cuda_device": found.device}
    device = f"CUDA on {found.device}" if found.device else "no CUDA"
    what = f"{found.version}, threads: {found.threads}, {device} (trainings run on the processor)"
    return Check("torch", "PyTorch", "ok", what, "", facts)


def training(found: Trained | str) -> Check:
    """A few trained steps."""
    facts: dict[str, Any] = {"engine": None, "seconds": None}
    if isinstance(found, str):
        todo = "Mend what is above. Where nothing is: try --engine torch, and report it."
        return Check("training", "a short training", "problem", found, todo, facts)
    facts = {"engine": found.engine, "seconds": found.seconds}
    what = f"40 steps of TD3 in {found.seconds:.2f} s with the engine {found.engine}: {found.why}"
    return Check("training", "a short training", "ok", what, "", facts)
