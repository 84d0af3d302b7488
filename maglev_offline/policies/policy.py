"""A trained actor as a control engineer wants it: SI units in, volt out, and where it comes from.

The convention of all exported forms: gap in metre, gap velocity in m/s and coil current in ampere go in as a sensor
gives them; the total coil voltage in volt comes out, to be held for one control period. The set-point, the scales, the
equilibrium and the voltage limit are inside, and batch norm is folded into the layer before it. A state that is not
finite gives the voltage of the equilibrium.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_offline import __version__
from maglev_offline import mdp as process
from maglev_offline.errors import ArtefactError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Weights = NDArray[np.float32]

FORMAT = "maglev-offline policy 1"

INPUTS = "gap_m in m (air gap, growing away from the rail); velocity_m_s in m/s (of the gap); current_a in A (coil)"
OUTPUT = "voltage_v in V (total coil voltage, to be held for one control period)"
NOT_FINITE = "a state that is not finite gives voltage_eq_v"


class Origin(NamedTuple):
    """The training that a policy comes from: the artefact, its hashes, and which of its actors.

    `which`: `last` or `best`. `manifest_sha256` stands for the whole artefact; `weights_sha256` is that of the file.
    """

    algorithm: str
    arm: str
    seed: int
    which: str
    engine: str
    artefact: str
    fingerprint: str
    manifest_sha256: str
    weights_sha256: str


class Layer(NamedTuple):
    """h -> h weight + bias, weight [in, out] and bias [out]."""

    weight: Weights
    bias: Weights


@dataclass(frozen=True, eq=False)
class Policy:
    """The actor of one seed, the plant and the process that it was trained on, and where it comes from.

    `net`: names and shapes of `agents/networks.py`, without the axis of the seeds.
    """

    net: Mapping[str, Weights]
    plant: Plant
    mdp: Mdp
    origin: Origin

    @cached_property
    def layers(self) -> tuple[Layer, Layer, Layer]:
        """The layers as every exported form has them: batch norm is folded in, in float32 as the network itself."""
        first, second = _folded(self.net, 1), _folded(self.net, 2)
        return first, second, Layer(self.net["w3"], self.net["b3"].reshape(-1))

    def voltage(self, gap_m: ArrayLike, velocity_m_s: ArrayLike, current_a: ArrayLike) -> Array:
        """Total coil voltage in volt for states in SI units; the arguments broadcast, and it has their shape."""
        given = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (gap_m, velocity_m_s, current_a)))
        point = self.plant.equilibrium()
        usable = np.isfinite(given).all(axis=0)
        rest = (point.gap_m, 0.0, point.current_a)
        state = State(*(np.where(usable, x, at_rest) for x, at_rest in zip(given, rest, strict=True)))
        hidden = process.observation(self.mdp, process.deviation(self.plant, state))
        for layer in self.layers[:2]:
            hidden = np.maximum(hidden @ layer.weight.astype(np.float64) + layer.bias, 0.0)
        act = np.tanh((hidden @ self.layers[2].weight.astype(np.float64) + self.layers[2].bias)[..., 0])
        voltage = np.clip(process.voltage(self.mdp, self.plant, act), *voltage_range(self))
        return np.where(usable, voltage, point.voltage_v)


def _folded(net: Mapping[str, Weights], layer: int) -> Layer:
    weight = net[f"w{layer}"]
    if f"gain_{layer}" not in net:
        return Layer(weight, net[f"b{layer}"].reshape(-1))
    from maglev_offline.agents.networks import BATCH_NORM_EPS  # it brings torch, which takes seconds

    gain, shift, mean, var = (
        net[f"{name}_{layer}"].astype(np.float64).reshape(-1) for name in ("gain", "shift", "mean", "var")
    )
    scale = gain / np.sqrt(var + BATCH_NORM_EPS)
    return Layer((weight * scale).astype(np.float32), (shift - mean * scale).astype(np.float32))


def voltage_range(policy: Policy) -> tuple[float, float]:
    """Lowest and highest voltage that the policy may ask for, V."""
    u_eq, limit = policy.plant.equilibrium().voltage_v, policy.mdp.voltage_limit_v
    return u_eq - limit, u_eq + limit


def metadata(policy: Policy) -> dict[str, str]:
    """What every exported form says about itself, in words and numbers that read back exactly."""
    mdp, point = policy.mdp, policy.plant.equilibrium()
    numbers = {
        "control_period_ms": mdp.control_period_ms,
        "set_point_m": point.gap_m,
        "current_eq_a": point.current_a,
        "voltage_eq_v": point.voltage_v,
        "voltage_limit_v": mdp.voltage_limit_v,
        "gap_scale_m": mdp.gap_scale_m,
        "velocity_scale_m_s": mdp.velocity_scale_m_s,
        "current_scale_a": mdp.current_scale_a,
    }
    return {
        "format": FORMAT,
        "maglev_offline_version": __version__,
        **{name: str(value) for name, value in policy.origin._asdict().items()},
        "inputs": INPUTS,
        "output": OUTPUT,
        "not_finite": NOT_FINITE,
        **{name: repr(float(value)) for name, value in numbers.items()},
        "plant": policy.plant.model_dump_json(),
        "mdp": policy.mdp.model_dump_json(),
    }


def from_metadata(net: Mapping[str, Weights], told: Mapping[str, Any], where: str) -> Policy:
    """The policy of a network and of what `metadata` said of it; `where` names the file in errors.

    Raises
    ------
    ArtefactError: it is no policy of ours, or says what cannot be.
    """
    if told.get("format") != FORMAT:
        raise ArtefactError(
            f"this is no policy that this version reads (format {told.get('format')!r}).", where=where, todo=_AGAIN
        )
    try:
        plant, mdp = Plant.model_validate_json(told["plant"]), Mdp.model_validate_json(told["mdp"])
        parts: dict[str, Any] = {name: str(told[name]) for name in Origin._fields}
        origin = Origin(**parts | {"seed": int(told["seed"])})
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise ArtefactError(
            f"what the policy says about itself cannot be read ({type(error).__name__}).", where=where, todo=_AGAIN
        ) from None
    return checked(Policy(net, plant, mdp, origin), where)


_AGAIN = "Export the policy again: maglev-offline policy export --format safetensors."


def checked(policy: Policy, where: str) -> Policy:
    """The policy, if its network is one.

    Raises
    ------
    ArtefactError: a layer is missing, does not fit its neighbours, or has weights that are not finite.
    """
    if any(part.dtype not in (np.float32, np.float64) for part in policy.net.values()):
        raise ArtefactError("the network's weights are no floats.", where=where, todo=_AGAIN)
    try:
        widths = [3, *(layer.weight.shape[1] for layer in policy.layers)]
        fits = widths[-1] == 1 and all(
            layer.weight.shape == (fan_in, fan_out) and layer.bias.shape == (fan_out,)
            for layer, fan_in, fan_out in zip(policy.layers, widths[:-1], widths[1:], strict=True)
        )
    except (KeyError, IndexError, ValueError, TypeError):
        fits = False
    if not fits:
        raise ArtefactError("the network is not an actor of two hidden layers.", where=where, todo=_AGAIN)
    if not all(np.isfinite(part).all() for layer in policy.layers for part in layer):
        raise ArtefactError(
            f"the {policy.origin.which} actor of seed {policy.origin.seed} has diverged: its weights are no numbers.",
            where=where,
            todo="Take another seed, or --which best.",
        )
    return policy
