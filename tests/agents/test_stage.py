import pandas as pd
import pytest

from maglev_offline.agents import stage
from maglev_offline.agents.engine import Choice
from maglev_offline.agents.stage import Arm, load_curves, train_arms
from maglev_offline.workspace import Manifest, Workspace

ARM = Arm("ddpg", "empty", None)


def with_seeds(world, **changes):
    return world._replace(training=world.training.model_copy(update=changes))


@pytest.fixture
def workspace(tmp_path):
    return Workspace(tmp_path / "workspace")


def test_every_block_of_seeds_is_an_artefact_with_curves_policies_and_responses(workspace, world):
    folders, trained = train_arms(workspace, [ARM], with_seeds(world, seeds=5))
    assert trained == 2
    assert [folder.name for folder in folders[ARM]] == ["seeds-0000-0002", "seeds-0003-0004"]
    names = {path.name for path in folders[ARM][0].iterdir()}
    assert names == {"curves.parquet", "regulation.parquet", "last.safetensors", "best.safetensors", "manifest.json"}
    curves = load_curves(folders[ARM])
    assert sorted(curves["seed"].unique()) == [0, 1, 2, 3, 4]
    assert set(curves["algorithm"]) == {"ddpg"}
    responses = pd.concat([pd.read_parquet(folder / "regulation.parquet") for folder in folders[ARM]])
    assert sorted(responses["seed"].unique()) == [0, 1, 2, 3, 4]


def test_trained_blocks_are_taken_as_they_are_and_more_seeds_only_add_blocks(workspace, world):
    train_arms(workspace, [ARM], world)
    assert train_arms(workspace, [ARM], world)[1] == 0
    assert train_arms(workspace, [ARM], with_seeds(world, seeds=6))[1] == 1


def test_another_recipe_trains_again(workspace, world):
    train_arms(workspace, [ARM], world)
    assert train_arms(workspace, [ARM], with_seeds(world, exploration_std=0.3))[1] == 1


def test_processes_side_by_side_give_the_same_bytes(tmp_path, world):
    arms = [ARM, Arm("td3", "empty", None)]
    hashes = []
    for jobs in (1, 2):
        workspace = Workspace(tmp_path / str(jobs))
        folders, _ = train_arms(workspace, arms, world, jobs=jobs)
        hashes.append([Manifest.read(folder).files for arm in arms for folder in folders[arm]])
    assert hashes[0] == hashes[1]


def test_progress_counts_all_steps_of_all_arms(workspace, world, heard):
    train_arms(workspace, [ARM, Arm("td3", "empty", None)], world, jobs=2, progress=heard)
    assert heard.done == heard.total == 2 * 3 * world.training.steps


def test_the_manifest_names_engine_block_and_seeds(workspace, world, engine):
    folders, _ = train_arms(workspace, [ARM], with_seeds(world, engine=engine))
    facts = Manifest.read(folders[ARM][0]).facts
    assert facts["engine"] == engine
    assert facts["engine_why"] == "it was asked for"
    assert facts["instruction_set"]
    assert facts["compiler"]
    assert facts["seeds"] == [0, 1, 2]
    assert facts["diverged_seeds"] == []
    assert facts["diverged_at"] == {}
    assert isinstance(pd.read_parquet(folders[ARM][0] / "curves.parquet"), pd.DataFrame)


def test_how_often_a_checkpoint_is_made_and_how_the_engine_was_asked_for_change_no_block(workspace, world):
    train_arms(workspace, [ARM], world)
    assert train_arms(workspace, [ARM], with_seeds(world, checkpoint_every=3))[1] == 0


def test_another_engine_trains_again(workspace, world, monkeypatch):
    train_arms(workspace, [ARM], world)
    monkeypatch.setattr(stage, "choose_engine", lambda _: Choice("native", "it is the faster one"))
    missing = []
    monkeypatch.setattr(stage, "_announced", lambda tasks, *_: missing.extend(tasks) or "")
    monkeypatch.setattr(stage, "_train", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    monkeypatch.setattr(stage, "provenance", lambda _: {})
    with pytest.raises(KeyboardInterrupt):
        train_arms(workspace, [ARM], world)
    assert [task.engine.engine for task in missing] == ["native"]


def test_jobs_beyond_the_blocks_are_threads_of_the_native_engine_only(workspace, world, engine, monkeypatch):
    tasks = []
    monkeypatch.setattr(stage, "_announced", lambda missing, *_: tasks.extend(missing) or "")
    train_arms(workspace, [ARM], with_seeds(world, engine=engine), jobs=5)
    assert [task.threads for task in tasks] == [5 if engine == "native" else 1]


def test_the_run_says_which_engine_it_took_and_why(workspace, world, heard):
    train_arms(workspace, [ARM], world, progress=heard)
    assert any("Engine: torch, because it was asked for." in line for line in heard.said)


def test_the_event_files_lie_beside_the_artefacts(workspace, world, monkeypatch):
    folders = []

    class Files:
        def __init__(self, folder, seeds, from_step):
            folders.append((folder, seeds, from_step))

        def __enter__(self):
            return self

        def __exit__(self, *exc):
            return None

        def see(self, table):
            folders.append(table["env_step"].unique().tolist())

    monkeypatch.setattr("maglev_offline.agents.events.EventFiles", Files)
    train_arms(workspace, [ARM], world, tensorboard=True)
    assert folders == [(workspace.path("tensorboard", "ddpg-empty"), [0, 1, 2], 0), [0], [60], [120]]
