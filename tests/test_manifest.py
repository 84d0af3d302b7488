import json

import pytest

from maglev_offline.errors import ArtefactError
from maglev_offline.manifest import Manifest


@pytest.fixture
def folder(tmp_path):
    facts = {"share": 0.1, "seeds": (1, 10, 2), "by": {10: "a", 2: "b"}, "none": None}
    manifest = Manifest("a", "f" * 64, {"log": "1"}, {"rows": 7}, facts=facts, files={"x/y.txt": "0" * 64})
    (tmp_path / "manifest.json").write_text(manifest.sealed())
    return tmp_path


def changed(folder, **changes):
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return folder


def test_what_was_sealed_is_read(folder):
    assert Manifest.read(folder).counts == {"rows": 7}
    assert Manifest.read(folder).facts["by"] == {"10": "a", "2": "b"}


@pytest.mark.parametrize("changes", [{"counts": {"rows": 8}}, {"facts": {}}, {"inputs": {}}, {"seal": "0" * 64}])
def test_a_manifest_that_was_changed_is_told_of(folder, changes):
    with pytest.raises(ArtefactError, match=r"it is not what was written"):
        Manifest.read(changed(folder, **changes))


def test_one_without_a_seal_was_written_by_an_older_version(folder):
    assert Manifest.read(changed(folder, counts={"rows": 8}, seal="")).counts == {"rows": 8}


@pytest.mark.parametrize("name", ["/dev/zero", "../other/x", "x\0"])
def test_no_file_of_it_lies_outside(folder, name):
    with pytest.raises(ArtefactError, match="is no file of the artefact"):
        Manifest.read(changed(folder, files={name: "0" * 64}))


@pytest.mark.parametrize("changes", [{"files": ["x"]}, {"files": {"x": 1}}, {"counts": 3}, {"artefact": None}])
def test_it_holds_what_a_manifest_holds(folder, changes):
    with pytest.raises(ArtefactError, match="manifest cannot be read"):
        Manifest.read(changed(folder, **changes))


def test_100_000_brackets_are_told_of(folder):
    (folder / "manifest.json").write_text("[" * 100_000)
    with pytest.raises(ArtefactError, match="manifest cannot be read"):
        Manifest.read(folder)
