"""A disk that is full or may not be written to: told in a sentence; once that is mended, all is as if it never was."""

import os

import pytest


def failed_and_again(harness, nursery, road, folder, stage, code, said, **fault):
    road.copy(stage, folder)
    before = harness.digest(folder)
    first = nursery.run(folder, *harness.STAGES[stage], **fault)
    if first.code != 0:  # a cache that cannot be written is no failure
        assert first.code == code, first.err
        assert any(words in first.err for words in said), first.err
        assert "failure of maglev-offline itself" not in first.err
        left = harness.digest(folder)
        assert [name for name in left if ".draft" in name or name.endswith(".old")] == []
        assert {name: left.get(name) for name in before if name.startswith("logs")}.items() <= before.items()
    assert harness.half_written(folder) == []
    second = nursery.run(folder, *harness.STAGES[stage])
    assert second.code == 0, second.err
    assert harness.digest(folder) == road.undisturbed(stage), fault
    return first.code != 0


FULL = ("there is no room left to write.",)
DENIED = ("it cannot be used (Permission denied).", "cannot be opened")


def test_a_full_disk(harness, nursery, road, tmp_path):
    failed = [
        failed_and_again(harness, nursery, road, tmp_path / "w", "prefill", 1, FULL, kind="full", at=at)
        for at in harness.points(road.steps("prefill"), 2, seed=4)
    ]
    assert any(failed)


@pytest.mark.parametrize("stage", ["prefill", pytest.param("ingest", marks=pytest.mark.faults)])
def test_a_file_that_would_be_too_large(harness, nursery, road, tmp_path, stage):
    """The limit holds for what pyarrow and safetensors write too, which is cut in the middle."""
    assert failed_and_again(harness, nursery, road, tmp_path / "w", stage, 1, FULL, most_bytes=2000)


def test_a_file_that_may_not_be_written(harness, nursery, road, tmp_path):
    at = road.steps("prefill") // 2
    assert failed_and_again(harness, nursery, road, tmp_path / "w", "prefill", 2, DENIED, kind="denied", at=at)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_workspace_that_is_read_only(harness, nursery, road, tmp_path):
    folder = road.copy("prefill", tmp_path / "w")
    (folder / "workspace").chmod(0o555)
    ended = nursery.run(folder, *harness.STAGES["prefill"])
    (folder / "workspace").chmod(0o755)
    assert ended.code == 2
    assert "Permission denied" in ended.err


@pytest.mark.faults
@pytest.mark.parametrize("stage", ["surrogate", "ingest", "curate", "prefill", "control", "train", "transfer", "card",
                                   "report", "export"])  # fmt: skip
def test_full_disks_and_denials_at_many_steps(harness, nursery, road, tmp_path, stage, count):
    failed = []
    for at in harness.points(road.steps(stage), count, seed=5):
        for kind, code, said in (("full", 1, FULL), ("denied", 2, DENIED)):
            failed.append(failed_and_again(harness, nursery, road, tmp_path / "w", stage, code, said, kind=kind, at=at))
    assert any(failed), "no step of it was one that a fault stops"
