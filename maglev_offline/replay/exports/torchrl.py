"""A memory-mapped TensorDict: a folder of raw arrays with a `meta.json` in each, and no pickle."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.errors import InputError
from maglev_offline.replay.exports.rows import Form, Rows

FOLDER = "tensordict"


def write(rows: Rows, folder: Path) -> None:
    """Write `tensordict/`: every tensor is [n, 1] or [n, 3], float32 or bool.

    `steps_to_next_obs` [n, 1], int64, is there only where a row spans more than one control period: TorchRL's losses
    raise gamma to it.

    Raises
    ------
    InputError: a row's discount is no whole power of gamma.
    """
    ahead = {
        "observation": rows.next_observation,
        "reward": rows.reward[:, None],
        "done": np.ones((len(rows.reward), 1), dtype=bool),
        "terminated": rows.terminated[:, None],
        "truncated": rows.truncated[:, None],
    }
    now: dict[str, NDArray[Any]] = {"observation": rows.observation, "action": rows.action}
    steps = steps_ahead(rows)
    if (steps != 1).any():
        now["steps_to_next_obs"] = steps[:, None]
    _write_tensors(folder / FOLDER, now, nested=("next",))
    _write_tensors(folder / FOLDER / "next", ahead)


def steps_ahead(rows: Rows) -> NDArray[np.int64]:
    """The power of gamma [n] that is each row's discount; 1 for terminated rows, which have no next value.

    Raises
    ------
    InputError: there is no such whole power.
    """
    gamma = rows.mdp.discount
    discount = np.where(rows.terminated, gamma, rows.discount.astype(float))
    with np.errstate(divide="ignore"):
        exact = np.log(discount) / np.log(gamma)
    steps = np.rint(np.where(np.isfinite(exact), exact, 0)).astype(np.int64)
    bad = (steps < 1) | ~np.isclose(gamma**steps, discount, rtol=1e-4, atol=0)
    if bad.any():
        row = int(bad.argmax())
        raise InputError(
            f"row {row}, of the construction {rows.construction}, has the discount {discount[row]:.6g}, no whole power "
            f"of {gamma:g} ({bad.sum():,} such rows); TorchRL knows no other.",
            where="prefill",
            todo="Use --format npz, which holds any discount, or curate with another --construction.",
        )
    return steps


def _write_tensors(folder: Path, tensors: Mapping[str, NDArray[Any]], nested: tuple[str, ...] = ()) -> None:
    folder.mkdir()
    meta: dict[str, Any] = {
        name: {"device": "cpu", "shape": list(of.shape), "dtype": f"torch.{of.dtype}", "is_nested": False}
        for name, of in tensors.items()
    }
    meta |= {name: {"type": "TensorDict"} for name in nested}
    size = len(next(iter(tensors.values())))
    meta |= {"shape": [size], "device": "cpu", "_type": "<class 'tensordict._td.TensorDict'>"}
    (folder / "meta.json").write_text(json.dumps(meta), encoding="utf-8")
    for name, of in tensors.items():
        np.ascontiguousarray(of).astype(of.dtype.newbyteorder("<")).tofile(folder / f"{name}.memmap")


FORM = Form(
    write,
    "torchrl 0.14, tensordict 0.14",
    {
        "observation": "observation",
        "action": "action",
        "-cost": "next, reward",
        "next_observation": "next, observation",
        "terminated": "next, terminated",
        "not terminated": "next, truncated",
        "discount": "gamma to the power of steps_to_next_obs",
    },
    f'tensordict.TensorDict.load_memmap("{{path}}/{FOLDER}")',
)
