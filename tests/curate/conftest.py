"""Small tables of samples, written out by hand."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.constructions.rows import NEXT_STATE, STATE
from maglev_offline.curate.simulator import hold
from maglev_offline.logs.surrogate_plant import simulate_log
from maglev_offline.logs.surrogate_settings import SurrogateSettings
from maglev_offline.mdp import Mdp, contact
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant
from maglev_offline.workspace import Manifest

MDP = Mdp()


@pytest.fixture(scope="session")
def samples_of():
    """Build samples of one segment, 100 ms apart, at the set-point unless told otherwise."""

    def build(gap_m, *, log_id="log-a", point="P1", segment=0, set_point_m=0.008, current_a=20.0, voltage_v=24.0,
              velocity_m_s=0.0, contact=False):  # fmt: skip
        n = len(gap_m)
        return pd.DataFrame(
            {
                "log_id": log_id,
                "point": point,
                "t": pd.to_datetime(np.arange(n) * 100_000_000, unit="ns", utc=True),
                "segment": np.full(n, segment, dtype=np.int32),
                "step": np.arange(n, dtype=np.int32),
                "gap_m": np.asarray(gap_m, dtype=float),
                "gap_velocity_m_s": np.broadcast_to(np.asarray(velocity_m_s, dtype=float), n),
                "current_a": np.broadcast_to(np.asarray(current_a, dtype=float), n),
                "voltage_v": np.broadcast_to(np.asarray(voltage_v, dtype=float), n),
                "set_point_m": np.broadcast_to(np.asarray(set_point_m, dtype=float), n),
                **dict.fromkeys(("gap_origin", "gap_velocity_origin", "current_origin", "voltage_origin"), "measured"),
                "contact": np.broadcast_to(np.asarray(contact), n),
            }
        )

    return build


@pytest.fixture(scope="session")
def wandering(samples_of):
    """Samples that wander over states and voltages, different in every log."""

    def build(log_id, rows, seed=0):
        rng = np.random.default_rng((seed, *log_id.encode()))
        return samples_of(
            0.008 + 0.002 * rng.standard_normal(rows).clip(-3, 3),
            log_id=log_id,
            velocity_m_s=0.02 * rng.standard_normal(rows),
            current_a=20 + rng.standard_normal(rows),
            voltage_v=24 + 20 * rng.standard_normal(rows).clip(-3, 3),
        )

    return build


@pytest.fixture(scope="session")
def put_samples():
    """Commit a table of samples as the artefact of its log."""

    def put(workspace, table, settings=None):
        log_id = table["log_id"].iloc[0]
        manifest = Manifest("samples", f"samples of {log_id}", {}, counts={"rows": len(table)})
        manifest.settings = settings or {}
        with workspace.commit(workspace.path("samples", log_id), manifest) as draft:
            table.to_parquet(draft / "samples.parquet")

    return put


@pytest.fixture(scope="session")
def surrogate_truth():
    """What a surrogate log of the paper's PID would show at 1 kHz, without noise, load, rail or force: two runs."""
    settings = SurrogateSettings(
        points=8, duration_s=9.5, run_s=(4.0, 4.0), load_spread=0, force_noise_std_n=0, rail_rms_m=0, from_stop_share=0
    )
    return simulate_log(Plant(), Mdp(), settings, 0, "pid")


@pytest.fixture(scope="session")
def samples_every(surrogate_truth):
    """Sample that truth every so many milliseconds: one segment for each run of each point, cut before contact."""

    def sample(period_ms, log_id="log-a"):
        tables = []
        for number, truth in enumerate(surrogate_truth):
            for point in range(truth.gap_m.shape[1]):
                free = ~contact(Plant(), truth.gap_m[:, point])
                steps = np.arange(0, len(free) if free.all() else int(np.argmin(free)), period_ms)
                gap, velocity, current, voltage, set_point = (
                    getattr(truth, name)[steps, point]
                    for name in ("gap_m", "velocity_m_s", "current_a", "voltage_v", "set_point_m")
                )
                t = pd.to_datetime(steps * 1_000_000 + number * 10**11, unit="ns", utc=True)
                tables.append(
                    pd.DataFrame(
                        {
                            "log_id": log_id,
                            "point": f"P{point + 1}",
                            "t": t,
                            "segment": number,
                            "step": np.arange(len(steps)),
                            "gap_m": gap,
                            "gap_velocity_m_s": velocity,
                            "current_a": current,
                            "voltage_v": voltage,
                            "set_point_m": set_point,
                            "gap_velocity_origin": "measured",
                            "contact": False,
                        }
                    )
                )
        return pd.concat(tables, ignore_index=True)

    return sample


@pytest.fixture(scope="session")
def simulator_rows():
    """Rows of a random held policy in the simulator, as many as asked for: the truth itself, in several segments."""

    def build(rows, seed=0, mdp=MDP):
        rng = np.random.default_rng(seed)
        state = rng.normal(0, mdp.state_scale / 2, (rows, 3))
        voltage = rng.uniform(-50, 50, rows)
        held = hold(Plant(), mdp, state, voltage)
        table = pd.DataFrame(dict(zip(STATE, state.T, strict=True)))
        table["voltage_deviation_v"], table["cost"] = voltage, held.cost
        table = table.assign(**dict(zip(NEXT_STATE, held.next_state.T, strict=True)))
        ended = held.touched & mdp.terminate_on_contact
        return table.assign(
            duration_s=mdp.control_period_ms / 1e3,
            discount=mdp.discount * ~ended,
            terminated=ended,
            truncated=False,
            origin="simulated_next",
            log_id="log-a",
            point="P1",
            t=pd.to_datetime(np.arange(rows) * 10**8, unit="ns", utc=True),
            segment=np.arange(rows) // 20,
            step=np.arange(rows),
            substep=0,
        )

    return build


@pytest.fixture(scope="session")
def driven_samples():
    """Samples 5 ms apart of the simulator itself: `n` short segments from random states, voltages on lines between.

    `heavy`: what moves instead of the plant, everywhere or only where `beyond(gap_m)` says so.
    """

    def build(log_id="log-a", heavy=None, beyond=None, n=40, steps=6, gap_std_m=1e-3):
        rng, plant = np.random.default_rng(list(log_id.encode())), Plant()
        rest = plant.equilibrium()
        now = State(*(np.array([rest.gap_m, 0, rest.current_a]) + rng.normal(0, [gap_std_m, 0.02, 0.3], (n, 3))).T)
        voltage = rest.voltage_v + rng.normal(0, 10, (steps, n))
        states = [now]
        for k in range(steps - 1):
            for part in (np.arange(5) + 0.5) / 5:
                held = (1 - part) * voltage[k] + part * voltage[k + 1]
                moved = [step(one, now, held, 1e-3) for one in (plant, heavy or plant)]
                other = np.ones(n, dtype=bool) if beyond is None else beyond(now.gap_m)
                now = State(*(np.where(other, there, here) for here, there in zip(*moved, strict=True)))
            states.append(now)
        gap, velocity, current = np.array(states).transpose(1, 2, 0).reshape(3, -1)
        number = np.repeat(np.arange(n), steps)
        t_ns = number * 10**9 + np.tile(np.arange(steps), n) * 5_000_000
        return pd.DataFrame(
            {
                "log_id": log_id,
                "point": "P1",
                "t": pd.to_datetime(t_ns, unit="ns", utc=True),
                "segment": number,
                "step": np.tile(np.arange(steps), n),
                "gap_m": gap,
                "gap_velocity_m_s": velocity,
                "current_a": current,
                "voltage_v": voltage.T.ravel(),
                "set_point_m": rest.gap_m,
                "gap_velocity_origin": "measured",
                "contact": False,
            }
        )

    return build
