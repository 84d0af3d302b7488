"""The native engine against autograd, against the torch engine, and against itself in other company."""

import numpy as np
import pytest
import torch

from maglev_offline.agents import networks
from maglev_offline.agents.ddpg import actor_loss, bootstrap
from maglev_offline.agents.draws import DrawStreams
from maglev_offline.agents.evaluation import roll_out
from maglev_offline.agents.native import NativeLearner, availability
from maglev_offline.agents.native_library import ISA_VARIABLE, isas
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.agents.torch_engine import TorchLearner
from maglev_offline.errors import InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.buffer import WIDTH, Batch, ReplayBuffer
from maglev_offline.replay.sampling import Mixture

pytestmark = pytest.mark.skipif(not availability()[0], reason=availability()[1])

EXPLORATORY, SEEDS = 60, [0, 1]

RUNNABLE = [isa.name for isa in isas() if isa.runs_here]

PLAIN = {
    "layer_norm_critic": False,
    "critic_root_offset": 0.0,
    "saturation_weight": 0.0,
    "actor_learning_rate": 5e-4,
    "critic_learning_rate": 1e-3,
}
"""The published algorithms, without what this project adds by default."""

WIDE_ACTOR = {"actor_last_layer_scale": 40.0}
"""Fresh actors whose tanh saturates in a part of the batch, as the pull against that supposes."""

VARIANTS = {
    "default": {},
    "plain": PLAIN,
    "batch norm in the actor": {**PLAIN, "batch_norm_actor": True},
    "layer norm in the critics": {**PLAIN, "layer_norm_critic": True},
    "roots": {**PLAIN, "critic_root_offset": 0.2},
    "saturated actor": {**PLAIN, **WIDE_ACTOR, "saturation_weight": 0.7},
    "saturated actor with batch norm": {**WIDE_ACTOR, "batch_norm_actor": True},
    "both norms, widths that fill no vector": {
        "batch_norm_actor": True,
        "layer_norm_critic": True,
        "hidden": (13, 7),
        "batch_size": 37,
    },
    "wider layers": {"hidden": (72, 100), "batch_size": 41},
    "more rows than are taken at once": {"batch_norm_actor": True, "hidden": (24, 40), "batch_size": 105},
    "cloning": {"cloning_weight": 2.0, "mixing_share": 0.3},
}


@pytest.fixture(params=RUNNABLE)
def isa(request, monkeypatch):
    """Each instruction set that this machine has."""
    monkeypatch.setenv(ISA_VARIABLE, request.param)
    return request.param


def settings(**changes):
    small = {"steps": 400, "exploratory_steps": EXPLORATORY, "seeds": 2, "block": 2}
    return TrainingSettings(**{**small, **changes})


def prefill(n=40):
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(n, WIDTH)).astype(np.float32)
    rows[:, 3], rows[:, 8], rows[:, 9] = rng.uniform(-1, 1, n), 0.9, 1.0
    return rows


def native(algorithm="td3", seeds=SEEDS, mdp=None, rows=None, threads=1, **changes):
    return NativeLearner(algorithm, seeds, Plant(), mdp or Mdp(), settings(**changes), rows, threads=threads)


def reference(algorithm="td3", seeds=SEEDS, mdp=None, rows=None, **changes):
    return TorchLearner(algorithm, seeds, Plant(), mdp or Mdp(), settings(**changes), rows)


def nets_of(state):
    return {name: value for name, value in state.items() if name.partition(".")[0] not in ("head", "streams")}


def same_bits(one, other):
    assert one.keys() == other.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


# -- one gradient step against autograd


def batch_of_first_gradient_step(learner, training, mdp, rows):
    """The batch that every seed's first gradient step takes, in double precision."""
    buffer = ReplayBuffer(len(SEEDS), 500, n_step=training.n_step, mixture=Mixture(training.mixing_share))
    if rows is not None:
        buffer.prefill(rows)
    for row in learner.new_rows():
        buffer.add(row)
    streams = DrawStreams(SEEDS, training.batch_size, mdp.plant_steps_per_decision, mdp.force_noise_std_n)
    draws = streams.draw(EXPLORATORY + 1)
    fields = buffer.sample(draws.batch[EXPLORATORY], EXPLORATORY)
    batch = Batch(*(None if field is None else field.double() for field in fields))
    return batch, torch.from_numpy(draws.smoothing[EXPLORATORY])[..., None].double()


def group(state, name):
    return {
        key.removeprefix(f"{name}."): torch.from_numpy(value).double().requires_grad_("mean_" not in key)
        for key, value in state.items()
        if key.startswith(f"{name}.")
    }


def gradients(net, loss):
    names = [name for name in net if name not in networks.STATISTICS]
    return dict(zip(names, torch.autograd.grad(loss, [net[name] for name in names]), strict=True))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_gradients_are_those_of_autograd(algorithm, variant, isa):
    """Adam's first moment after one step is (1 - beta_1) times the gradient."""
    mdp, training = Mdp(), settings(**VARIANTS[variant])
    rows = prefill() if training.cloning_weight else None
    learner = native(algorithm, rows=rows, **VARIANTS[variant])
    learner.advance(EXPLORATORY)
    before = learner.state()
    learner.advance(1)
    after = learner.state()
    batch, noise = batch_of_first_gradient_step(learner, training, mdp, rows)

    with torch.no_grad():
        action = networks.act(group(before, "actor"), batch.next_observation)
        if algorithm == "td3":
            clip = training.smoothing_clip
            action = (action + (noise * training.smoothing_std).clamp(-clip, clip)).clamp(-1, 1)
        worse = networks.value(group(before, "critic"), batch.next_observation, action).amax(0)
        target = bootstrap(batch, worse, training)
    critic = group(before, "critic")
    error = networks.value(critic, batch.observation, batch.action) - target
    actor = group(before, "actor")
    improved = {name: value.detach()[0] for name, value in group(after, "critic").items()}
    expected = {
        "critic": gradients(critic, error.square().mean(-2).sum()),
        "actor": gradients(actor, actor_loss(actor, improved, batch, training)),
    }
    for kind, of_parameters in expected.items():
        for name, gradient in of_parameters.items():
            scale = gradient.abs().max()
            found = torch.from_numpy(after[f"{kind}_adam.mean.{name}"]) / 0.1
            worst = (found - gradient).abs().max() / scale
            assert worst < 1e-6, f"{kind} {name}: {worst:.1e} of {scale:.1e}"


# -- the loop against the torch engine

LOOPS = {
    "default": {},
    "plain": PLAIN,
    "batch norm": {**PLAIN, "batch_norm_actor": True},
    "layer norm": {**PLAIN, "layer_norm_critic": True},
    "roots": {**PLAIN, "critic_root_offset": 0.01},
    "saturated actor": {**PLAIN, **WIDE_ACTOR, "saturation_weight": 0.7},
    "n-step returns in a ring that is full": {"n_step": 3, "buffer_capacity": 50},
    "rarely moved actor": {"policy_delay": 3},
    "one row in a batch": {"batch_size": 1},
}

PREFILLED = {
    "prefill": {},
    "mixing share": {"mixing_share": 0.3},
    "prefill that fades": {"prefill_decay_steps": 90},
    "share that fades": {"mixing_share": 0.5, "prefill_decay_steps": 90},
    "cloning": {"cloning_weight": 2.0},
    "everything": {
        "cloning_weight": 0.5,
        "mixing_share": 0.25,
        "n_step": 4,
        "layer_norm_critic": True,
        "batch_norm_actor": True,
    },
}

WORLDS = {
    "1 ms": {"control_period_ms": 1.0, "discount": 0.99},
    "3 plant steps, rk4": {
        "control_period_ms": 3.0,
        "plant_step_ms": 1.0,
        "episode_duration_s": 0.03,
        "integrator": "rk4",
    },
    "force, contact": {"force_noise_std_n": 500.0, "terminate_on_contact": True, "contact_penalty": 0.2},
}


def agree(one, other, tolerance=1e-5):
    """Networks within the tolerance of 1 or of their largest number; moments within ten times that of their own.

    Where a gradient is near nothing, Adam makes of its rounding a part of a whole step.
    """
    for name, value in nets_of(one).items():
        size = float(np.abs(other[name]).max())
        allowed = 10 * tolerance * size if "adam" in name else tolerance * max(size, 1.0)
        assert float(np.abs(value - other[name]).max()) <= allowed, name


def ten_steps(algorithm, mdp=None, rows=None, **changes):
    learners = [make(algorithm, mdp=mdp, rows=rows, **changes) for make in (native, reference)]
    for learner in learners:
        learner.advance(EXPLORATORY + 10)
    kernel, torch_ = learners
    agree(kernel.state(), torch_.state())
    same_bits({"streams": kernel.state()["streams"]}, {"streams": torch_.state()["streams"]})
    return kernel.new_rows(), torch_.new_rows()


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_ten_steps_are_those_of_the_torch_engine(algorithm, loop, isa):
    kernel, torch_ = ten_steps(algorithm, **LOOPS[loop])
    np.testing.assert_allclose(kernel, torch_, atol=1e-5)


@pytest.mark.parametrize("loop", PREFILLED)
@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_a_prefill_is_used_as_the_torch_engine_uses_it(algorithm, loop):
    ten_steps(algorithm, rows=prefill(), **PREFILLED[loop])


@pytest.mark.parametrize("world", WORLDS)
def test_the_environment_is_that_of_the_torch_engine_to_the_last_bit(world):
    """Exploratory actions do not depend on rounding, so neither may what comes of them."""
    kernel, torch_ = ten_steps("td3", mdp=Mdp(**WORLDS[world]))
    np.testing.assert_array_equal(kernel[:EXPLORATORY], torch_[:EXPLORATORY])


def test_a_laboratory_levitator_moves_as_it_does_in_numpy(levitator):
    learners = [
        engine("td3", [0], levitator, Mdp(gap_scale_m=0.001, voltage_limit_v=5.0), settings(seeds=1, block=1))
        for engine in (NativeLearner, TorchLearner)
    ]
    for learner in learners:
        learner.advance(EXPLORATORY)
    np.testing.assert_array_equal(*(learner.new_rows() for learner in learners))


# -- bits


def trained(seeds, **changes):
    learner = native(seeds=seeds, **changes)
    learner.advance(EXPLORATORY + 100)
    return learner


@pytest.mark.parametrize("changes", [{}, {"batch_norm_actor": True}])
def test_a_seed_computes_the_same_alone_in_company_and_on_any_number_of_threads(changes, isa):
    starts_m = np.linspace(0.004, 0.015, 23)
    alone = trained([2], **changes)
    rows, response = alone.new_rows(), alone.responses(starts_m)
    for threads in (1, 2, 5):
        group_ = trained([1, 2, 3], threads=threads, **changes)
        same_bits({k: v[0] for k, v in alone.actors().items()}, {k: v[1] for k, v in group_.actors().items()})
        same_bits({k: v[:, 0] for k, v in alone.critics().items()}, {k: v[:, 1] for k, v in group_.critics().items()})
        np.testing.assert_array_equal(rows[:, 0], group_.new_rows()[:, 1])
        np.testing.assert_array_equal(response.gap_m, group_.responses(starts_m).gap_m[:, 23:46])


def test_a_response_does_not_depend_on_the_starts_beside_it():
    learner = trained([0])
    starts_m = np.linspace(0.004, 0.015, 23)
    together = learner.responses(starts_m)
    for index in (0, 7, 22):
        alone = learner.responses(starts_m[index : index + 1])
        np.testing.assert_array_equal(alone.voltage_v[:, 0], together.voltage_v[:, index])


def test_any_split_into_calls_gives_the_same_bits(isa):
    whole, split = native(), native()
    whole.advance(EXPLORATORY + 200)
    for steps in [EXPLORATORY - 1, 1, 1, 99, *[10] * 10]:
        split.advance(steps)
    same_bits(whole.state(), split.state())
    np.testing.assert_array_equal(whole.new_rows(), split.new_rows())


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
@pytest.mark.parametrize("changes", [{}, {"buffer_capacity": 120, "n_step": 3}])
def test_a_restored_learner_goes_on_with_the_same_bits(algorithm, changes):
    mdp = Mdp(force_noise_std_n=100.0)
    unbroken = native(algorithm, mdp=mdp, rows=prefill(), batch_norm_actor=True, **changes)
    unbroken.advance(EXPLORATORY + 77)
    state, rows = unbroken.state(), unbroken.new_rows()
    unbroken.advance(103)
    resumed = native(algorithm, mdp=mdp, rows=prefill(), batch_norm_actor=True, **changes)
    resumed.restore(state, rows)
    assert resumed.step == EXPLORATORY + 77
    resumed.advance(103)
    same_bits(unbroken.state(), resumed.state())
    np.testing.assert_array_equal(unbroken.new_rows(), resumed.new_rows())


@pytest.mark.skipif(not {"avx2", "avx512"} <= set(RUNNABLE), reason="needs a processor with AVX-512")
def test_avx512_computes_the_bits_of_avx2(monkeypatch):
    states = []
    for name in ("avx2", "avx512"):
        monkeypatch.setenv(ISA_VARIABLE, name)
        states.append(trained([0, 1]).state())
    same_bits(*states)


# -- what comes out


def test_responses_are_those_of_the_torch_rollout():
    """Over a time in which rounding does not yet grow."""
    mdp = Mdp(episode_duration_s=0.05, control_period_ms=5.0)
    learner = native(mdp=mdp)
    learner.advance(EXPLORATORY + 50)
    starts_m = np.array([0.006, 0.008, 0.012])
    found, expected = learner.responses(starts_m), roll_out(learner.actors(), Plant(), mdp, starts_m)
    np.testing.assert_array_equal(found.time_s, expected.time_s)
    for field in ("gap_m", "velocity_m_s", "current_a", "voltage_v"):
        np.testing.assert_allclose(getattr(found, field), getattr(expected, field), rtol=1e-4, err_msg=field)


def test_new_rows_are_told_once_and_in_the_order_of_time():
    learner = native()
    learner.advance(7)
    first = learner.new_rows()
    learner.advance(5)
    second = learner.new_rows()
    assert (first.shape, second.shape) == ((7, 2, WIDTH), (5, 2, WIDTH))
    np.testing.assert_array_equal(first[1:, :, :3], first[:-1, :, 5:8])
    np.testing.assert_array_equal(second[0, :, :3], first[-1, :, 5:8])
    assert learner.new_rows().shape == (0, 2, WIDTH)


def test_the_policys_tanh_is_exact_to_the_rounding_of_a_float(isa):
    """An actor that passes its first input to the tanh: the first voltage of a response shows it."""
    mdp = Mdp(episode_duration_s=0.01, gap_scale_m=0.001)
    learner = native(mdp=mdp, seeds=[0], hidden=(2, 2))
    state = learner.state()
    for name, value in {"w1": [[1, -1], [0, 0], [0, 0]], "w2": [[1, 0], [0, 1]], "w3": [[1], [-1]]}.items():
        state[f"actor.{name}"] = np.array([value], dtype=np.float32)
    for name in ("b1", "b2", "b3"):
        state[f"actor.{name}"] = np.zeros_like(state[f"actor.{name}"])
    learner.restore(state, learner.new_rows())
    starts_m = 0.008 + np.concatenate([np.linspace(-0.0075, 0.008, 4001), [0.0], np.geomspace(1e-9, 1e-4, 50)])
    x = ((starts_m - 0.008) / 0.001).astype(np.float32).astype(np.float64)
    found = (learner.responses(starts_m).voltage_v[0] - Plant().equilibrium().voltage_v) / mdp.voltage_limit_v
    np.testing.assert_allclose(found, np.tanh(x), rtol=2.5e-7, atol=1e-15)


@pytest.mark.parametrize("where", ["actor.w1", "critic.w2", "critic_adam.mean.b3"])
@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_a_seed_that_diverges_goes_on_as_not_a_number_and_alone(algorithm, where, isa):
    healthy, sick = native(algorithm), native(algorithm)
    for learner in (healthy, sick):
        learner.advance(EXPLORATORY + 5)
    state, rows = sick.state(), sick.new_rows()
    state[where] = state[where].copy()
    state[where][..., 1, 0, 0] = np.nan
    sick.restore(state, rows)
    for learner in (healthy, sick):
        learner.advance(40)
    assert any(np.isnan(value[1]).any() for value in sick.actors().values())
    same_bits({k: v[0] for k, v in healthy.actors().items()}, {k: v[0] for k, v in sick.actors().items()})
    assert np.isfinite(sick.responses(np.array([0.006])).gap_m).all()


def test_a_prefill_that_cannot_be_used_is_refused():
    with pytest.raises(InputError, match="do not fit"):
        native(rows=prefill(40), buffer_capacity=30)
    spoilt = prefill()
    spoilt[3, 4] = np.inf
    with pytest.raises(InputError, match="not finite"):
        native(rows=spoilt)


def test_what_a_lone_seed_gives_out_does_not_learn_on():
    settings = TrainingSettings(steps=40, exploratory_steps=20, batch_size=8, hidden=(8, 8))
    learner = NativeLearner("td3", [0], Plant(), Mdp(), settings)
    given = learner.actors()
    first = {name: values.copy() for name, values in given.items()}
    learner.advance(40)
    assert all(np.array_equal(given[name], values) for name, values in first.items())
    assert not all(np.array_equal(learner.actors()[name], values) for name, values in first.items())
