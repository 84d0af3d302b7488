import pytest

from maglev_offline.errors import InputError
from maglev_offline.policies.export import export_policy, file_name
from maglev_offline.policies.tensors import load_policy


def test_files_are_named_after_the_policy(policy):
    assert file_name(policy, "c") == "td3-empty-seed-0003-best.h"
    assert file_name(policy, "onnx") == "td3-empty-seed-0003-best.onnx"


def test_a_file_appears_whole_in_a_folder_that_is_made_for_it(policy, tmp_path):
    path = tmp_path / "new" / "policy.safetensors"
    for _ in range(2):
        export_policy(policy, "safetensors", path)
    assert load_policy(path).origin == policy.origin
    assert [p.name for p in path.parent.iterdir()] == ["policy.safetensors"]


def test_a_folder_is_no_file(policy, tmp_path):
    with pytest.raises(InputError, match="this is a folder"):
        export_policy(policy, "c", tmp_path)
