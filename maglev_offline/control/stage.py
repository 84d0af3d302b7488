"""The stage `control`: responses of the classical controllers, and the linear model that they were designed on."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from maglev_offline.control.feedback import closed_loop_poles, is_stable
from maglev_offline.control.metrics import response_metrics
from maglev_offline.control.reference import classical_controllers, feedback_laws
from maglev_offline.control.settings import CONTROLLERS, ControlSettings
from maglev_offline.control.simulate import PlantKind, Trajectory, regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.workspace import Manifest, Workspace, fingerprint

PLANT_KINDS: tuple[PlantKind, ...] = ("nonlinear", "linear")


def run_control(
    workspace: Workspace,
    *,
    plant: Plant,
    mdp: Mdp,
    settings: ControlSettings,
    progress: Progress = SILENT,
) -> tuple[Path, bool]:
    """Commit `control/` (responses.parquet, metrics.parquet, facts in the manifest); return its folder and novelty.

    The nonlinear plant has the stops and the voltage limit; the linear one has neither, as in the paper's figures.
    An artefact that was made from the same settings is left as it is.
    """
    folder = workspace.path("control")
    mark = fingerprint("control", {}, plant, mdp, settings)
    if workspace.is_current(folder, mark):
        return folder, False
    manifest = Manifest("control", mark, {}, settings=settings.model_dump(mode="json"))
    manifest.facts = linear_facts(plant, mdp, settings)
    for name, loop in manifest.facts["closed_loops"].items():
        if not loop["stable"]:
            progress.warn(f"control: the linear loop of {name} is unstable on this plant")
        elif not loop["stable_at_plant_step"] and manifest.facts["integrator"] == "euler":
            progress.warn(
                f"control: the linear loop of {name} is unstable under forward Euler at {mdp.plant_step_ms:g} ms"
            )
    with workspace.commit(folder, manifest) as draft:
        responses, metrics = _simulate(plant, mdp, settings, progress)
        _write(draft / "responses.parquet", responses)
        _write(draft / "metrics.parquet", metrics)
        manifest.counts = {"responses": responses.num_rows, "metrics": metrics.num_rows}
    return folder, True


def linear_facts(plant: Plant, mdp: Mdp, settings: ControlSettings) -> dict[str, Any]:
    """The linear model in plain numbers: A, B, C, poles (as [real, imaginary] in rad/s), kappa, equilibrium, loops.

    `stable_at_plant_step` speaks of forward Euler with the process's plant step.
    """
    linear, point = linearise(plant), plant.equilibrium()
    loops: dict[str, Any] = {}
    for name, law in feedback_laws(plant, mdp, settings, None).items():
        poles = closed_loop_poles(linear, law.gain)
        loops[name] = {
            "gain": law.gain.tolist(),
            "poles_rad_s": _pairs(poles),
            "stable": is_stable(poles),
            "stable_at_plant_step": is_stable(poles, mdp.plant_step_s),
        }
    return {
        "a": linear.a.tolist(),
        "b": linear.b.tolist(),
        "c": linear.c.tolist(),
        "poles_rad_s": _pairs(linear.poles),
        "kappa_a2_per_m2": plant.kappa,
        "equilibrium": {"gap_m": point.gap_m, "current_a": point.current_a, "voltage_v": point.voltage_v},
        "integrator": settings.integrator or mdp.integrator,
        "closed_loops": loops,
    }


def _pairs(poles: Any) -> list[list[float]]:
    return [[float(p.real), float(p.imag)] for p in poles]


def _simulate(plant: Plant, mdp: Mdp, settings: ControlSettings, progress: Progress) -> tuple[pa.Table, pa.Table]:
    starts = np.array(settings.all_start_gaps_m)
    responses, metrics = [], []
    with progress.task("control", len(CONTROLLERS) * len(PLANT_KINDS), "loops") as tick:
        for kind in PLANT_KINDS:
            limit = mdp.voltage_limit_v if kind == "nonlinear" else None
            for name, controller in classical_controllers(plant, mdp, settings, limit).items():
                response = regulate(
                    plant,
                    mdp,
                    controller,
                    starts,
                    settings.duration_s,
                    plant_kind=kind,
                    integrator=settings.integrator,
                    limited=limit is not None,
                )
                head: dict[str, str] = {"controller": name, "plant_kind": kind}
                responses.append(_response_rows(head, starts, response, settings))
                found = response_metrics(plant, mdp, response)
                metrics.append(_table(head, {"start_gap_m": starts, **found}))
                tick(1)
    return pa.concat_tables(responses), pa.concat_tables(metrics)


def _response_rows(
    head: dict[str, str], starts: np.ndarray[Any, Any], response: Trajectory, settings: ControlSettings
) -> pa.Table:
    """Rows of one loop, start by start: every step of the first stretch, then thinned."""
    t = response.time_s[:-1]
    dt = t[1] - t[0]
    dense = round(settings.stored_fully_s / dt)
    rest = max(1, round(settings.stored_rest_period_ms / 1e3 / dt))
    kept = np.r_[0 : min(dense, len(t)), min(dense, len(t)) : len(t) : rest]
    columns = {
        "gap_m": response.gap_m,
        "gap_velocity_m_s": response.velocity_m_s,
        "current_a": response.current_a,
        "voltage_v": response.voltage_v,
    }
    values = {"start_gap_m": np.repeat(starts, len(kept)), "t_s": np.tile(t[kept], len(starts))}
    values |= {name: np.ascontiguousarray(x[kept].T).ravel() for name, x in columns.items()}
    return _table(head, values)


def _table(head: dict[str, str], values: dict[str, Any]) -> pa.Table:
    rows = len(next(iter(values.values())))
    labels = {name: pa.array([text] * rows) for name, text in head.items()}
    return pa.table({**labels, **{name: pa.array(x, from_pandas=True) for name, x in values.items()}})


def _write(path: os.PathLike[str], table: pa.Table) -> None:
    pq.write_table(table, path, compression="zstd")
