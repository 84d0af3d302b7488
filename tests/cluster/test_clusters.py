"""Dask and Ray with two workers each: the bytes of one process, whatever becomes of a worker or of the command."""

import os
import signal

import pytest

pytestmark = pytest.mark.nightly

BEFORE_TRAINING = ("samples", "shared_content", "transitions", "prefill")


def only(part, hashes):
    return {name: sha256 for name, sha256 in hashes.items() if name.split("/")[0] in part}


def process_of(path):
    """The process that a draft or a file of ticks is of; both are named by machine and process."""
    return next(int(number) for number in path.name.replace(".", "-").split("-")[::-1] if number.isdigit())


def test_the_whole_road_gives_the_same_bytes(place, cluster):
    name = cluster[1]
    place.run("ingest", "logs", "--recipe", "recipe.toml", "--workspace", name, *cluster)
    place.run("curate", "--construction", "reconstructed", "--workspace", name, *cluster)
    place.run("prefill", "--workspace", name)
    said = place.run("transfer", "--workspace", name, *cluster)
    assert "2 tasks at once, 2 of them used" in said
    assert place.bytes_of(name) == place.bytes_of("alone")


def test_a_worker_that_is_killed_while_it_ingests_changes_no_byte(place, cluster):
    name = f"{cluster[1]}-ingest"
    command = place.begin("ingest", "logs", "--recipe", "recipe.toml", "--workspace", name, *cluster)
    os.kill(process_of(place.first(f"{name}/samples/.*.draft")), signal.SIGKILL)
    _, err = command.communicate(timeout=200)
    assert command.returncode == 0, err
    assert only("samples", place.bytes_of(name)) == only("samples", place.bytes_of("alone"))


def test_a_worker_that_is_killed_while_it_trains_changes_no_byte_and_its_block_goes_on(place, cluster):
    name = place.copy(f"{cluster[1]}-train", *BEFORE_TRAINING)
    command = place.begin("transfer", "--recipe", "recipe.toml", "--workspace", name, *cluster)
    place.first(f"{name}/training/*/.seeds-*.partial/state.safetensors")
    counting = [path for path in place.first(f"{name}/.ticks-*").iterdir() if path.name != "owner"]
    os.kill(int(counting[0].name.split("-")[-2]), signal.SIGKILL)
    _, err = command.communicate(timeout=200)
    assert command.returncode == 0, err
    assert only("training", place.bytes_of(name)) == only("training", place.bytes_of("alone"))


def test_after_a_command_that_was_killed_its_workers_stop_and_the_next_goes_on(place, cluster):
    name = place.copy(f"{cluster[1]}-again", *BEFORE_TRAINING)
    argv = ("transfer", "--recipe", "recipe.toml", "--workspace", name, *cluster)
    command = place.begin(*argv)
    place.first(f"{name}/training/*/.seeds-*.partial/state.safetensors")
    command.kill()
    command.communicate()
    assert "goes on at step" in place.run(*argv)
    assert only("training", place.bytes_of(name)) == only("training", place.bytes_of("alone"))
    assert not [path.name for path in (place.folder / name).iterdir() if path.name.startswith((".ticks", ".seen"))]


def test_a_workspace_that_the_workers_do_not_see_is_refused(place, cluster):
    hidden = place.folder / "hidden"
    hidden.mkdir()
    said = place.run("train", "--workspace", "/proc/self/cwd/hidden", *cluster, code=2)
    assert "does not see the workspace" in said
