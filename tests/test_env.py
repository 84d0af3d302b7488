"""The environment: gymnasium's own checker, and the batch against the single one."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from maglev_offline import mdp as process
from maglev_offline.env import SuspensionBatch, SuspensionEnv
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


@pytest.mark.filterwarnings("ignore:.*A Box observation space m:UserWarning")
def test_gymnasium_accepts_it() -> None:
    check_env(gymnasium.make("maglev_offline/Suspension-v0").unwrapped)


def test_batch_equals_singles() -> None:
    plant, mdp, gaps = Plant(), Mdp(), np.array([0.005, 0.009, 0.015])
    acts = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    batch = SuspensionBatch(plant, mdp, 3)
    batch.reset(gaps)
    together = [batch.step(a) for a in acts]
    for n, gap in enumerate(gaps):
        env = SuspensionEnv(plant, mdp)
        env.reset(options={"gap_m": gap})
        for a, (seen, cost, touched) in zip(acts, together, strict=True):
            alone, reward, terminated, _, info = env.step(np.array([a[n]]))
            np.testing.assert_array_equal(alone, seen[n].astype(np.float32))
            assert reward == -cost[n]
            assert info["contact"] == touched[n]
            assert not terminated


def test_cost_of_a_decision_sums_its_plant_steps() -> None:
    """Ten decisions of 1 ms cost what one decision of 10 ms costs with the same voltage."""
    plant = Plant()
    slow, fast = (SuspensionBatch(plant, Mdp(control_period_ms=ms), 1) for ms in (10, 1))
    for batch in (slow, fast):
        batch.reset(np.array([0.01]))
    seen, cost, _ = slow.step(np.array([0.3]))
    steps = [fast.step(np.array([0.3])) for _ in range(10)]
    np.testing.assert_array_equal(seen, steps[-1][0])
    assert cost[0] == pytest.approx(sum(s[1][0] for s in steps))
    first = process.stage_cost(Mdp(), np.array([0.002, 0, 0]), np.array(60.0))
    assert steps[0][1][0] == pytest.approx(float(first))


def test_time_out_truncates_and_contact_may_terminate() -> None:
    env = SuspensionEnv(Plant(), Mdp(terminate_on_contact=True, contact_penalty=7.0))
    env.reset(options={"gap_m": 0.0155})
    outcomes = []
    while not outcomes or not (outcomes[-1][2] or outcomes[-1][3]):
        outcomes.append(env.step(np.array([-1.0], dtype=np.float32)))
    assert outcomes[-1][2]
    assert outcomes[-1][1] < -7
    patient = SuspensionEnv()
    patient.reset(options={"gap_m": 0.0155})
    ends = [patient.step(np.array([-1.0], dtype=np.float32))[2:4] for _ in range(50)]
    assert ends[-1] == (False, True)
    assert ends[:-1] == [(False, False)] * 49


def test_reset_of_some() -> None:
    batch = SuspensionBatch(Plant(), Mdp(), 2)
    batch.reset(np.array([0.01, 0.012]))
    batch.step(np.zeros(2))
    before = batch.observe()
    after = batch.reset(np.array([0.005, 0.005]), np.array([True, False]))
    np.testing.assert_allclose(after[0], [(0.005 - 0.008) / 0.0025, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(after[1], before[1])


def test_seed_repeats_the_episode() -> None:
    env = SuspensionEnv(Plant(), Mdp(force_noise_std_n=500))
    runs = []
    for _ in range(2):
        env.reset(seed=4)
        runs.append([env.step(np.array([0.1], dtype=np.float32))[1] for _ in range(5)])
    assert runs[0] == runs[1]


def vector(**options):
    return gymnasium.make_vec("maglev_offline/Suspension-v0", vectorization_mode="vector_entry_point", **options)


def test_the_batched_form_steps_like_single_environments() -> None:
    envs, gaps = vector(num_envs=3), np.array([0.005, 0.009, 0.015])
    assert envs.observation_space.shape == (3, 3)
    seen, info = envs.reset(seed=0, options={"gap_m": gaps})
    np.testing.assert_array_equal(info["gap_m"], gaps)
    acts = np.random.default_rng(1).uniform(-1, 1, (10, 3, 1)).astype(np.float32)
    singles = [SuspensionEnv() for _ in gaps]
    for env, gap, row in zip(singles, gaps, seen, strict=True):
        np.testing.assert_array_equal(env.reset(options={"gap_m": gap})[0], row)
    for act in acts:
        seen, reward, terminated, truncated, info = envs.step(act)
        alone = [env.step(a) for env, a in zip(singles, act, strict=True)]
        np.testing.assert_array_equal(seen, [one[0] for one in alone])
        np.testing.assert_array_equal(reward, [one[1] for one in alone])
        np.testing.assert_array_equal(info["current_a"], [one[4]["current_a"] for one in alone])
        assert not terminated.any()
        assert not truncated.any()


def test_an_episode_of_the_batched_form_starts_anew_at_the_step_after_its_end() -> None:
    envs = vector(num_envs=2, mdp=Mdp(episode_duration_s=0.03))
    envs.reset(seed=3)
    act = np.zeros((2, 1), dtype=np.float32)
    ends = [envs.step(act)[3].all() for _ in range(3)]
    assert ends == [False, False, True]
    seen, reward, _, truncated, info = envs.step(act)
    assert (reward == 0).all()
    assert not truncated.any()
    np.testing.assert_array_equal(seen[:, 1:], 0)
    assert ((info["gap_m"] >= 0.004) & (info["gap_m"] <= 0.0155)).all()


def test_the_batched_form_ends_episodes_at_contact_where_asked_each_on_its_own() -> None:
    envs = vector(num_envs=2, mdp=Mdp(terminate_on_contact=True, contact_penalty=5.0))
    envs.reset(seed=0, options={"gap_m": np.array([0.0155, 0.008])})
    act = np.array([[-1.0], [0.0]], dtype=np.float32)
    for _ in range(10):
        _, reward, terminated, _, _ = envs.step(act)
        if terminated.any():
            break
    assert terminated.tolist() == [True, False]
    assert reward[0] < -5 < reward[1]
