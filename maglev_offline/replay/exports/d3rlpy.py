"""One HDF5 file that `d3rlpy.dataset.load_v1` reads.

d3rlpy keeps no next observation: it takes that of the episode's next step. So a row is an episode of two steps, the
second of which holds the next observation and is never learnt from; a terminated row is an episode of one step, whose
next observation d3rlpy takes as zero and multiplies by zero. The flat layout of its version 1 is read a hundred times
faster than that of version 2, which has four data sets for each episode.
"""

from pathlib import Path

import numpy as np

from maglev_offline.replay.exports.hdf5 import need_h5py
from maglev_offline.replay.exports.rows import Form, Rows, refuse_own_discounts

FILE = "prefill.h5"


def write(rows: Rows, folder: Path) -> None:
    """Write `observations` [m, 3], `actions` [m, 1], `rewards`, `terminals`, `episode_terminals` [m], all float32.

    m = 2 n less the terminated rows. The second step repeats action and reward, so that d3rlpy's scalers see their
    distribution unchanged.

    Raises
    ------
    InputError: rows have discounts of their own, or h5py is not installed.
    """
    refuse_own_discounts(rows, "d3rlpy")
    h5py = need_h5py("d3rlpy")
    row = np.repeat(np.arange(len(rows.reward)), np.where(rows.terminated, 1, 2))
    second = np.r_[False, row[1:] == row[:-1]]
    last = np.r_[row[1:] != row[:-1], True]
    with h5py.File(folder / FILE, "w") as file:
        file["observations"] = np.where(second[:, None], rows.next_observation[row], rows.observation[row])
        file["actions"] = rows.action[row]
        file["rewards"] = rows.reward[row]
        file["terminals"] = rows.terminated[row].astype(np.float32)
        file["episode_terminals"] = last.astype(np.float32)
        file.attrs.update(rows.facts)


FORM = Form(
    write,
    "d3rlpy 2.8",
    {
        "observation": "observations, first step of an episode",
        "action": "actions, first step",
        "-cost": "rewards, first step",
        "next_observation": "observations, second step",
        "terminated": "terminals",
        "not terminated": "episode_terminals without terminals",
    },
    f'ReplayBuffer(InfiniteBuffer(), episodes=load_v1(open("{{path}}/{FILE}", "rb"))), all of d3rlpy.dataset',
    ("h5py",),
)
