"""Stable-Baselines3: one safetensors file, and the functions that put it into a replay buffer.

SB3's own `load_replay_buffer` reads a pickle, which may run anything. So rows go into the buffer of a model that was
made already. SB3 need not be installed to write the file, nor is it imported here.
"""

import json
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.replay.checks import refuse_not_finite, refuse_small_capacity, refuse_wide_actions
from maglev_offline.replay.exports.rows import Form, Rows, refuse_own_discounts

FILE = "replay_buffer.safetensors"

_WIDTHS = {"observations": 3, "next_observations": 3, "actions": 1, "rewards": None, "terminations": None}


class Buffer(Protocol):
    """What is used of `stable_baselines3.common.buffers.ReplayBuffer`."""

    observations: NDArray[Any]
    next_observations: NDArray[Any]
    actions: NDArray[Any]
    rewards: NDArray[Any]
    dones: NDArray[Any]
    timeouts: NDArray[Any]
    action_space: Any
    observation_space: Any
    buffer_size: int
    n_envs: int
    pos: int
    full: bool
    optimize_memory_usage: bool
    handle_timeout_termination: bool


class Model(Protocol):
    """What is used of an off-policy algorithm of Stable-Baselines3."""

    gamma: float
    replay_buffer: Any

    def get_env(self) -> Any: ...  # noqa: D102 (SB3's)
    def get_vec_normalize_env(self) -> Any: ...  # noqa: D102 (SB3's)


def write(rows: Rows, folder: Path) -> None:
    """Write `observations`, `next_observations` [n, 3], `actions` [n, 1], `rewards` [n], float32, `terminations` [n].

    Raises
    ------
    InputError: rows have discounts of their own.
    """
    refuse_own_discounts(rows, "Stable-Baselines3")
    columns = {
        "observations": rows.observation,
        "next_observations": rows.next_observation,
        "actions": rows.action,
        "rewards": rows.reward,
        "terminations": rows.terminated,
    }
    save_file(columns, folder / FILE, {"sb3": json.dumps(rows.facts, sort_keys=True)})


def fill_model(model: Model, path: Path | str) -> int:
    """Fill the empty buffer of a model (DDPG, TD3, SAC) from `path`; returns the rows.

    Raises
    ------
    ArtefactError, InputError: as `fill`; or the model discounts otherwise, normalises what is scaled already, or has an
        environment of ours with other scales.
    """
    _, facts = read(path)
    if not np.isclose(model.gamma, facts["gamma"], rtol=1e-6, atol=0):
        raise InputError(
            f"the model has gamma = {model.gamma:g}, and the rows were made for {facts['gamma']:g}.",
            where=str(path),
            todo=f"Make the model with gamma={facts['gamma']:g}.",
        )
    if model.get_vec_normalize_env() is not None:
        raise InputError(
            "the model's environment is in a VecNormalize, which would scale twice: observations are over the "
            "recipe's scales already.",
            where=str(path),
            todo="Make the model without VecNormalize.",
        )
    _refuse_other_scales(model.get_env(), facts, str(path))
    return fill(model.replay_buffer, path)


def fill(buffer: Buffer, path: Path | str) -> int:
    """Put the rows into the first slots of an empty buffer, in order; returns how many.

    Rows do not follow one another, so each is done: by a time-out, after which SB3 bootstraps, unless it is terminated.
    A buffer that does not handle time-outs has only the terminated ones as done. Once it is full, SB3 overwrites the
    prefilled rows first.

    Raises
    ------
    ArtefactError: there is no such file, or it is damaged.
    InputError: the buffer has too few slots, holds rows already, or is of another kind; or a row cannot be used.
    """
    columns, _ = read(path)
    rows = len(columns["rewards"])
    _refuse_buffer(buffer, str(path))
    refuse_small_capacity(rows, buffer.buffer_size, str(path))
    buffer.observations[:rows, 0] = columns["observations"]
    buffer.next_observations[:rows, 0] = columns["next_observations"]
    buffer.actions[:rows, 0] = columns["actions"]
    buffer.rewards[:rows, 0] = columns["rewards"]
    terminated = columns["terminations"]
    buffer.dones[:rows, 0] = True if buffer.handle_timeout_termination else terminated
    buffer.timeouts[:rows, 0] = ~terminated if buffer.handle_timeout_termination else False
    buffer.pos = rows
    return rows


def read(path: Path | str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Columns and facts of an export, given its folder or its file.

    Raises
    ------
    ArtefactError: there is no such file, or it is damaged or of another form.
    InputError: a value is not finite, or an action lies outside [-1, 1].
    """
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    todo = "Run `maglev-offline prefill --format sb3` and give the folder that it prints."
    try:
        with safe_open(file, framework="numpy") as opened:
            facts = _facts(json.loads((opened.metadata() or {})["sb3"]))
            columns = {name: opened.get_tensor(name) for name in _WIDTHS}
    except (OSError, SafetensorError, KeyError, ValueError, TypeError, RecursionError) as error:
        raise ArtefactError(
            f"this is no prefill for Stable-Baselines3 ({error}).", where=str(file), todo=todo
        ) from None
    count = len(columns["rewards"]) if columns["rewards"].ndim else -1
    for name, width in _WIDTHS.items():
        kind = np.bool_ if name == "terminations" else np.float32
        if columns[name].dtype != kind:
            raise ArtefactError(f"{name} is of the kind {columns[name].dtype}.", where=str(file), todo=todo)
        if columns[name].shape != ((count,) if width is None else (count, width)):
            raise ArtefactError(f"{name} has the shape {columns[name].shape}.", where=str(file), todo=todo)
    refuse_not_finite(columns, str(file))
    refuse_wide_actions(columns["actions"], str(file))
    return columns, facts


def _facts(told: Any) -> dict[str, Any]:
    """What the file says of its rows; ValueError, TypeError or KeyError where it is not what `write` says."""
    numbers = ("gamma", "gap_scale_m", "velocity_scale_m_s", "current_scale_a", "voltage_limit_v", "control_period_ms")
    facts: dict[str, Any] = told | {name: float(told[name]) for name in numbers}
    return facts


def _refuse_buffer(buffer: Buffer, where: str) -> None:
    space, low, high = buffer.observation_space, buffer.action_space.low, buffer.action_space.high
    why, todo = "", ""
    if buffer.pos or buffer.full:
        why, todo = "the buffer holds rows already.", "Fill it before the model learns."
    elif buffer.n_envs != 1:
        why, todo = f"the buffer is of {buffer.n_envs} environments.", "Make the model with one environment."
    elif buffer.optimize_memory_usage:
        why, todo = "the buffer keeps no next observations.", "Make it with optimize_memory_usage=False."
    elif space.shape != (3,) or buffer.action_space.shape != (1,):
        why = f"observations {space.shape} and actions {buffer.action_space.shape} are not (3,) and (1,)."
        todo = 'Use the environment "maglev_offline/Suspension-v0".'
    elif not (low == -1).all() or not (high == 1).all():
        why = f"actions of the buffer lie in [{low[0]:g}, {high[0]:g}], and those of the rows in [-1, 1]."
        todo = "Scale the environment's actions to [-1, 1], as gymnasium.wrappers.RescaleAction does."
    if why:
        raise InputError(why, where=where, todo=todo)


def _refuse_other_scales(env: Any, facts: dict[str, Any], where: str) -> None:
    """An environment of ours says what it scales by; others cannot be asked."""
    try:
        process = env.get_attr("batch")[0].mdp
    except AttributeError:
        return
    for name in ("gap_scale_m", "velocity_scale_m_s", "current_scale_a", "voltage_limit_v", "control_period_ms"):
        if getattr(process, name) != facts[name]:
            raise InputError(
                f"the environment has {name} = {getattr(process, name):g}, and the rows {facts[name]:g}.",
                where=where,
                todo="Make the environment with the recipe that the rows were made with.",
            )


FORM = Form(
    write,
    "stable-baselines3 2.9",
    {
        "observation": "observations",
        "action": "actions",
        "-cost": "rewards",
        "next_observation": "next_observations",
        "terminated": "terminations; in the buffer: dones without timeouts",
        "not terminated": "in the buffer: dones with timeouts",
    },
    'maglev_offline.replay.exports.sb3.fill_model(model, "{path}")',
)
