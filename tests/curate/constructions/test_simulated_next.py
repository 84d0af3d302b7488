import numpy as np

from maglev_offline.curate.constructions.simulated_next import simulated_next_rows
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

PLANT = Plant()


def test_state_and_voltage_are_logged_and_the_rest_is_what_the_environment_does(wandering):
    mdp = Mdp(contact_penalty=1.5, terminate_on_contact=True)
    samples = wandering("log-a", 40)
    samples.loc[3, ["gap_m", "gap_velocity_m_s"]] = 0.0158, 0.2  # about to touch the lower stop
    samples.loc[5, "contact"] = True  # what the log says of contact is not asked
    pairs = pairs_of(samples, PLANT)
    table = simulated_next_rows(pairs, PLANT, mdp)
    world = SuspensionBatch(PLANT, mdp, len(pairs))
    rest = PLANT.equilibrium()
    world.state = State(*(pairs.state + np.array([rest.gap_m, 0, rest.current_a])).T)
    _, cost, touched = world.step(pairs.voltage_v / mdp.voltage_limit_v)
    np.testing.assert_array_equal(table["gap_error_m"], pairs.state[:, 0])
    np.testing.assert_array_equal(table["voltage_deviation_v"], pairs.voltage_v)
    nexts = table[["next_gap_error_m", "next_gap_velocity_m_s", "next_current_error_a"]]
    np.testing.assert_allclose(nexts, world.deviation(), atol=1e-12)
    np.testing.assert_allclose(table["cost"], cost, rtol=1e-9)
    np.testing.assert_array_equal(table["terminated"], touched)
    np.testing.assert_array_equal(table["discount"], mdp.discount * ~touched)
    np.testing.assert_allclose(table["duration_s"], 0.01)
    assert touched[3]
    assert not touched[4]


def test_rows_are_about_the_set_point_that_agents_train_at(samples_of):
    """The same deviations, logged at two set-points, are the same rows."""
    one, other = (
        simulated_next_rows(
            pairs_of(
                samples_of(
                    [at + 0.001, at],
                    set_point_m=at,
                    current_a=PLANT.equilibrium(at).current_a + 1,
                    voltage_v=PLANT.equilibrium(at).voltage_v + 2,
                ),
                PLANT,
            ),
            PLANT,
            Mdp(),
        )
        for at in (0.008, 0.009)
    )
    columns = ["cost", "next_gap_error_m", "next_gap_velocity_m_s", "next_current_error_a"]
    np.testing.assert_allclose(one[columns], other[columns], rtol=1e-9)
