"""Optional event files for TensorBoard: the evaluations of each run as they come."""

import shutil
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.errors import InputError


def require_tensorboard() -> None:
    """Ask for the package before hours of training.

    Raises
    ------
    InputError: it is not installed.
    """
    if find_spec("tensorboard") is None:
        raise InputError(
            "TensorBoard is not installed.",
            where="--tensorboard",
            todo="Run `pip install 'maglev-offline[tensorboard]'`, or leave the option out.",
        )


class EventFiles:
    """One folder of event files for each seed, `<folder>/seed-0007`; closed on leaving.

    They carry the time of day, so they lie beside the artefacts and are none. `from_step`: what was written beyond that
    step, by a run that was stopped and now goes on from there, is taken back; 0 begins anew.
    """

    def __init__(self, folder: Path, seeds: list[int], from_step: int) -> None:
        from torch.utils.tensorboard import SummaryWriter

        if not from_step:
            for seed in seeds:
                shutil.rmtree(folder / f"seed-{seed:04d}", ignore_errors=True)
        purge = from_step + 1 if from_step else None
        self._of: dict[int, Any] = {
            seed: SummaryWriter(str(folder / f"seed-{seed:04d}"), purge_step=purge) for seed in seeds
        }

    def see(self, table: pd.DataFrame) -> None:
        """Write the rows of one evaluation, one for a seed, but for what is no number: a settling time of never."""
        names = [name for name in table if name not in ("seed", "env_step")]
        for row in table.to_dict("records"):
            writer = self._of[int(row["seed"])]
            for name in names:
                if np.isfinite(row[name]):
                    writer.add_scalar(f"evaluation/{name}", float(row[name]), int(row["env_step"]))
            writer.flush()

    def __enter__(self) -> "EventFiles":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for writer in self._of.values():
            writer.close()
