"""A Minari data set (HDF5 storage) of one-step episodes, which keep both observations, terminated or not."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from maglev_offline import __version__
from maglev_offline.replay.exports.hdf5 import need_h5py
from maglev_offline.replay.exports.rows import Form, Rows, refuse_own_discounts

DATASET_ID = "maglev-offline/prefill-v0"
_LAYOUT = "0.5.3"
"""Version of Minari whose layout this is; it refuses data sets of versions that it does not know."""


def write(rows: Rows, folder: Path) -> None:
    """Write `maglev-offline/prefill-v0/data/`, so that `folder` is a MINARI_DATASETS_PATH.

    Raises
    ------
    InputError: rows have discounts of their own, or h5py is not installed.
    """
    refuse_own_discounts(rows, "Minari")
    h5py = need_h5py("minari")
    data = folder / DATASET_ID / "data"
    data.mkdir(parents=True)
    with h5py.File(data / "main_data.hdf5", "w") as file:
        _write_episodes(h5py, file, rows)
    size = (data / "main_data.hdf5").stat().st_size
    text = json.dumps(_metadata(rows, size), indent=2, sort_keys=True, allow_nan=False)
    (data / "metadata.json").write_text(f"{text}\n", encoding="utf-8")


def _write_episodes(h5py: Any, file: Any, rows: Rows) -> None:
    """One group a row. By the low-level calls, with types and spaces made once: 60,000 objects for 10,000 rows."""
    seen = np.stack([rows.observation, rows.next_observation], axis=1)
    columns = {
        "observations": seen,
        "actions": rows.action[:, None],
        "rewards": rows.reward[:, None],
        "terminations": rows.terminated[:, None],
        "truncations": rows.truncated[:, None],
    }
    form = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    form.set_layout(h5py.h5d.COMPACT)
    form.set_obj_track_times(False)
    kinds = {
        name: (name.encode(), h5py.h5t.py_create(of.dtype, logical=True), h5py.h5s.create_simple(of.shape[1:]))
        for name, of in columns.items()
    }
    for row in range(len(rows.reward)):
        group = file.create_group(f"episode_{row}")
        group.attrs["id"], group.attrs["total_steps"] = row, 1
        for name, (key, kind, space) in kinds.items():
            made = h5py.h5d.create(group.id, key, kind, space, form)
            made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(columns[name][row]))


def _metadata(rows: Rows, size: int) -> dict[str, Any]:
    """No `env_spec`: an environment with another plant or recipe than the rows' would come out of it."""
    return {
        "dataset_id": DATASET_ID,
        "minari_version": _LAYOUT,
        "data_format": "hdf5",
        "jpeg_encoding": False,
        "total_episodes": len(rows.reward),
        "total_steps": len(rows.reward),
        "dataset_size": round(size / 1e6, 1),
        "observation_space": _box(3, np.inf),
        "action_space": _box(1, 1.0),
        "algorithm_name": "PID",
        "description": "Logged rows of a suspension, one episode each; rewards are minus costs.",
        "maglev_offline_version": __version__,
        **rows.facts,
    }


def _box(size: int, bound: float) -> str:
    shape = {"type": "Box", "dtype": "float32", "shape": [size], "low": [-bound] * size, "high": [bound] * size}
    return json.dumps(shape)


FORM = Form(
    write,
    "minari 0.5",
    {
        "observation": "observations[0]",
        "action": "actions[0]",
        "-cost": "rewards[0]",
        "next_observation": "observations[1]",
        "terminated": "terminations[0]",
        "not terminated": "truncations[0]",
    },
    f'minari.load_dataset("{DATASET_ID}") with MINARI_DATASETS_PATH={{path}}',
    ("h5py",),
)
