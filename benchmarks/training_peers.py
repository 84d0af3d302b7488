"""The ways to train that `training.py` compares, each run alone in a process of its own.

`python training_peers.py NAME ALGORITHM --steps N --warm-up M` runs one of them and prints one line of JSON: CPU and
wall seconds of N steps after M, each with a gradient step, the seeds that made them, and versions. Peers import of
maglev-offline the gymnasium environment only, so that they can run in an environment of their own.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

NATIVE, TORCH, STUDY, SCALING = "native", "torch", "study", "scaling"
SB3, SBX, LOOP, ENVIRONMENT, PEAK = "stable-baselines3", "sbx-rl", "CleanRL-style loop", "environment alone", "sgemm"

HIDDEN, BATCH, EXPLORATION_STD, DISCOUNT = 40, 100, 0.2, 0.9
PUBLISHED: dict[str, Any] = {
    "actor_learning_rate": 5e-4,
    "critic_learning_rate": 1e-3,
    "layer_norm_critic": False,
    "critic_root_offset": 0.0,
    "saturation_weight": 0.0,
}
"""The algorithms as published, which is what the peers run: nothing that this project adds by default."""

TORCH_SEEDS = 16
"""Seeds that the torch engine steps together."""

PEAK_SIZE = 2048

STUDY_SEEDS, STUDY_BLOCK, STUDY_ROWS, STUDY_SHORT_STEPS, CORES = 4, 4, 250_000, 500, 2
"""The part of the published study: seeds of each algorithm, the rows that lie in every buffer from the start (a run of
500,000 steps has as many on average), steps that are not on the clock, and the cores."""


class Sizes(NamedTuple):
    """Steps before the clock, and on it; the rows that lie in the buffer already."""

    warm_up: int
    steps: int
    rows: int


class Done(NamedTuple):
    """What was on the clock."""

    cpu_s: float
    wall_s: float
    steps: int
    seeds: int = 1
    updates: int = 0
    more: dict[str, Any] | None = None


def clocked(run: Callable[[], Any]) -> tuple[float, float]:
    """Run; return CPU seconds of the process, all threads, and wall seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    run()
    return time.process_time() - cpu, time.perf_counter() - wall


def ours(engine: str, algorithm: str, sizes: Sizes, seeds: int, threads: int = 1) -> Any:
    """A learner that has explored and warmed up."""
    from maglev_offline.agents.engine import make_learner
    from maglev_offline.agents.settings import TrainingSettings
    from maglev_offline.mdp import Mdp
    from maglev_offline.physics.parameters import Plant

    explore = 500
    settings = TrainingSettings(
        steps=explore + sizes.warm_up + sizes.steps,
        exploratory_steps=explore,
        block=seeds,
        hidden=(HIDDEN, HIDDEN),
        batch_size=BATCH,
        exploration_std=EXPLORATION_STD,
        buffer_capacity=sizes.rows + 1_000_000,
        **PUBLISHED,
    )
    prefill = packed_rows(sizes.rows) if sizes.rows else None
    learner = make_learner(
        engine, algorithm, list(range(seeds)), Plant(), Mdp(discount=DISCOUNT), settings, prefill, threads=threads
    )
    learner.advance(explore + sizes.warm_up)
    return learner


def made_up_rows(rows: int) -> dict[str, Any]:
    """Columns of a prefill, made up: they fill the buffer, and nobody asks what is learned from them."""
    import numpy as np

    rng = np.random.default_rng(0)
    return {
        "observation": rng.normal(size=(rows, 3)).astype(np.float32),
        "action": rng.uniform(-1, 1, rows).astype(np.float32),
        "cost": rng.uniform(0, 0.1, rows).astype(np.float32),
        "next_observation": rng.normal(size=(rows, 3)).astype(np.float32),
        "discount": np.full(rows, DISCOUNT, np.float32),
        "terminated": np.zeros(rows, np.bool_),
        "truncated": np.zeros(rows, np.bool_),
        "transition_row": np.arange(rows, dtype=np.int64),
    }


def packed_rows(rows: int) -> Any:
    """The same as a learner takes them."""
    from maglev_offline.replay.prefill import packed

    return packed(made_up_rows(rows))


def native(algorithm: str, sizes: Sizes) -> Done:
    """The kernel, one seed; `MAGLEV_OFFLINE_ISA` says with which instruction set."""
    from maglev_offline.agents.engine import provenance

    learner = ours("native", algorithm, sizes, 1)
    cpu_s, wall_s = clocked(lambda: learner.advance(sizes.steps))
    return Done(cpu_s, wall_s, sizes.steps, 1, sizes.steps, dict(provenance("native")))


def in_torch(algorithm: str, sizes: Sizes) -> Done:
    """The torch engine, a block of seeds."""
    learner = ours("torch", algorithm, sizes, TORCH_SEEDS)
    cpu_s, wall_s = clocked(lambda: learner.advance(sizes.steps))
    return Done(cpu_s, wall_s, sizes.steps, TORCH_SEEDS, sizes.steps)


def scaling(algorithm: str, sizes: Sizes) -> Done:
    """The kernel on two seeds, with one thread and then with two; the wall seconds of each."""
    one, two = (ours("native", algorithm, sizes, 2, threads) for threads in (1, 2))
    cpu_s, alone_s = clocked(lambda: one.advance(sizes.steps))
    _, wall_s = clocked(lambda: two.advance(sizes.steps))
    return Done(cpu_s, wall_s, sizes.steps, 2, sizes.steps, {"one_thread_s": alone_s, "two_threads_s": wall_s})


def environment() -> Any:
    """What the peers train in: control period 10 ms, no checks and no wrappers but gymnasium's own."""
    import gymnasium

    import maglev_offline.env  # noqa: F401 (it makes the environment known)

    return gymnasium.make("maglev_offline/Suspension-v0", disable_env_checker=True)


def environment_alone(algorithm: str, sizes: Sizes) -> Done:  # noqa: ARG001
    """The environment of the peers with nobody who learns: what is the least that they can take."""
    import numpy as np

    env = environment()
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (sizes.steps, 1)).astype(np.float32)

    def run() -> None:
        for action in actions:
            _, _, ended, cut, _ = env.step(action)
            if ended or cut:
                env.reset()

    cpu_s, wall_s = clocked(run)
    return Done(cpu_s, wall_s, sizes.steps)


def loop(algorithm: str, sizes: Sizes) -> Done:
    """`training_loop.Loop`."""
    import torch
    from training_loop import Loop

    torch.set_num_threads(1)
    run = Loop(environment(), twin=algorithm == "td3")
    run.run(BATCH + sizes.warm_up)
    before = run.updates
    cpu_s, wall_s = clocked(lambda: run.run(sizes.steps))
    return Done(cpu_s, wall_s, sizes.steps, 1, run.updates - before)


def stable_baselines3(algorithm: str, sizes: Sizes) -> Done:
    """stable-baselines3 as its documentation uses it; its own MLP of [40, 40], which sees the action first."""
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    kind = stable_baselines3.TD3 if algorithm == "td3" else stable_baselines3.DDPG
    return _learned(kind, sizes, tau=0.005, device="cpu")


def sbx(algorithm: str, sizes: Sizes) -> Done:
    """sbx-rl, stable-baselines3 on JAX, compiled before the clock starts; its own MLP of [40, 40]."""
    import sbx

    return _learned(sbx.TD3 if algorithm == "td3" else sbx.DDPG, sizes, tau=0.005)


def _learned(kind: Any, sizes: Sizes, **options: Any) -> Done:
    import numpy as np
    from stable_baselines3.common.noise import NormalActionNoise

    model = kind(
        "MlpPolicy",
        environment(),
        learning_starts=BATCH,
        batch_size=BATCH,
        gamma=DISCOUNT,
        train_freq=1,
        gradient_steps=1,
        action_noise=NormalActionNoise(np.zeros(1), np.full(1, EXPLORATION_STD)),
        policy_kwargs={"net_arch": [HIDDEN, HIDDEN]},
        seed=0,
        **options,
    )
    never = 10**9  # no logging
    model.learn(BATCH + sizes.warm_up, log_interval=never)
    before = model._n_updates
    cpu_s, wall_s = clocked(lambda: model.learn(sizes.steps, log_interval=never, reset_num_timesteps=False))
    return Done(cpu_s, wall_s, sizes.steps, 1, model._n_updates - before)


def peak(algorithm: str, sizes: Sizes) -> Done:  # noqa: ARG001
    """numpy's product of two float32 matrices of 2048: the floating-point operations of a core. `steps`: products."""
    import numpy as np

    a, b = np.random.default_rng(0).normal(size=(2, PEAK_SIZE, PEAK_SIZE)).astype(np.float32)
    product = a @ b
    cpu_s, wall_s = clocked(lambda: [np.matmul(a, b, out=product) for _ in range(sizes.steps)])
    return Done(cpu_s, wall_s, sizes.steps, more={"flops": 2 * PEAK_SIZE**3 * sizes.steps})


def study(algorithm: str, sizes: Sizes) -> Done:  # noqa: ARG001
    """The published study's recipe on `STUDY_SEEDS` seeds of both algorithms, with all that `train` does, on two cores.

    `steps`: of each run, beyond the first few hundred, whose time is taken off: with it goes what a run costs once. Its
    evaluations are every 5,000 steps, and its buffers hold `rows` rows from the start.
    """
    import joblib

    from maglev_offline.agents.engine import provenance
    from maglev_offline.agents.stage import Arm, World, train_arms
    from maglev_offline.recipe import load_recipe
    from maglev_offline.workspace import Workspace

    recipe = load_recipe(Path(__file__).parents[1] / "pipelines" / "changsha.toml")
    workers = joblib.Parallel(n_jobs=CORES)

    def cpu_s_of_workers() -> dict[int, float]:
        return dict(workers(joblib.delayed(_cpu_s_of_worker)() for _ in range(CORES)))

    def train(folder: Path, steps: int) -> tuple[float, float]:
        """CPU and wall seconds for that many steps of each run, by this process and its workers."""
        explore = steps * recipe.training.exploratory_steps // recipe.training.steps
        part = {"seeds": STUDY_SEEDS, "block": STUDY_BLOCK, "engine": "native"}
        training = recipe.training.model_copy(update={**part, "steps": steps, "exploratory_steps": explore})
        world = World(recipe.plant, recipe.mdp, training, recipe.evaluation)
        workspace = Workspace(folder / f"{steps}-steps")
        arms = [Arm(name, "prefill", _made_up_prefill(workspace, name, sizes.rows)) for name in training.algorithms]
        before = cpu_s_of_workers()
        cpu_s, wall_s = clocked(lambda: train_arms(workspace, arms, world, jobs=CORES))
        after = cpu_s_of_workers()
        if len(before) != CORES or set(before) != set(after):
            raise RuntimeError(f"the work was not done by the {CORES} processes that it was timed in")
        return cpu_s + sum(after[process] - before[process] for process in before), wall_s

    with tempfile.TemporaryDirectory() as folder:
        start_s = train(Path(folder), STUDY_SHORT_STEPS // 2)[1]  # everything is imported then
        once_cpu_s, once_wall_s = train(Path(folder), STUDY_SHORT_STEPS)
        cpu_s, wall_s = train(Path(folder), STUDY_SHORT_STEPS + sizes.steps)
    seeds = STUDY_SEEDS * len(recipe.training.algorithms)
    about = {"start_s": start_s, **provenance("native")}
    return Done(cpu_s - once_cpu_s, wall_s - once_wall_s, sizes.steps, seeds, sizes.steps, about)


def _cpu_s_of_worker() -> tuple[int, float]:
    """This process, and the CPU seconds that it has taken. Long enough that no worker is asked twice."""
    time.sleep(0.5)
    return os.getpid(), time.process_time()


def _made_up_prefill(workspace: Any, algorithm: str, rows: int) -> Path:
    from safetensors.numpy import save_file

    from maglev_offline.workspace import Manifest

    home: Path = workspace.path("prefill", algorithm)
    with workspace.commit(home, Manifest(f"prefill/{algorithm}", "made up", {})) as draft:
        save_file(made_up_rows(rows), draft / "prefill.safetensors")
    return home


CONTENDERS: dict[str, Callable[[str, Sizes], Done]] = {
    NATIVE: native,
    TORCH: in_torch,
    SCALING: scaling,
    STUDY: study,
    LOOP: loop,
    SB3: stable_baselines3,
    SBX: sbx,
    ENVIRONMENT: environment_alone,
    PEAK: peak,
}

ON_ALL_CORES = (SCALING, STUDY)

PACKAGES = ("maglev-offline", "numpy", "torch", "gymnasium", "stable-baselines3", "sbx-rl", "jax", "jaxlib", "flax")


def versions() -> dict[str, str]:
    """Versions of the packages that are there."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run one way to train, print what it took; exit with 3 where it is not installed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=CONTENDERS)
    parser.add_argument("algorithm", choices=("ddpg", "td3"))
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--warm-up", type=int, default=500)
    parser.add_argument("--rows", type=int, default=0, help="rows that lie in the buffer already; ours only")
    chosen = parser.parse_args(arguments)
    if chosen.name not in ON_ALL_CORES and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # no library starts threads for cores that it sees
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        done = CONTENDERS[chosen.name](chosen.algorithm, Sizes(chosen.warm_up, chosen.steps, chosen.rows))
    except ImportError as error:
        print(error, file=sys.stderr)
        return 3
    print(json.dumps(done._asdict() | {"versions": versions()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
