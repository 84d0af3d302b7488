"""The compiled kernel: where it lies, whether it runs here, and its C interface (`native/kernel.h`) for ctypes.

The package works without it. `MAGLEV_OFFLINE_ISA` names a lower instruction set than the best that the processor has.
"""

import ctypes
import os
from ctypes import c_char_p, c_double, c_int64, c_void_p
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.errors import InputError

SOURCES = Path(__file__).parents[1] / "native"
LIBRARY = SOURCES / "libmaglev_kernel.so"

ISA_VARIABLE = "MAGLEV_OFFLINE_ISA"


def _fields(text: str) -> list[tuple[str, Any]]:
    """Fields of `native/layout.hpp`: lines of names behind their type, `i` for whole numbers and `d` for real ones."""
    kinds = {"i": c_int64, "d": c_double}
    return [
        (name, kinds[kind]) for kind, *names in (line.split() for line in text.strip().splitlines()) for name in names
    ]


class KernelSettings(ctypes.Structure):
    """`maglev::Settings`."""

    _fields_ = _fields("""
        i critics hidden_1 hidden_2 batch_norm_actor layer_norm_critic
        i batch smoothing policy_delay n_step exploratory_steps steps hold
        d actor_learning_rate critic_learning_rate final_learning_rate_fraction target_rate
        d exploration_std smoothing_std smoothing_clip cloning_weight saturation_weight critic_root_offset
        i prefilled room prefill_decay_steps
        d mixing_share
        d mass_kg resistance_ohm gravity_m_s2 inductance_slope_h_m inductance_offset_h pole_offset_m
        d gap_min_m gap_max_m set_point_m equilibrium_current_a equilibrium_voltage_v
        i plant_steps decisions rk4 terminate_on_contact
        d plant_step_s voltage_limit_v cost_gap_per_m2 cost_velocity_s2_per_m2 cost_voltage_per_v2 discount
        d gap_scale_m velocity_scale_m_s current_scale_a start_low_m start_high_m contact_penalty
    """)


class NetLayout(ctypes.Structure):
    """`maglev::Net`: offsets in floats from the start of a network."""

    _fields_ = _fields("""
        i inputs_2 stride_1 stride_2 w1 b1 w2 b2 w3 b3 gain_1 shift_1 gain_2 shift_2 trainable
        i mean_1 var_1 mean_2 var_2 size
    """)


class Layout(ctypes.Structure):
    """`maglev::Layout`: offsets in floats from the start of an arena. Nothing is asked of the scratch from here."""

    _fields_ = [
        ("actor", NetLayout),
        ("critic", NetLayout),
        *_fields("i actor_at slow_actor_at"),
        *[(name, c_int64 * 2) for name in ("critic_at", "slow_critic_at")],
        *_fields("i actor_m actor_v"),
        *[(name, c_int64 * 2) for name in ("critic_m", "critic_v")],
        *_fields("i state_size size"),
        ("scratch", c_int64 * 64),
    ]


class KernelDraws(ctypes.Structure):
    """`MaglevDraws`: where the random numbers of one seed lie."""

    _fields_ = [
        (name, c_void_p) for name in ("start", "exploration", "uniform_action", "batch", "smoothing", "force_n")
    ]


HEAD_WHOLE = ("step", "added", "age", "critic_updates", "actor_updates")
HEAD_REAL = ("gap_m", "velocity_m_s", "current_a", "held_action")
HEAD_WORDS = 16
"""Words of 8 bytes for the whole numbers at the head of an arena, and as many for the real ones behind them."""


class Isa(NamedTuple):
    """An instruction set that the kernel was compiled for."""

    number: int
    name: str
    runs_here: bool


class Kernel:
    """The library with one of its instruction sets; the calls release the interpreter lock."""

    def __init__(self, library: ctypes.CDLL, isa: Isa) -> None:
        self.isa, self._library = isa, library
        self.compiler: str = library.maglev_compiler().decode()

    def layout(self, settings: KernelSettings) -> Layout:
        """Where everything lies in the arena of one seed."""
        layout = Layout()
        self._library.maglev_layout(ctypes.byref(settings), self.isa.number, ctypes.byref(layout))
        return layout

    def advance(
        self,
        settings: KernelSettings,
        arena: NDArray[np.float32],
        prefilled: NDArray[np.float32],
        own: NDArray[np.float32],
        draws: KernelDraws,
        steps: int,
    ) -> None:
        """Make `steps` decisions of one seed."""
        self._library.maglev_advance(
            ctypes.byref(settings), self.isa.number, arena.ctypes.data, prefilled.ctypes.data, own.ctypes.data,
            ctypes.byref(draws), steps,
        )  # fmt: skip

    def roll_out(
        self,
        settings: KernelSettings,
        arena: NDArray[np.float32],
        starts_m: NDArray[np.float64],
        states: NDArray[np.float64],
        voltages_v: NDArray[np.float64],
    ) -> None:
        """Fill the columns [steps + 1, 3, n] and [steps, n], which are views of wider arrays, from the starts [n]."""
        self._library.maglev_roll_out(
            ctypes.byref(settings), self.isa.number, arena.ctypes.data, starts_m.ctypes.data, len(starts_m),
            len(voltages_v), voltages_v.strides[0] // voltages_v.itemsize, states.ctypes.data, voltages_v.ctypes.data,
        )  # fmt: skip


def hash_of_sources(folder: Path) -> str:
    """A hash of the C++ sources; setup.py puts the same into the library."""
    paths = sorted(path for path in folder.iterdir() if path.suffix in (".h", ".hpp", ".cpp"))
    return sha256(b"".join(path.name.encode() + path.read_bytes() for path in paths)).hexdigest()[:16]


@cache
def _library(path: Path) -> ctypes.CDLL | str:
    """The library, or what is in its way."""
    if not path.is_file():
        return "the kernel is not built (no C++ compiler when the package was installed?)"
    try:
        library = ctypes.CDLL(str(path))
        library.maglev_sources.restype = c_char_p
        if library.maglev_sources().decode() != hash_of_sources(SOURCES):
            return "the kernel was built from other sources than those of this package: install it again"
    except (OSError, AttributeError) as error:
        return f"the kernel cannot be loaded: {error}"
    for name in ("maglev_isa_count", "maglev_isa_runs"):
        getattr(library, name).restype = c_int64
    for name in ("maglev_isa_name", "maglev_compiler"):
        getattr(library, name).restype = c_char_p
    for name in ("maglev_isa_name", "maglev_isa_runs"):
        getattr(library, name).argtypes = [c_int64]
    library.maglev_layout.argtypes = [c_void_p, c_int64, c_void_p]
    library.maglev_advance.argtypes = [c_void_p, c_int64, c_void_p, c_void_p, c_void_p, c_void_p, c_int64]
    library.maglev_roll_out.argtypes = [
        c_void_p, c_int64, c_void_p, c_void_p, c_int64, c_int64, c_int64, c_void_p, c_void_p
    ]  # fmt: skip
    for name in ("maglev_layout", "maglev_advance", "maglev_roll_out"):
        getattr(library, name).restype = None
    return library


def isas() -> list[Isa]:
    """The instruction sets of the library, slowest first; none where there is no library."""
    library = _library(LIBRARY)
    if isinstance(library, str):
        return []
    return [
        Isa(k, library.maglev_isa_name(k).decode(), bool(library.maglev_isa_runs(k)))
        for k in range(library.maglev_isa_count())
    ]


def _choice() -> Kernel | str:
    library = _library(LIBRARY)
    if isinstance(library, str):
        return library
    able = [isa for isa in isas() if isa.runs_here]
    wanted = os.environ.get(ISA_VARIABLE, able[-1].name)
    chosen = next((isa for isa in able if isa.name == wanted), None)
    if chosen is None:
        return f"{ISA_VARIABLE} = {wanted}, but this processor has {', '.join(isa.name for isa in able)}"
    return Kernel(library, chosen)


def availability() -> tuple[bool, str]:
    """Whether the native engine can run here, and its instruction set and compiler, or what is in its way."""
    found = _choice()
    return (False, found) if isinstance(found, str) else (True, f"{found.isa.name}, {found.compiler}")


def kernel() -> Kernel:
    """The kernel with the instruction set that is asked for, or the best.

    Raises
    ------
    InputError: there is none.
    """
    found = _choice()
    if isinstance(found, str):
        raise InputError(
            f"the native engine cannot run here: {found}.",
            todo="Take the torch engine, or install the package where a C++ compiler is.",
        )
    return found
