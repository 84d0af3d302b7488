"""Rollouts of controllers in the simulator, as MCAP logs in the shape of the surrogate logs: to be seen beside them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from maglev_offline import __version__
from maglev_offline.control.feedback import Controller
from maglev_offline.control.metrics import response_metrics
from maglev_offline.control.reference import classical_controllers, period_s
from maglev_offline.control.settings import ControllerName, ControlSettings
from maglev_offline.control.simulate import Trajectory, regulate
from maglev_offline.errors import InputError
from maglev_offline.logs.surrogate_recorder import STATE_MESSAGE
from maglev_offline.logs.writer import Encoding, Messages, write_log
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.policy import Policy, metadata

Array = NDArray[np.float64]

DRIVERS: tuple[str, ...] = ("policy", *get_args(ControllerName))
"""Who can hold the magnet: a trained policy, or a classical controller."""

METADATA_NAME = "maglev-offline rollout"
POLICY_METADATA_NAME = "maglev-offline policy"

START_NS = 1_704_096_000 * 10**9
"""2024-01-01 08:00 UTC, where the first surrogate log begins: there is no wall-clock in a simulation."""


class Scene(NamedTuple):
    """What is simulated: the plant that moves, the process that judges, and the settings of the controllers."""

    plant: Plant
    mdp: Mdp
    control: ControlSettings


@dataclass(frozen=True)
class PolicyController:
    """A policy at the controller's place. It keeps to its own set-point; deviations are from that of `plant`."""

    policy: Policy
    plant: Plant

    def start(self, z: Array) -> None:
        """A policy has no memory."""

    def control(self, z: Array, memory: None, dt_s: float) -> tuple[Array, None]:  # noqa: ARG002
        """Voltage deviation v [n] for the deviations z [n, 3]."""
        point = self.plant.equilibrium()
        voltage = self.policy.voltage(point.gap_m + z[..., 0], z[..., 1], point.current_a + z[..., 2])
        return voltage - point.voltage_v, None


class Rollout(NamedTuple):
    """The responses of one controller, one for a start."""

    driver: str
    start_gaps_m: tuple[float, ...]
    response: Trajectory


def roll_out(
    scene: Scene, drivers: Sequence[str], start_gaps_m: Sequence[float], duration_s: float, policy: Policy | None
) -> list[Rollout]:
    """Let each of `drivers` (of `DRIVERS`, each once) regulate from all starts, without noise or disturbance.

    A policy and `lqr_held` decide once a control period, the others at every plant step; the voltage limit is the
    process's, and that of the policy's own training.

    Raises
    ------
    InputError: a start that is not between the stops, a duration of less than two plant steps, or a policy whose
        control period is no multiple of the plant step.
    """
    _check(scene, start_gaps_m, duration_s, policy)
    plant, mdp, settings = scene
    classical = classical_controllers(plant, mdp, settings, mdp.voltage_limit_v)
    found = []
    for driver in drivers:
        controller: Controller
        period: float | None
        if driver == "policy":
            if policy is None:
                raise ValueError("the driver `policy` needs a policy")
            controller, period = PolicyController(policy, plant), policy.mdp.control_period_ms / 1e3
        else:
            name: ControllerName = driver  # type: ignore[assignment]  # one of DRIVERS
            controller, period = classical[name], period_s(name, mdp)
        response = regulate(plant, mdp, controller, np.array(start_gaps_m), duration_s, control_period_s=period)
        found.append(Rollout(driver, tuple(start_gaps_m), response))
    return found


def _check(scene: Scene, start_gaps_m: Sequence[float], duration_s: float, policy: Policy | None) -> None:
    plant, mdp = scene.plant, scene.mdp
    for gap in start_gaps_m:
        if not plant.gap_min_m <= gap <= plant.gap_max_m:
            raise InputError(
                f"a start at {gap * 1e3:g} mm is not between the stops at {plant.gap_min_m * 1e3:g} and "
                f"{plant.gap_max_m * 1e3:g} mm.",
                where="--start-gap-mm",
                todo="Give another start.",
            )
    if not 2 * mdp.plant_step_s <= duration_s < np.inf:
        raise InputError(
            f"{duration_s:g} s is less than two plant steps of {mdp.plant_step_ms:g} ms.",
            where="--duration-s",
            todo="Give a longer one.",
        )
    steps = 1.0 if policy is None else policy.mdp.control_period_ms / mdp.plant_step_ms
    if policy is not None and (round(steps) < 1 or abs(steps - round(steps)) > 1e-9):
        raise InputError(
            f"the policy decides every {policy.mdp.control_period_ms:g} ms, which is no multiple of the plant step of "
            f"{mdp.plant_step_ms:g} ms.",
            where="[mdp] plant_step_ms",
            todo="Give the recipe that it was trained with.",
        )


def summary(scene: Scene, rollouts: Sequence[Rollout]) -> list[dict[str, Any]]:
    """What each response is judged by, one row for a controller and a start; None: never, or without meaning."""
    rows = []
    for one in rollouts:
        found = response_metrics(scene.plant, scene.mdp, one.response)
        for k, start in enumerate(one.start_gaps_m):
            numbers = {name: float(values[k]) for name, values in found.items()}
            plain = {name: number if np.isfinite(number) else None for name, number in numbers.items()}
            rows.append({"controller": one.driver, "start_gap_m": start, "topic": topic_of(one, k), **plain})
    return rows


COLUMNS = ("controller", "start, mm", "cost", "settling time, s", "overshoot", "bias, mm", "peak voltage, V")


def table_rows(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """The rows of `summary` for people, under `COLUMNS`."""

    def cell(number: float | None, form: str, factor: float = 1.0) -> str:
        return "-" if number is None else format(factor * number, form)

    return [
        [
            row["controller"],
            cell(row["start_gap_m"], "g", 1e3),
            cell(row["cost"], ".4g"),
            cell(row["settling_time_s"], ".3f"),
            cell(row["overshoot"], ".1%"),
            cell(row["steady_state_bias_m"], "+.3f", 1e3),
            cell(row["peak_voltage_v"], ".0f"),
        ]
        for row in rows
    ]


def topic_of(rollout: Rollout, start: int) -> str:
    """Topic of a response: that of a suspension point which is named after the controller (and the start, of many)."""
    millimetres = f"{rollout.start_gaps_m[start] * 1e3:g}".replace(".", "_")
    point = rollout.driver if len(rollout.start_gaps_m) == 1 else f"{rollout.driver}_{millimetres}mm"
    return f"/suspension/{point}/state"


def write_rollouts(
    path: Path,
    scene: Scene,
    rollouts: Sequence[Rollout],
    policy: Policy | None,
    *,
    encoding: Encoding,
    start_ns: int = START_NS,
) -> list[str]:
    """Write one message for each plant step of each response; return the topics. The same arguments, the same bytes."""
    topics = [topic_of(one, k) for one in rollouts for k in range(len(one.start_gaps_m))]
    values = [_values(scene.plant, one.response, k) for one in rollouts for k in range(len(one.start_gaps_m))]
    steps = np.arange(len(values[0]))
    times = start_ns + np.rint(steps * (scene.mdp.plant_step_ms * 1e6)).astype(np.int64)
    count = len(topics)
    stamps = np.repeat(times, count)
    messages = Messages(
        topic=np.tile(np.arange(count), len(steps)),
        log_time_ns=stamps,
        publish_time_ns=stamps,
        sequence=np.repeat(steps, count),
        values=np.stack(values, axis=1).reshape(-1, len(STATE_MESSAGE.units)),
    )
    about: dict[str, Mapping[str, str]] = {METADATA_NAME: _metadata(scene, rollouts)}
    if policy is not None:
        about[POLICY_METADATA_NAME] = metadata(policy)
    write_log(path, topics, STATE_MESSAGE, messages, encoding=encoding, metadata=about)
    return topics


def _values(plant: Plant, response: Trajectory, k: int) -> Array:
    """Values of `STATE_MESSAGE` [steps, fields]; the vehicle stands, and the load is the plant's mass."""
    steps = len(response.voltage_v)
    columns = {
        "gap_mm": 1e3 * response.gap_m[:steps, k],
        "gap_velocity_mm_s": 1e3 * response.velocity_m_s[:steps, k],
        "coil_current_a": response.current_a[:steps, k],
        "coil_voltage_v": response.voltage_v[:, k],
        "set_point_mm": np.full(steps, 1e3 * plant.set_point_m),
        "speed_km_h": np.zeros(steps),
        "load_kg": np.full(steps, plant.mass_kg),
        "chainage_m": np.zeros(steps),
    }
    return np.stack([columns[name] for name in STATE_MESSAGE.units], axis=1)


def _metadata(scene: Scene, rollouts: Sequence[Rollout]) -> dict[str, str]:
    return {
        "simulated": "true",
        "note": "These are simulated data, made by maglev-offline; they are no recording of any real vehicle.",
        "controllers": json.dumps([one.driver for one in rollouts]),
        "start_gap_m": json.dumps(rollouts[0].start_gaps_m),
        "plant": scene.plant.model_dump_json(),
        "mdp": scene.mdp.model_dump_json(),
        "control": scene.control.model_dump_json(),
        "maglev_offline_version": __version__,
    }


def other_world(policy: Policy, plant: Plant, mdp: Mdp) -> list[str]:
    """What of the simulated world is not as the policy was trained, in words."""
    trained, now = policy.plant.model_dump() | policy.mdp.model_dump(), plant.model_dump() | mdp.model_dump()
    told = {
        "set_point_m", "mass_kg", "resistance_ohm", "inductance_slope_h_m", "voltage_limit_v", "plant_step_ms",
        "control_period_ms", "integrator",
    }  # fmt: skip
    return [
        f"{name} = {now[name]!r} (trained: {trained[name]!r})" for name in sorted(told) if now[name] != trained[name]
    ]
