"""The stage `control`: responses of the classical controllers, and the linear model that they were designed on."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from maglev_offline.control.claims import claims, claims_to_table
from maglev_offline.control.feedback import closed_loop_poles, is_stable
from maglev_offline.control.margins import SAMPLINGS, RootLocus, margins_of_all, root_locus, stable_kp_range
from maglev_offline.control.metrics import response_metrics
from maglev_offline.control.reference import classical_controllers, feedback_laws, period_s
from maglev_offline.control.robustness import RobustnessMaps, robustness_maps
from maglev_offline.control.settings import CONTROLLERS, ControlSettings
from maglev_offline.control.simulate import PlantKind, Trajectory, regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.disturbance import force_noise
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.streams import stream
from maglev_offline.tables import write_parquet
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
    """Commit `control/`; return its folder and whether it is new.

    It holds responses.parquet, metrics.parquet, root_locus.parquet of the PID, robustness.parquet, and claims.parquet
    where the settings ask for it; the linear model, margins and ranges of stability are facts of the manifest. The
    nonlinear plant has the stops and the voltage limit; the linear one has neither, as in the paper's figures.
    """
    folder = workspace.path("control")
    mark = fingerprint("control", {}, plant, mdp, settings)
    if workspace.is_current(folder, mark):
        return folder, False
    manifest = Manifest("control", mark, {})
    tables = {"control": settings, "plant": plant, "mdp": mdp}
    manifest.settings = {name: table.model_dump(mode="json") for name, table in tables.items()}
    manifest.facts = linear_facts(plant, mdp, settings) | _margin_facts(plant, mdp, settings)
    with workspace.commit(folder, manifest) as draft:
        tables_made = dict(zip(("responses", "metrics"), _simulate(plant, mdp, settings, progress), strict=True))
        manifest.facts["doubts"] = _doubts(manifest.facts, tables_made["metrics"], mdp, settings)
        tables_made["root_locus"] = locus_table(root_locus(plant, settings.pid))
        tables_made["robustness"] = survival_table(robustness_maps(plant, mdp, settings))
        if settings.claims:
            tables_made["claims"] = claims_to_table(claims(progress))
        for name, table in tables_made.items():
            write_parquet(table, draft / f"{name}.parquet")
        manifest.counts = {name: table.num_rows for name, table in tables_made.items()}
    for doubt in manifest.facts["doubts"]:
        progress.warn(doubt)
    return folder, True


def _doubts(facts: dict[str, Any], metrics: pa.Table, mdp: Mdp, settings: ControlSettings) -> list[str]:
    """What does not work, in words with the number that is wrong: unstable loops, a voltage that does not suffice."""
    found = []
    ranges = {entry["sampling"]: entry for entry in facts["kp_ranges"]}
    for name, loop in facts["closed_loops"].items():
        real = max(pole[0] for pole in loop["poles_rad_s"])
        stable = ranges.get("continuous")
        within = (
            f"; Kp = {settings.pid.kp:g}, stable from {stable['lowest']:.0f} to {stable['highest']:.0f}"
            if stable
            else ""
        )
        if not loop["stable"]:
            found.append(
                f"the linear loop of {name} is unstable on this plant: a pole lies at {real:+.3g} 1/s"
                f"{within if name == 'pid' else ''}."
            )
        elif not loop["stable_at_plant_step"] and facts["integrator"] == "euler" and name != "lqr_held":
            found.append(f"the linear loop of {name} is unstable under forward Euler at {mdp.plant_step_ms:g} ms.")
    lost = [
        str(row["controller"])
        for row in metrics.to_pylist()
        if row["plant_kind"] == "nonlinear"
        and np.isclose(row["start_gap_m"], settings.reference_start_gap_m)
        and not row["steady_state_error_m"] < 0.5 * abs(settings.reference_start_gap_m - facts["equilibrium"]["gap_m"])
    ]
    if lost:
        found.append(
            f"{', '.join(lost)} {'does' if len(lost) == 1 else 'do'} not bring the magnet back from "
            f"{settings.reference_start_gap_m * 1e3:g} mm with a voltage limit of {mdp.voltage_limit_v:g} V."
        )
    return found


def _margin_facts(plant: Plant, mdp: Mdp, settings: ControlSettings) -> dict[str, Any]:
    """Margins of every loop and ranges of stable Kp; what is infinite, or has no meaning, is None."""

    def plain(value: Any) -> Any:
        return None if isinstance(value, float) and not np.isfinite(value) else value

    ranges = [stable_kp_range(plant, settings.pid, sampling, mdp.plant_step_s) for sampling in SAMPLINGS]
    margins = margins_of_all(plant, mdp, settings)
    return {
        "kp_ranges": [{key: plain(value) for key, value in asdict(found).items()} for found in ranges if found],
        "margins": {name: {key: plain(value) for key, value in asdict(loop).items()} for name, loop in margins.items()},
    }


def locus_table(locus: RootLocus) -> pa.Table:
    """One row for a gain and a pole."""
    count, poles = locus.poles_rad_s.shape
    return pa.table(
        {
            "kp": np.repeat(locus.kp, poles),
            "pole": np.tile(np.arange(poles), count),
            "real_rad_s": locus.poles_rad_s.real.ravel(),
            "imag_rad_s": locus.poles_rad_s.imag.ravel(),
        }
    )


def survival_table(maps: RobustnessMaps) -> pa.Table:
    """One row for a controller and a case of the two maps, `mass` and `voltage_limit`."""
    parts = []
    for kind, found in (("mass", maps.by_mass), ("voltage_limit", maps.by_limit)):
        for name, cases in found.items():
            parts.append(_table({"controller": name, "map": kind}, cases._asdict()))
    return pa.concat_tables(parts)


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
    steps = round(settings.duration_s / mdp.plant_step_s)
    force = settings.constant_load_n + force_noise(
        stream(settings.seed, "control: force"), (steps, 1), settings.force_noise_std_n
    )
    actual = plant.model_copy(update={"mass_kg": plant.mass_kg * (1 + settings.mass_error_share)})
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
                    control_period_s=period_s(name, mdp),
                    integrator=settings.integrator,
                    limited=limit is not None,
                    force_n=force,
                    actual=actual,
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
