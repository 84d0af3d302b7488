import pandas as pd
import pytest

from maglev_offline.agents.stage import Arm, load_curves, train_arms
from maglev_offline.progress import Silent
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


def test_progress_counts_all_steps_of_all_arms(workspace, world):
    class Counter(Silent):
        total = done = 0

        def task(self, title, total, unit):
            self.total = total
            return self

        def __enter__(self):
            return self.tick

        def __exit__(self, *exc):
            return None

        def tick(self, done):
            self.done += done

    counter = Counter()
    train_arms(workspace, [ARM, Arm("td3", "empty", None)], world, jobs=2, progress=counter)
    assert counter.done == counter.total == 2 * 3 * world.training.steps


def test_the_manifest_names_engine_block_and_seeds(workspace, world):
    folders, _ = train_arms(workspace, [ARM], world)
    facts = Manifest.read(folders[ARM][0]).facts
    assert facts["engine"] == "torch"
    assert facts["seeds"] == [0, 1, 2]
    assert facts["diverged_seeds"] == []
    assert isinstance(pd.read_parquet(folders[ARM][0] / "curves.parquet"), pd.DataFrame)
