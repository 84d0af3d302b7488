import sys

import numpy as np
import pytest

from maglev_offline.errors import InputError
from maglev_offline.policies.onnx_model import INPUT_NAMES, IR_VERSION, OPSET, as_onnx
from maglev_offline.policies.policy import metadata


@pytest.fixture
def session(policy):
    onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed (pip install '.[export]')")
    return onnxruntime.InferenceSession(as_onnx(policy), providers=["CPUExecutionProvider"])


@pytest.fixture
def model(policy):
    onnx = pytest.importorskip("onnx", reason="onnx is not installed (pip install '.[export]')")
    return onnx.load_from_string(as_onnx(policy))


def run(session, states):
    given = {name: np.atleast_1d(x).astype(np.float32) for name, x in zip(INPUT_NAMES, states, strict=True)}
    return session.run(["voltage_v"], given)[0]


def test_onnxruntime_gives_the_voltages_of_the_policy(session, policy, states):
    voltage = run(session, states)
    assert voltage.dtype == np.float32
    assert voltage.shape == states[0].shape
    np.testing.assert_allclose(voltage, policy.voltage(*states), atol=1e-5 * policy.mdp.voltage_limit_v)


def test_a_state_that_is_not_finite_gives_the_voltage_of_the_equilibrium(session, policy, not_finite):
    assert set(run(session, not_finite)) == {np.float32(policy.plant.equilibrium().voltage_v)}


def test_the_model_is_valid_and_says_its_opset_and_where_it_comes_from(model, policy):
    import onnx

    onnx.checker.check_model(model, full_check=True)
    assert (model.opset_import[0].version, model.ir_version) == (OPSET, IR_VERSION)
    assert {entry.key: entry.value for entry in model.metadata_props} == metadata(policy)
    assert [value.name for value in model.graph.input] == list(INPUT_NAMES)


@pytest.mark.usefixtures("model")
def test_the_same_policy_gives_the_same_bytes(policy):
    assert as_onnx(policy) == as_onnx(policy)


def test_without_the_package_it_says_what_to_install(policy, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"not installed.*pip install 'maglev-offline\[export\]'"):
        as_onnx(policy)
