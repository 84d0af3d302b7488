"""A policy as an ONNX model. The `onnx` package is an extra: `pip install 'maglev-offline[export]'`."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_offline import __version__
from maglev_offline.errors import InputError
from maglev_offline.policies.policy import Policy, metadata, voltage_range

if TYPE_CHECKING:
    from onnx import NodeProto, TensorProto, ValueInfoProto

OPSET, IR_VERSION = 17, 8
"""Of 2022: also the runtimes of controllers that are not renewed every year read it."""

INPUT_NAMES = ("gap_m", "velocity_m_s", "current_a")


def as_onnx(policy: Policy) -> bytes:
    """The model: inputs `gap_m`, `velocity_m_s`, `current_a` and output `voltage_v`, each float32 of shape [n].

    All of it is float32, since hardware runtimes know nothing else: the voltage is within 1e-5 of the voltage limit
    of what the other forms give. The same policy gives the same bytes.

    Raises
    ------
    InputError: the `onnx` package is not installed.
    """
    try:
        from onnx import TensorProto, checker, helper
    except ImportError:
        raise InputError(
            "the ONNX format needs the package onnx, and it is not installed.",
            where="--format onnx",
            todo="pip install 'maglev-offline[export]', or take --format c or safetensors.",
        ) from None

    def signal(name: str) -> "ValueInfoProto":
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n"])

    graph = helper.make_graph(
        [*_scaling(), *_network(), *_limits()],
        "maglev_policy",
        [signal(name) for name in INPUT_NAMES],
        [signal("voltage_v")],
        _constants(policy),
        doc_string="A state in SI units to the coil voltage in volt; see the metadata.",
    )
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="maglev-offline",
        producer_version=__version__,
    )
    helper.set_model_props(model, metadata(policy))
    checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString(deterministic=True))


def _constants(policy: Policy) -> list["TensorProto"]:
    from onnx import numpy_helper

    point, mdp = policy.plant.equilibrium(), policy.mdp
    low, high = voltage_range(policy)
    values = {
        "rest": np.array([[point.gap_m, 0.0, point.current_a]]),
        "scale": mdp.state_scale[None],
        "voltage_eq_v": np.array(point.voltage_v),
        "voltage_limit_v": np.array(mdp.voltage_limit_v),
        "lowest_v": np.array(low),
        "highest_v": np.array(high),
    }
    for number, layer in enumerate(policy.layers, start=1):
        values |= {f"w{number}": layer.weight, f"b{number}": layer.bias}
    constants = [numpy_helper.from_array(value.astype(np.float32), name) for name, value in values.items()]
    return [*constants, numpy_helper.from_array(np.array([1], dtype=np.int64), "last_axis")]


def _scaling() -> list["NodeProto"]:
    """The three signals, side by side [n, 3], as deviation over scale."""
    from onnx.helper import make_node

    columns = [f"{name}_column" for name in INPUT_NAMES]
    return [
        *(
            make_node("Unsqueeze", [name, "last_axis"], [column])
            for name, column in zip(INPUT_NAMES, columns, strict=True)
        ),
        make_node("Concat", columns, ["state"], axis=1),
        make_node("Sub", ["state", "rest"], ["deviation"]),
        make_node("Div", ["deviation", "scale"], ["observation"]),
    ]


def _network() -> list["NodeProto"]:
    from onnx.helper import make_node

    return [
        make_node("Gemm", ["observation", "w1", "b1"], ["sum_1"]),
        make_node("Relu", ["sum_1"], ["hidden_1"]),
        make_node("Gemm", ["hidden_1", "w2", "b2"], ["sum_2"]),
        make_node("Relu", ["sum_2"], ["hidden_2"]),
        make_node("Gemm", ["hidden_2", "w3", "b3"], ["sum_3"]),
        make_node("Tanh", ["sum_3"], ["action_column"]),
        make_node("Squeeze", ["action_column", "last_axis"], ["action"]),
    ]


def _limits() -> list["NodeProto"]:
    """Action to voltage; the sum of a state that is not finite is not finite either."""
    from onnx.helper import make_node

    return [
        make_node("Mul", ["action", "voltage_limit_v"], ["voltage_deviation"]),
        make_node("Add", ["voltage_deviation", "voltage_eq_v"], ["voltage_unlimited"]),
        make_node("Clip", ["voltage_unlimited", "lowest_v", "highest_v"], ["voltage_limited"]),
        make_node("Add", ["gap_m", "velocity_m_s"], ["sum_of_two"]),
        make_node("Add", ["sum_of_two", "current_a"], ["sum_of_three"]),
        make_node("IsNaN", ["sum_of_three"], ["is_nan"]),
        make_node("IsInf", ["sum_of_three"], ["is_infinite"]),
        make_node("Or", ["is_nan", "is_infinite"], ["unusable"]),
        make_node("Where", ["unusable", "voltage_eq_v", "voltage_limited"], ["voltage_v"]),
    ]
