import sys
from types import SimpleNamespace

import pandas as pd
import pytest

from maglev_offline.agents import events
from maglev_offline.agents.events import EventFiles, require_tensorboard
from maglev_offline.errors import InputError

TABLE = pd.DataFrame({"seed": [0, 1], "env_step": 50, "cost": [1.5, 2.5], "settling_time_s": [float("nan"), 0.1]})


@pytest.fixture
def written(monkeypatch):
    """TensorBoard's writer, replaced by one that tells what it was given."""
    calls = []

    class Writer:
        def __init__(self, folder, purge_step):
            self.folder = folder
            calls.append(("open", folder, purge_step))

        def add_scalar(self, tag, value, step):
            calls.append((tag, value, step))

        def flush(self):
            pass

        def close(self):
            calls.append(("close", self.folder))

    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", SimpleNamespace(SummaryWriter=Writer))
    return calls


def test_every_seed_has_a_folder_and_every_number_of_its_evaluation_a_curve(tmp_path, written):
    with EventFiles(tmp_path, [0, 1], 0) as files:
        files.see(TABLE)
    zero, one = f"{tmp_path}/seed-0000", f"{tmp_path}/seed-0001"
    assert written == [
        ("open", zero, None),
        ("open", one, None),
        ("evaluation/cost", 1.5, 50),
        ("evaluation/cost", 2.5, 50),
        ("evaluation/settling_time_s", 0.1, 50),
        ("close", zero),
        ("close", one),
    ]


def test_a_new_run_begins_anew_and_one_that_goes_on_takes_back_what_came_after_its_checkpoint(tmp_path, written):
    old = tmp_path / "seed-0000" / "events.out"
    old.parent.mkdir()
    old.touch()
    with EventFiles(tmp_path, [0], 400):
        assert old.exists()
    with EventFiles(tmp_path, [0], 0):
        assert not old.exists()
    assert [call[2] for call in written if call[0] == "open"] == [401, None]


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(events, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"--tensorboard: TensorBoard is not installed.*\[tensorboard\]"):
        require_tensorboard()


def test_the_event_files_are_tensorboards_own(tmp_path):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with EventFiles(tmp_path, [0, 1], 0) as files:
        files.see(TABLE)
    found = EventAccumulator(str(tmp_path / "seed-0001")).Reload()
    assert [(e.step, e.value) for e in found.Scalars("evaluation/cost")] == [(50, 2.5)]
