import json
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import save_file

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.policies.policy import metadata
from maglev_offline.policies.tensors import KEY, as_safetensors, load_policy


@pytest.fixture
def file(policy, tmp_path):
    path = tmp_path / "policy.safetensors"
    path.write_bytes(as_safetensors(policy))
    return path


def test_a_policy_comes_back_to_the_last_bit(policy, file, states):
    again = load_policy(file)
    assert again.net.keys() == policy.net.keys()
    assert np.array_equal(again.voltage(*states), policy.voltage(*states))
    assert (again.plant, again.mdp, again.origin) == (policy.plant, policy.mdp, policy.origin)
    assert metadata(again) == metadata(policy)


def test_another_process_writes_the_same_bytes(file):
    """The library writes several keys of metadata in an order that every process draws anew."""
    script = (
        "import sys; from pathlib import Path; from maglev_offline.policies.tensors import as_safetensors, load_policy;"
        "sys.stdout.buffer.write(as_safetensors(load_policy(Path(sys.argv[1]))))"
    )
    done = subprocess.run([sys.executable, "-c", script, str(file)], capture_output=True, check=True)
    assert done.stdout == file.read_bytes()


def test_a_file_that_is_missing_damaged_or_of_something_else_is_refused(policy, file, tmp_path):
    with pytest.raises(InputError, match="no such policy file"):
        load_policy(tmp_path / "nowhere.safetensors")
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(file.read_bytes()[:-3])
    with pytest.raises(ArtefactError, match="cannot be read as safetensors"):
        load_policy(damaged)
    save_file(dict(policy.net), damaged)
    with pytest.raises(ArtefactError, match="no policy that this version reads"):
        load_policy(damaged)
    for told in ("[]", "{", "7"):
        save_file(dict(policy.net), damaged, metadata={KEY: told})
        with pytest.raises(ArtefactError, match="read"):
            load_policy(damaged)
    half = {name: value for name, value in policy.net.items() if name != "w2"}
    save_file(half, damaged, metadata={KEY: json.dumps(metadata(policy))})
    with pytest.raises(ArtefactError, match="not an actor"):
        load_policy(damaged)
