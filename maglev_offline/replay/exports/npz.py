"""Arrays under the names of D4RL (Fu et al., 2020), with next observations and a discount for each row."""

from pathlib import Path

import numpy as np

from maglev_offline.replay.exports.rows import Form, Rows

FILE = "prefill.npz"


def write(rows: Rows, folder: Path) -> None:
    """Write `prefill.npz`: `terminals` and `timeouts` [n] are bool, `actions` [n, 1], the rest as in `Rows`."""
    np.savez(
        folder / FILE,
        observations=rows.observation,
        actions=rows.action,
        rewards=rows.reward,
        next_observations=rows.next_observation,
        terminals=rows.terminated,
        timeouts=rows.truncated,
        discounts=rows.discount,
    )


FORM = Form(
    write,
    "numpy",
    {
        "observation": "observations",
        "action": "actions",
        "-cost": "rewards",
        "next_observation": "next_observations",
        "discount": "discounts",
        "terminated": "terminals",
        "not terminated": "timeouts",
    },
    f'numpy.load("{{path}}/{FILE}")',
)
