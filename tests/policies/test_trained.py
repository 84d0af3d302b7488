import json

import numpy as np
import pytest
from safetensors.numpy import load_file

from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.trained import trained_policy
from maglev_offline.workspace import Manifest, sha256_of


@pytest.mark.parametrize("which", ["last", "best"])
def test_the_actor_of_the_seed_is_taken_with_its_plant_its_process_and_the_hashes(workspace, trained, which):
    folder = trained(seeds=(4, 5, 6), mdp=Mdp(control_period_ms=5), plant=Plant(mass_kg=650))
    policy = trained_policy(workspace, "td3", "empty", 5, which)
    stored = load_file(folder / f"{which}.safetensors")
    assert all(np.array_equal(policy.net[name], stored[name][1]) for name in stored)
    assert (policy.plant.mass_kg, policy.mdp.control_period_ms) == (650, 5)
    origin = policy.origin
    assert (origin.algorithm, origin.arm, origin.seed, origin.which) == ("td3", "empty", 5, which)
    assert origin.fingerprint == Manifest.read(folder).fingerprint
    assert origin.manifest_sha256 == sha256_of(folder / "manifest.json")
    assert origin.weights_sha256 == sha256_of(folder / f"{which}.safetensors")
    assert origin.artefact == "training/td3-empty/seeds-0004-0006"


def test_algorithm_and_arm_may_be_left_out_where_there_is_one(workspace, trained):
    trained("ddpg-prefill")
    assert trained_policy(workspace, None, None, 0, "best").origin.arm == "prefill"
    trained("td3-prefill")
    assert trained_policy(workspace, "TD3", None, 0, "best").origin.algorithm == "td3"
    with pytest.raises(InputError, match="several arms fit: ddpg-prefill, td3-prefill"):
        trained_policy(workspace, None, "prefill", 0, "best")
    with pytest.raises(InputError, match=r"--algo td3 and --arm empty was not trained.*ddpg-prefill, td3-prefill"):
        trained_policy(workspace, "td3", "empty", 0, "best")


def test_before_any_training_it_says_what_to_run(workspace):
    with pytest.raises(ArtefactError, match=r"no agent has been trained.*maglev-offline train"):
        trained_policy(workspace, None, None, 0, "best")
    workspace.path("training", "td3-empty", ".seeds-0000-0001.draft").mkdir(parents=True)
    with pytest.raises(ArtefactError, match="no agent has been trained"):
        trained_policy(workspace, None, None, 0, "best")


def test_a_seed_that_is_not_there_is_told_those_that_are(workspace, trained):
    trained(seeds=(0, 1, 2))
    trained(seeds=(7,))
    with pytest.raises(InputError, match=r"seed 3 of td3-empty was not trained.*seeds 0 to 2, 7\."):
        trained_policy(workspace, None, None, 3, "best")


def test_a_seed_that_was_trained_twice_is_the_one_of_the_recipe(workspace, trained):
    trained(seeds=(0, 1), mdp=Mdp(control_period_ms=5))
    trained(seeds=(0, 1, 2), mdp=Mdp(control_period_ms=10))
    recipe = (Plant(), Mdp(control_period_ms=5), TrainingSettings(hidden=(8, 8), seeds=50))
    assert trained_policy(workspace, None, None, 0, "best", *recipe).mdp.control_period_ms == 5
    with pytest.raises(InputError, match=r"more than once: seeds-0000-0001, seeds-0000-0002\..*--recipe"):
        trained_policy(workspace, None, None, 0, "best", Plant(), Mdp(control_period_ms=1))


def test_an_artefact_that_was_changed_is_refused(workspace, trained):
    folder = trained()
    path = folder / "best.safetensors"
    path.write_bytes(path.read_bytes()[:-1] + b"\1")
    with pytest.raises(ArtefactError, match=r"best.safetensors is not what was written"):
        trained_policy(workspace, None, None, 0, "best")
    path.unlink()
    with pytest.raises(ArtefactError, match=r"best.safetensors is not what was written"):
        trained_policy(workspace, None, None, 0, "last")


def test_an_artefact_whose_content_cannot_be_is_refused(workspace, trained):
    folder = trained()
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["seal"] = ""
    manifest["settings"]["mdp"]["control_period_ms"] = -1
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ArtefactError, match="cannot be read"):
        trained_policy(workspace, None, None, 0, "best")
    manifest["settings"]["mdp"]["control_period_ms"] = 10
    (folder / "best.safetensors").write_bytes(b"no tensors at all")
    manifest["files"]["best.safetensors"] = sha256_of(folder / "best.safetensors")
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ArtefactError, match="cannot be read"):
        trained_policy(workspace, None, None, 0, "best")
