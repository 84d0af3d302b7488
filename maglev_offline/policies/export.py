"""Writes a policy in one of the formats, whole or not at all."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from maglev_offline.errors import InputError
from maglev_offline.filesystems import write_whole
from maglev_offline.policies.c_header import as_c_header
from maglev_offline.policies.onnx_model import as_onnx
from maglev_offline.policies.policy import Policy
from maglev_offline.policies.tensors import as_safetensors

Format = Literal["onnx", "c", "safetensors"]

ENDINGS: dict[Format, str] = {"onnx": ".onnx", "c": ".h", "safetensors": ".safetensors"}

_FORMS: dict[Format, Callable[[Policy], bytes]] = {
    "onnx": as_onnx,
    "c": lambda policy: as_c_header(policy).encode("ascii"),
    "safetensors": as_safetensors,
}


def file_name(policy: Policy, form: Format) -> str:
    """Name of a policy's file, such as `td3-empty-seed-0003-best.h`."""
    origin = policy.origin
    return f"{origin.algorithm}-{origin.arm}-seed-{origin.seed:04d}-{origin.which}{ENDINGS[form]}"


def export_policy(policy: Policy, form: Format, path: Path) -> None:
    """Write the policy; it appears under its name only when whole. The same policy gives the same bytes.

    Raises
    ------
    InputError: the file cannot lie there, or a package for this format is missing.
    """
    refuse_folder(path)
    content = _FORMS[form](policy)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)


def refuse_folder(path: Path) -> None:
    """Refuse the path of a folder where a file is to be written.

    Raises
    ------
    InputError: it is one.
    """
    if path.is_dir():
        raise InputError("this is a folder, and --out is a file.", where=str(path), todo="Give the name of a file.")
