"""Policies as safetensors files: the network as it was trained, and what the policy says about itself."""

import json
from pathlib import Path

import numpy as np

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.policies.policy import Policy, from_metadata, metadata

KEY = "policy"
"""The one key of the metadata: safetensors writes several keys in an order of its own, which changes the bytes."""


def as_safetensors(policy: Policy) -> bytes:
    """The file: tensors named as in `agents/networks.py`, and under `policy` in the metadata a JSON object."""
    from safetensors.numpy import save

    return save(dict(policy.net), metadata={KEY: json.dumps(metadata(policy))})


def load_policy(path: Path) -> Policy:
    """Read a policy that `policy export --format safetensors` wrote.

    Raises
    ------
    InputError: there is no such file.
    ArtefactError: it is no such file, or is damaged.
    """
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise InputError("there is no such policy file.", where=str(path), todo="Give a file of `policy export`.")
    try:
        with safe_open(path, framework="numpy") as file:
            told = json.loads((file.metadata() or {}).get(KEY, "{}"))
            net = {name: np.asarray(file.get_tensor(name)) for name in file.keys()}  # noqa: SIM118 (it is no dict)
    except (OSError, SafetensorError, KeyError, ValueError, RecursionError) as error:
        raise ArtefactError(
            f"it cannot be read as safetensors ({error}).", where=str(path), todo="Export the policy again."
        ) from None
    return from_metadata(net, told if isinstance(told, dict) else {}, str(path))
