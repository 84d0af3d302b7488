"""Robust least squares on both equations at once, with standard errors that know that residuals are correlated."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from maglev_offline.identify.equations import ELECTRICAL, MECHANICAL, Problem, Values, bounds, declared_values
from maglev_offline.identify.settings import IdentifySettings, Loss, Name

Array = NDArray[np.float64]

ROBUST_AT = 2.4
"""Residuals above so many standard deviations count less: 95 % efficient on Gaussian ones (Cauchy's constant)."""

ROUNDS = 3
"""Fits in a row, each with the spread of the residuals that the one before it left."""


@dataclass(frozen=True)
class Fit:
    """A fit: `values` of all parameters, `names` of those fitted, spread of the residual of each equation.

    `jacobian` [equations x n, p] is of the residuals over their spread and of the parameters over their scale;
    `residual` [equations x n] likewise. `at_bound`: the parameters that ran into a bound.
    """

    values: Values
    names: tuple[Name, ...]
    equations: tuple[str, ...]
    scale: Values
    spread: dict[str, float]
    residual: Array
    jacobian: Array
    at_bound: tuple[Name, ...]


def equations_of(names: tuple[Name, ...], dynamic: bool) -> tuple[str, ...]:
    """The equations that these parameters need."""
    found = []
    if any(name in ELECTRICAL and name != "pole_offset_m" for name in names):
        found.append("electrical")
    if dynamic and any(name in MECHANICAL for name in names):
        found.append("mechanical")
    return tuple(found)


@dataclass(frozen=True)
class Task:
    """What is to be fitted on which windows; `start` holds the values of all parameters, fitted or not."""

    problem: Problem
    names: tuple[Name, ...]
    equations: tuple[str, ...]
    start: Values
    scale: Values
    settings: IdentifySettings

    def residual(self, values: Values, spread: dict[str, float]) -> Array:
        """Residuals of all equations over their spread, one equation after the other."""
        parts = [getattr(self.problem, name)(values) / spread[name] for name in self.equations]
        return np.concatenate(parts)

    def values(self, theta: Array) -> Values:
        """All parameters from those fitted, which come over their scale."""
        return {**self.start, **{n: float(t) * self.scale[n] for n, t in zip(self.names, theta, strict=True)}}

    def jacobian(self, theta: Array, spread: dict[str, float]) -> Array:
        """Central differences; the equations are smooth and nearly linear in every parameter."""
        columns = []
        for k in range(len(theta)):
            h = np.zeros_like(theta)
            h[k] = 1e-5 * max(1.0, abs(theta[k]))
            ahead, behind = self.residual(self.values(theta + h), spread), self.residual(self.values(theta - h), spread)
            columns.append((ahead - behind) / (2 * h[k]))
        return np.column_stack(columns)


def fit(task: Task, spread: dict[str, float] | None = None) -> Fit:
    """Fit, each equation weighed by the spread of its own residuals (1.48 MAD), or by the `spread` that is given."""
    low, high = bounds(task.problem, task.scale, task.settings)
    lower = np.array([low[n] / task.scale[n] for n in task.names])
    upper = np.array([high[n] / task.scale[n] for n in task.names])
    theta = np.clip([task.start[n] / task.scale[n] for n in task.names], lower + 1e-9, upper - 1e-9)
    weight = spread or {"electrical": task.scale["voltage_offset_v"], "mechanical": task.problem.plant.gravity_m_s2}
    for _ in range(ROUNDS if spread is None else 1):
        theta = _round(task, theta, lower, upper, weight)
        if spread is None:
            weight = _spread(task, task.values(theta), weight)
    reached = (theta - lower < 1e-6 * (upper - lower)) | (upper - theta < 1e-6 * (upper - lower))
    return Fit(
        task.values(theta),
        task.names,
        task.equations,
        task.scale,
        weight,
        task.residual(task.values(theta), weight),
        task.jacobian(theta, weight),
        tuple(n for n, bound in zip(task.names, reached, strict=True) if bound),
    )


def _round(task: Task, theta: Array, lower: Array, upper: Array, spread: dict[str, float]) -> Array:
    def residual(at: Array) -> Array:
        return task.residual(task.values(at), spread)

    def jacobian(at: Array) -> Array:
        return task.jacobian(at, spread)

    found = least_squares(
        residual,
        theta,
        jac=jacobian,
        bounds=(lower, upper),
        loss=task.settings.loss,
        f_scale=ROBUST_AT,
        x_scale="jac",
        xtol=1e-9,
        ftol=1e-10,
        max_nfev=100,
    )
    return np.asarray(found.x, dtype=np.float64)


def _spread(task: Task, values: Values, before: dict[str, float]) -> dict[str, float]:
    # Noise-free residuals are rounding errors: a floor keeps the weights of the two equations within reason.
    floor = {"electrical": 1e-6 * task.scale["voltage_offset_v"], "mechanical": 1e-6 * task.problem.plant.gravity_m_s2}
    after = dict(before)
    for name in task.equations:
        left = getattr(task.problem, name)(values)
        after[name] = max(1.4826 * float(np.median(np.abs(left - np.median(left)))), floor[name])
    return after


def refit(task: Task, fitted: Fit, keep: NDArray[np.bool_]) -> Fit:
    """Fit again on some of the windows, from where the whole fit ended and with its weights."""
    return fit(replace(task, problem=task.problem.take(keep), start=fitted.values), fitted.spread)


def mean_cost(residual: Array, loss: Loss) -> float:
    """Mean of the robust loss over the residuals, in squared standard deviations."""
    z = (residual / ROBUST_AT) ** 2
    rho = {"linear": z, "soft_l1": 2 * (np.sqrt(1 + z) - 1), "cauchy": np.log1p(z)}[loss]
    return ROBUST_AT**2 * float(np.mean(rho))


def influence(residual: Array, loss: Loss) -> tuple[Array, Array]:
    """psi(r) and psi'(r) of the robust loss at residuals in standard deviations: pull on the fit, and its slope."""
    z = (residual / ROBUST_AT) ** 2
    if loss == "linear":
        return residual, np.ones_like(residual)
    if loss == "soft_l1":
        return residual / np.sqrt(1 + z), (1 + z) ** -1.5
    return residual / (1 + z), (1 - z) / (1 + z) ** 2


def declared_start(problem: Problem, names: tuple[Name, ...], scale: Values, settings: IdentifySettings) -> Task:
    """The task of fitting `names` from the declared plant."""
    equations = equations_of(names, problem.dynamic)
    return Task(problem, names, equations, declared_values(problem.plant), scale, settings)
