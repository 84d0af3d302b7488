import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.control.settings import ControlSettings
from maglev_offline.errors import InputError
from maglev_offline.ingest.log import ingest_log
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.surrogate_recorder import STATE_MESSAGE
from maglev_offline.logs.writer import ENCODINGS
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.policy import Policy, metadata
from maglev_offline.policies.rollout import (
    DRIVERS,
    METADATA_NAME,
    POLICY_METADATA_NAME,
    START_NS,
    Scene,
    roll_out,
    summary,
    write_rollouts,
)

SCENE = Scene(Plant(), Mdp(), ControlSettings())


@pytest.fixture(scope="module")
def a_policy(make_policy):
    """An actor whose voltages are small: the magnet falls, and where it goes is not what is tested."""
    return make_policy(1, (8, 8), last_layer_scale=0.1)


@pytest.fixture(scope="module")
def linear_policy(a_policy):
    """A linear law as a network: two rectifiers carry the feedback and its opposite, the tanh is straight so far."""
    gain, scale = np.array([40000.0, 800.0, -10.0]), SCENE.mdp.state_scale
    small = 1e-3
    w1 = np.stack([gain * scale, -gain * scale], axis=1) / SCENE.mdp.voltage_limit_v
    net = {
        "w1": w1,
        "b1": np.zeros(2),
        "w2": np.eye(2),
        "b2": np.zeros(2),
        "w3": small * np.array([[1], [-1]]),
        "b3": [0],
    }
    return Policy(
        {k: np.asarray(v, np.float32) for k, v in net.items()}, SCENE.plant, SCENE.mdp, a_policy.origin
    ), small * gain


def test_every_controller_regulates_from_every_start(a_policy):
    rollouts = roll_out(SCENE, DRIVERS, [0.015, 0.006], 0.1, a_policy)
    assert [one.driver for one in rollouts] == list(DRIVERS)
    for one in rollouts:
        assert one.response.gap_m.shape == (101, 2)
        assert one.response.gap_m[0].tolist() == [0.015, 0.006]
        assert np.isfinite(one.response.voltage_v).all()


def test_a_classical_controller_costs_what_the_reference_says():
    rows = summary(SCENE, roll_out(SCENE, ["lqr_held", "lqr"], [0.015], SCENE.mdp.episode_duration_s, None))
    expected = classical_reference_cost(SCENE.plant, SCENE.mdp, [0.015])
    for row in rows:
        assert row["cost"] == pytest.approx(float(expected[row["controller"]][0]), rel=1e-9)


def test_a_policy_holds_its_voltage_for_a_control_period_and_decides_on_the_state_at_its_start(a_policy):
    (one,) = roll_out(SCENE, ["policy"], [0.015], 0.2, a_policy)
    held = one.response.voltage_v.reshape(20, 10, 1)
    assert (held == held[:, :1]).all()
    at = np.s_[:-1:10, 0]
    expected = a_policy.voltage(one.response.gap_m[at], one.response.velocity_m_s[at], one.response.current_a[at])
    np.testing.assert_allclose(held[:, 0, 0], expected, rtol=1e-9)


def test_a_policy_that_is_a_linear_law_moves_the_magnet_as_that_law(linear_policy):
    policy, gain = linear_policy
    (one,) = roll_out(SCENE, ["policy"], [0.0081], 0.05, policy)
    z = np.array([0.0001, 0.0, 0.0])
    assert one.response.voltage_v[0, 0] - SCENE.plant.equilibrium().voltage_v == pytest.approx(gain @ z, rel=1e-4)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_ingest_reads_a_rollout_back_as_it_was(a_policy, tmp_path, encoding):
    path = tmp_path / "run.mcap"
    # From 15 mm the law touches the stop, and ingest takes the second row of a contact out.
    rollouts = roll_out(SCENE, ["policy", "lqr_held"], [0.012], 0.5, a_policy)
    topics = write_rollouts(path, SCENE, rollouts, a_policy, encoding=encoding)
    assert topics == ["/suspension/policy/state", "/suspension/lqr_held/state"]
    for grid_ms in (100, 10, 1):
        out = tmp_path / str(grid_ms)
        out.mkdir()
        ingest_log(path, "run", Request(None, IngestSettings(grid_ms=grid_ms), SCENE.plant), out)
        samples = pq.read_table(out / "samples.parquet").to_pandas()
        lqr, held = samples[samples["point"] == "lqr_held"], rollouts[1].response
        steps = (lqr["t"].astype("int64").to_numpy() - START_NS) // 1_000_000
        assert len(steps) == 500 // grid_ms
        for column, values in (
            ("gap_m", held.gap_m),
            ("gap_velocity_m_s", held.velocity_m_s),
            ("current_a", held.current_a),
            ("voltage_v", held.voltage_v),
        ):
            np.testing.assert_allclose(lqr[column], values[steps, 0], rtol=5e-16, err_msg=column)
        np.testing.assert_allclose(lqr["set_point_m"], SCENE.plant.set_point_m, rtol=5e-16)
        np.testing.assert_allclose(lqr["load_kg"], SCENE.plant.mass_kg, rtol=1e-12)


def test_the_log_has_the_shape_of_a_surrogate_log_and_says_that_it_is_simulated(a_policy, tmp_path):
    path = tmp_path / "run.mcap"
    write_rollouts(path, SCENE, roll_out(SCENE, ["policy"], [0.015, 0.0065], 0.1, a_policy), a_policy, encoding="json")
    with path.open("rb") as file:
        reader = make_reader(file)
        about = {record.name: record.metadata for record in reader.iter_metadata()}
        schemas = {schema.name for schema in reader.get_summary().schemas.values()}
        messages = [(channel.topic, m.log_time, json.loads(m.data)) for _, channel, m in reader.iter_messages()]
    assert about[METADATA_NAME]["simulated"] == "true"
    assert "no recording of any real vehicle" in about[METADATA_NAME]["note"]
    assert about[POLICY_METADATA_NAME] == metadata(a_policy)
    assert schemas == {STATE_MESSAGE.name}
    assert {topic for topic, _, _ in messages} == {"/suspension/policy_15mm/state", "/suspension/policy_6_5mm/state"}
    assert list(messages[0][2]) == list(STATE_MESSAGE.units)
    assert [time - START_NS for _, time, _ in messages[::2]] == [step * 1_000_000 for step in range(100)]
    assert messages[0][2]["gap_mm"] == pytest.approx(15.0)
    assert messages[1][2]["gap_mm"] == pytest.approx(6.5)


def test_the_same_rollout_gives_the_same_bytes(a_policy, tmp_path):
    for name in ("one.mcap", "two.mcap"):
        rollouts = roll_out(SCENE, ["policy", "pid"], [0.015], 0.1, a_policy)
        write_rollouts(tmp_path / name, SCENE, rollouts, a_policy, encoding="protobuf")
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


@pytest.mark.parametrize(
    ("starts", "duration_s", "what"),
    [
        ([0.03], 0.1, "30 mm is not between the stops at 0.5 and 16 mm"),
        ([float("nan")], 0.1, "not between the stops"),
        ([0.015], 0.001, "less than two plant steps"),
        ([0.015], float("nan"), "less than two plant steps"),
    ],
)
def test_what_cannot_be_simulated_is_told(starts, duration_s, what):
    with pytest.raises(InputError, match=what):
        roll_out(SCENE, ["lqr"], starts, duration_s, None)


def test_a_control_period_that_the_plant_step_does_not_divide_is_told(a_policy):
    scene = SCENE._replace(mdp=Mdp(plant_step_ms=4, control_period_ms=20))
    with pytest.raises(InputError, match="decides every 10 ms, which is no multiple of the plant step of 4 ms"):
        roll_out(scene, ["policy"], [0.015], 0.1, a_policy)
