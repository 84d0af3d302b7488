"""Dask and Ray with two workers each: the bytes of one process, whatever becomes of a worker or of the command."""

import os
import signal

import pytest

pytestmark = pytest.mark.nightly

BEFORE_TRAINING = ("samples", "shared_content", "transitions", "prefill")


def only(part, hashes):
    return {name: sha256 for name, sha256 in hashes.items() if name.split("/")[0] in part}


def hidden(home, *ends):
    return [path.name for path in home.iterdir() if path.name.startswith(".") and path.name.endswith(ends)]


def counting(home):
    """Processes of the workers that count steps; their files are named by machine, process and thread."""
    names = [path.name for path in home.glob(".ticks.*.draft/*") if path.name != "owner"]
    return [int(name.split("-")[-2]) for name in names]


def test_the_whole_road_gives_the_same_bytes(place, cluster):
    name = cluster.name
    place.run("ingest", "logs", "--recipe", "recipe.toml", "--workspace", name, *cluster.options)
    place.run("curate", "--construction", "reconstructed", "--workspace", name, *cluster.options)
    place.run("prefill", "--workspace", name)
    said = place.run("transfer", "--workspace", name, *cluster.options)
    assert "2 tasks at once, 2 of them used" in said
    assert place.bytes_of(name) == place.bytes_of("alone")


def test_the_recovery_of_states_is_spread_and_gives_the_same_bytes(many_samples, cluster):
    name = cluster.name
    many_samples.copy(name, "samples", "shared_content")
    before = cluster.tasks()
    argv = ("curate", "--recipe", "recipe.toml", "--construction", "reconstructed")
    many_samples.run(*argv, "--workspace", name, *cluster.options)
    assert before is None or cluster.tasks() >= before + 2 * 3  # laws and states of three groups at the least
    assert only("transitions", many_samples.bytes_of(name)) == only("transitions", many_samples.bytes_of("alone"))


def test_a_worker_that_is_killed_while_it_ingests_changes_no_byte(place, cluster):
    name = f"{cluster.name}-ingest"
    command = place.begin("ingest", "logs", "--recipe", "recipe.toml", "--workspace", name, *cluster.options)
    place.first(f"{name}/samples/.*.draft")
    for process in cluster.at_work():  # all: which of them the draft is of, nobody tells
        os.kill(process, signal.SIGKILL)
    assert hidden(place.folder / name / "samples", ".draft"), "nothing was at work any more"
    _, err = command.communicate(timeout=200)
    assert command.returncode == 0, err
    assert only("samples", place.bytes_of(name)) == only("samples", place.bytes_of("alone"))
    assert hidden(place.folder / name / "samples", ".draft", ".old") == []


def test_a_worker_that_is_killed_while_it_trains_changes_no_byte(place, cluster):
    name = place.copy(f"{cluster.name}-train", *BEFORE_TRAINING)
    command = place.begin("transfer", "--recipe", "recipe.toml", "--workspace", name, *cluster.options)
    place.first(f"{name}/training/*/.seeds-*.partial/state.safetensors")
    os.kill(place.until(lambda: counting(place.folder / name))[0], signal.SIGKILL)
    _, err = command.communicate(timeout=200)
    assert command.returncode == 0, err
    assert only("training", place.bytes_of(name)) == only("training", place.bytes_of("alone"))


def test_after_a_command_that_was_killed_its_workers_stop_and_the_next_goes_on(place, cluster):
    name = place.copy(f"{cluster.name}-again", *BEFORE_TRAINING)
    argv = ("transfer", "--recipe", "recipe.toml", "--workspace", name, *cluster.options)
    command = place.begin(*argv)
    place.first(f"{name}/training/*/.seeds-*.partial/state.safetensors")
    command.kill()
    command.communicate()
    assert "goes on at step" in place.run(*argv)
    assert only("training", place.bytes_of(name)) == only("training", place.bytes_of("alone"))
    assert hidden(place.folder / name, ".draft") == []


def test_a_task_whose_workers_die_again_and_again_ends_the_command_in_words(place, cluster):
    name = f"{cluster.name}-lost"
    command = place.begin("ingest", "logs", "--recipe", "recipe.toml", "--workspace", name, *cluster.options, "-j", 1)
    samples, seen = place.folder / name / "samples", set()
    while command.poll() is None:
        drafts = set(hidden(samples, ".draft")) if samples.is_dir() else set()
        if drafts - seen:
            for process in cluster.at_work():
                os.kill(process, signal.SIGKILL)
        seen |= drafts
    _, err = command.communicate()
    assert command.returncode == 1, err
    assert "the cluster gave a task up" in err
    assert "give the same command again" in err
    assert 1 < len(seen) <= 4  # Dask may have given it to the other worker before that was killed too
    assert hidden(samples, ".draft") == []


def test_a_scheduler_that_dies_ends_the_command_and_elsewhere_it_goes_on(place, short_lived):
    """Ray ends the process itself, after a minute, as if it were killed: the words are Ray's."""
    name = place.copy(f"{short_lived.name}-gone", *BEFORE_TRAINING)
    argv = ("transfer", "--recipe", "recipe.toml", "--workspace", name)
    command = place.begin(*argv, *short_lived.options)
    place.first(f"{name}/training/*/.seeds-*.partial/state.safetensors")
    short_lived.end_scheduler()
    _, err = command.communicate(timeout=200)
    assert command.returncode == 1, err
    assert {"dask": "the cluster gave a task up", "ray": "The program will terminate"}[short_lived.name] in err
    assert "goes on at step" in place.run(*argv, "--jobs", 1)
    assert only("training", place.bytes_of(name)) == only("training", place.bytes_of("alone"))
    assert hidden(place.folder / name, ".draft") == []


def test_a_workspace_that_the_workers_do_not_see_is_refused(place, cluster):
    (place.folder / "hidden").mkdir(exist_ok=True)
    said = place.run("train", "--workspace", "/proc/self/cwd/hidden", *cluster.options, code=2)
    assert "does not see the workspace" in said
