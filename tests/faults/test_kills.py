"""A command that is killed, at a step or at any instant, and given again ends in the bytes of an undisturbed one."""

import random

import pytest


def killed_and_again(harness, nursery, road, folder, stage, **fault):
    """Kill a stage, look at what it left, and give it again; the first run's end."""
    road.copy(stage, folder)
    first = nursery.run(folder, *harness.STAGES[stage], **fault)
    assert harness.half_written(folder) == []
    second = nursery.run(folder, *harness.STAGES[stage])
    assert second.code == 0, second.err
    assert harness.digest(folder) == road.undisturbed(stage), fault
    return first


def test_a_kill_at_a_step(harness, nursery, road, tmp_path):
    for at in harness.points(road.steps("prefill"), 3, seed=1):
        first = killed_and_again(harness, nursery, road, tmp_path / "w", "prefill", kind="kill", at=at)
        assert first.code == -9


@pytest.mark.faults
@pytest.mark.parametrize("stage", ["surrogate", "ingest", "curate", "prefill", "control", "train", "transfer", "card",
                                   "report", "export"])  # fmt: skip
def test_kills_at_many_steps(harness, nursery, road, tmp_path, stage, count):
    for at in harness.points(road.steps(stage), count, seed=2):
        assert killed_and_again(harness, nursery, road, tmp_path / "w", stage, kind="kill", at=at).code == -9


@pytest.mark.faults
@pytest.mark.parametrize("stage", ["ingest", "curate", "prefill", "control", "train", "transfer", "report"])
def test_kills_at_any_instant(harness, nursery, road, tmp_path, stage, count):
    draw, most = random.Random(3), 4.0
    for _ in range(count):
        after = draw.uniform(0, most)
        first = killed_and_again(harness, nursery, road, tmp_path / "w", stage, kill_after_s=after)
        if first.code == 0:
            most = after  # it was done already: kill earlier
