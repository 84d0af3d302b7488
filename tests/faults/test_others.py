"""Inputs that go away while they are read, and two commands at once."""

import shutil

import pytest


def test_the_second_of_two_commands_says_who_is_at_work(harness, nursery, road, tmp_path):
    folder = road.copy("prefill", tmp_path / "w")
    process = nursery.stop(folder, *harness.STAGES["prefill"], at=road.steps("prefill") // 2)
    second = nursery.meanwhile(folder, *harness.STAGES["prefill"])
    assert second.code == 1
    assert f"the workspace is in use by `maglev-offline prefill` (process {process})." in second.err
    assert nursery.go_on().code == 0
    assert harness.digest(folder) == road.undisturbed("prefill")


@pytest.mark.nightly
def test_a_log_that_goes_away_while_it_is_read_is_refused(harness, nursery, road, tmp_path):
    folder = road.copy("ingest", tmp_path / "w")
    (one, *_) = sorted((folder / "logs").glob("*.mcap"))
    content = one.read_bytes()
    for at in range(8, 20):  # until it is there when it is hashed, and gone when it was read
        shutil.rmtree(folder / "workspace", ignore_errors=True)
        one.write_bytes(content)
        ended = nursery.run(folder, *harness.STAGES["ingest"], kind="gone", at=at, of=one)
        assert ended.code == 2, ended.err
        assert one.name in ended.err
        if "changed or removed while it was read" in ended.err:
            break
    else:
        pytest.fail("the log never went away while it was read")
    shutil.rmtree(folder / "workspace")
    one.write_bytes(content)
    assert nursery.run(folder, *harness.STAGES["ingest"]).code == 0
    assert harness.digest(folder) == road.undisturbed("ingest")


def test_an_input_artefact_that_goes_away_is_told(harness, nursery, road, tmp_path):
    folder = road.copy("prefill", tmp_path / "w")
    of = folder / "workspace/transitions"
    kept = shutil.copytree(of, tmp_path / "kept")
    ended = nursery.run(folder, *harness.STAGES["prefill"], kind="gone", at=2, of=of)
    assert ended.code == 2, ended.err
    assert "failure of maglev-offline itself" not in ended.err
    shutil.copytree(kept, of)
    assert nursery.run(folder, *harness.STAGES["prefill"]).code == 0
    assert harness.digest(folder) == road.undisturbed("prefill")


@pytest.mark.faults
@pytest.mark.parametrize("stage", ["ingest", "curate", "prefill", "train", "transfer"])
def test_inputs_that_go_away_at_many_steps(harness, nursery, road, tmp_path, stage, count):
    sources = {"ingest": "logs", "curate": "workspace/samples", "prefill": "workspace/transitions",
               "train": "recipe.toml", "transfer": "workspace/prefill/ddpg"}  # fmt: skip
    for at in harness.points(road.steps(stage), count, seed=6):
        folder = road.copy(stage, tmp_path / "w")
        of = folder / sources[stage]
        ended = nursery.run(folder, *harness.STAGES[stage], kind="gone", at=at, of=of)
        assert ended.code in (0, 2), ended.err
        assert harness.half_written(folder) == []
        shutil.rmtree(of, ignore_errors=True)
        source = road.before(stage) / sources[stage]
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, of)
        assert nursery.run(folder, *harness.STAGES[stage]).code == 0
        assert harness.digest(folder) == road.undisturbed(stage), at
