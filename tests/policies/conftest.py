"""Actors that were never trained, and training artefacts that hold them: seconds are for training."""

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from maglev_offline.agents import networks
from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.policy import Origin, Policy
from maglev_offline.streams import stream
from maglev_offline.workspace import Manifest, Workspace, fingerprint

ORIGIN = Origin("td3", "empty", 3, "best", "torch", "training/td3-empty/seeds-0003-0003", "f" * 64, "a" * 64, "b" * 64)


def actor(seed, hidden=(40, 40), *, batch_norm=False, last_layer_scale=3.0):
    """An actor of `networks.py` whose outputs reach from limit to limit; with batch norm, its statistics have moved."""
    rng = stream(seed, "actor of a test")
    net = networks.init_actor(rng, hidden, last_layer_scale, batch_norm)
    for name, value in net.items():
        if name.startswith(("gain", "var")):
            net[name] = torch.tensor(rng.uniform(0.3, 2.0, value.shape), dtype=torch.float32)
        elif name.startswith(("shift", "mean")):
            net[name] = torch.tensor(rng.normal(size=value.shape), dtype=torch.float32)
    return net


def as_numpy(net):
    return {name: value.numpy() for name, value in net.items()}


@pytest.fixture(params=[False, True], ids=["plain", "batch_norm"])
def net(request):
    """An actor without and with batch norm, as torch tensors."""
    return actor(7, batch_norm=request.param)


@pytest.fixture
def policy(net):
    """The actor as a policy of the paper's plant."""
    return Policy(as_numpy(net), Plant(), Mdp(), ORIGIN)


@pytest.fixture(scope="session")
def states():
    """States (gap_m, velocity_m_s, current_a), each [n]: the whole range, the stops and the set-point, and beyond."""
    rng = np.random.default_rng(5)
    point = Plant().equilibrium()
    drawn = rng.uniform((0.0005, -0.5, 0.0), (0.016, 0.5, 60.0), (500, 3))
    edges = [
        (point.gap_m, 0.0, point.current_a),
        (0.0005, 0.0, 0.0),
        (0.016, 0.0, 120.0),
        (0.0, -3.0, -10.0),
        (1.0, 20.0, 1000.0),
    ]
    return tuple(np.concatenate([drawn, edges]).T)


@pytest.fixture(scope="session")
def not_finite():
    """States (gap_m, velocity_m_s, current_a), each [4], of which none can be used."""
    return tuple(
        np.array([(np.nan, 0.0, 20.0), (0.008, np.inf, 20.0), (0.008, 0.0, -np.inf), (np.inf, -np.inf, 20.0)]).T
    )


@pytest.fixture(scope="session")
def make_policy():
    """A policy of the paper's plant with an untrained actor, of `hidden` units and with other options of `actor`."""

    def make(seed=7, hidden=(40, 40), **options):
        return Policy(as_numpy(actor(seed, hidden, **options)), Plant(), Mdp(), ORIGIN)

    return make


@pytest.fixture
def workspace(tmp_path):
    return Workspace(tmp_path / "workspace")


@pytest.fixture
def trained(workspace):
    """Commit a training artefact of actors that were never trained, in the layout of `agents/stage.py`."""

    def commit(title="td3-empty", seeds=(0, 1, 2), folder=None, mdp=None, plant=None, **changes):
        training = TrainingSettings(hidden=(8, 8), seeds=len(seeds), block=len(seeds))
        tables = (plant or Plant(), mdp or Mdp(), training, EvaluationSettings())
        where = workspace.path("training", title, folder or f"seeds-{seeds[0]:04d}-{seeds[-1]:04d}")
        manifest = Manifest(f"training/{title}/{where.name}", fingerprint("train", {}, *tables, title=title), {})
        names = ("plant", "mdp", "training", "evaluation")
        manifest.settings = {name: table.model_dump(mode="json") for name, table in zip(names, tables, strict=True)}
        manifest.facts = {"algorithm": "td3", "arm": "empty", "seeds": list(seeds), "engine": "torch", **changes}
        with workspace.commit(where, manifest) as draft:
            for number, which in enumerate(("last", "best")):
                actors = [as_numpy(actor(100 * number + seed, (8, 8))) for seed in seeds]
                save_file(
                    {name: np.stack([net[name] for net in actors]) for name in actors[0]},
                    draft / f"{which}.safetensors",
                )
        return where

    return commit
