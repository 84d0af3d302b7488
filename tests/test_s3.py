"""A store that speaks S3, served here by moto: logs in it, a workspace in it, and what goes wrong with it."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.nightly

pytest.importorskip("moto")
boto3 = pytest.importorskip("boto3")

ROOT = Path(__file__).parents[1]
RECIPE = """
name = "store"
[mdp]
episode_duration_s = 0.1
[curate]
target_rows = 100
[training]
algorithms = ["ddpg"]
seeds = 1
steps = 600
exploratory_steps = 60
batch_size = 8
hidden = [4, 4]
[evaluation]
every_steps = 60
start_gaps_m = [0.006, 0.015]
selection_gaps_m = [0.01]
"""


@pytest.fixture(scope="module")
def server():
    from moto.server import ThreadedMotoServer

    serving = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    serving.start()
    host, port = serving.get_host_and_port()
    yield f"http://{host}:{port}"
    serving.stop()


class Store:
    """A bucket with three logs, and commands that use it."""

    def __init__(self, folder, server):
        self.folder, self.server = folder, server
        self.client = boto3.client(
            "s3", endpoint_url=server, region_name="us-east-1", aws_access_key_id="key", aws_secret_access_key="secret"
        )
        self.client.create_bucket(Bucket="bucket")
        (folder / "recipe.toml").write_text(RECIPE)
        self.run("surrogate", "logs", "--logs", 2, "--points", 1, "--duration-s", 20)
        for path in (folder / "logs").glob("*.mcap"):
            self.client.upload_file(str(path), "bucket", f"logs/{path.name}")

    def begin(self, *argv, cache="cache", **more):
        known = {
            **os.environ,
            "AWS_ACCESS_KEY_ID": "key",
            "AWS_SECRET_ACCESS_KEY": "secret",
            "AWS_REGION": "us-east-1",
            "AWS_EC2_METADATA_DISABLED": "true",
            "AWS_ENDPOINT_URL": self.server,
            "MAGLEV_OFFLINE_CACHE": str(self.folder / cache),
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": str(ROOT),
            **more,
        }
        command = [sys.executable, "-m", "maglev_offline", *map(str, argv), "-q"]
        return subprocess.Popen(
            command, cwd=self.folder, env=known, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def run(self, *argv, code=0, **more):
        process = self.begin(*argv, **more)
        out, err = process.communicate(timeout=120)
        assert process.returncode == code, err
        return out + err

    def road(self, logs, workspace):
        self.run("ingest", logs, "--recipe", "recipe.toml", "--workspace", workspace, "--jobs", 1)
        self.run("curate", "--construction", "semi_markov", "--workspace", workspace, "--jobs", 1)
        self.run("prefill", "--workspace", workspace)
        self.run("train", "--arm", "prefill", "--workspace", workspace, "--jobs", 1)

    def keys(self, prefix):
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket="bucket", Prefix=prefix)
        return [entry["Key"] for page in pages for entry in page.get("Contents", []) if entry["Key"][-1] != "/"]

    def folders(self, prefix):
        """Folders that S3 keeps as empty objects."""
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket="bucket", Prefix=prefix)
        return [entry["Key"] for page in pages for entry in page.get("Contents", []) if entry["Key"][-1] == "/"]

    def hash_of(self, key):
        return hashlib.sha256(self.client.get_object(Bucket="bucket", Key=key)["Body"].read()).hexdigest()


@pytest.fixture(scope="module")
def store(tmp_path_factory, server):
    return Store(tmp_path_factory.mktemp("s3"), server)


@pytest.fixture(scope="module")
def done(store):
    """The road on logs and in a workspace of the store, and the same in folders."""
    store.road("s3://bucket/logs/*.mcap", "s3://bucket/work")
    store.road("logs", "work")
    return store


def hashes(home):
    files = (path for path in home.rglob("*") if path.is_file())
    return {
        path.relative_to(home).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if not any(part.startswith(".") for part in path.relative_to(home).parts)
    }


def test_logs_and_a_workspace_in_a_bucket_give_the_bytes_of_folders(done):
    here = hashes(done.folder / "work")
    there = {key.removeprefix("work/"): done.hash_of(key) for key in done.keys("work/")}
    assert sorted(there.values()) == sorted(here.values())
    manifests = [name for name in here if name.endswith("manifest.json")]
    assert manifests
    assert [there[name] for name in manifests] == [here[name] for name in manifests]
    assert not [key for key in done.keys("work/") if ".lock" in key or ".draft" in key]
    files = done.keys("work/")
    assert not [folder for folder in done.folders("work/") if not any(key.startswith(folder) for key in files)]


def test_another_machine_finds_it_there_and_has_nothing_to_do(done):
    said = done.run("train", "--arm", "prefill", "--workspace", "s3://bucket/work", "--jobs", 1, cache="elsewhere")
    assert "nothing was done" in said


def test_the_address_may_name_the_server_and_the_environment_the_keys(done):
    host = done.server.removeprefix("http://")
    address = f"s3://bucket/work?scheme=http&endpoint_override={host}"
    said = done.run("prefill", "--workspace", address, AWS_ENDPOINT_URL="http://127.0.0.1:9")
    assert "nothing was done" in said


def test_the_second_of_two_commands_is_told_who_works_there(done):
    done.client.put_object(
        Bucket="bucket", Key="work/.lock.json", Body=b'{"command": "train", "host": "elsewhere", "process": 7}'
    )
    said = done.run("prefill", "--workspace", "s3://bucket/work", code=1)
    done.client.delete_object(Bucket="bucket", Key="work/.lock.json")
    assert "in use by `maglev-offline train` (process 7 on elsewhere) since" in said
    assert "s3://bucket/work/.lock.json" in said


def test_a_command_that_is_killed_while_it_brings_things_there_is_made_good_by_the_next(done):
    argv = ("ingest", "s3://bucket/logs/*.mcap", "--recipe", "recipe.toml", "-w", "s3://bucket/killed", "--jobs", 1)
    command = done.begin(*argv)
    while not done.keys("killed/samples"):
        assert command.poll() is None
        time.sleep(0.005)
    command.send_signal(signal.SIGKILL)
    command.communicate()
    done.run(*argv)
    work = {key.removeprefix("work/"): done.hash_of(key) for key in done.keys("work/samples/")}
    assert {key.removeprefix("killed/"): done.hash_of(key) for key in done.keys("killed/samples/")} == work


def test_a_bucket_that_is_not_there_is_told_of(store):
    said = store.run("prefill", "--workspace", "s3://other/work", code=2)
    assert "there is no such bucket" in said
    said = store.run("ingest", "s3://other/logs/*.mcap", code=2)
    assert "s3://other" in said


@pytest.fixture
def good_keys(store, monkeypatch):
    """The keys of a user who may do everything, while the server asks for them: moto does not unless it is told to."""
    iam = boto3.client(
        "iam", endpoint_url=store.server, region_name="us-east-1", aws_access_key_id="a", aws_secret_access_key="b"
    )
    everything = {"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "*", "Resource": "*"}]}
    iam.create_user(UserName="user")
    iam.put_user_policy(UserName="user", PolicyName="all", PolicyDocument=json.dumps(everything))
    keys = iam.create_access_key(UserName="user")["AccessKey"]

    monkeypatch.setattr("moto.settings.INITIAL_NO_AUTH_ACTION_COUNT", 0)  # the server is a thread of this process
    return {"AWS_ACCESS_KEY_ID": keys["AccessKeyId"], "AWS_SECRET_ACCESS_KEY": keys["SecretAccessKey"]}


def test_wrong_keys_are_told_of_and_the_secret_is_not(store, good_keys):
    argv = ("ingest", "s3://bucket/logs/*.mcap", "--workspace", "s3://bucket/keys", "--jobs", 1)
    unknown = {"AWS_ACCESS_KEY_ID": "AKIAIOSFODNN7EXAMPLE", "AWS_SECRET_ACCESS_KEY": "notTheSecret"}
    for wrong in (unknown, {**good_keys, "AWS_SECRET_ACCESS_KEY": "notTheSecret"}):
        said = store.run(*argv, code=2, **wrong)
        assert "the store refuses access" in said
        assert "notTheSecret" not in said
    store.run(*argv, **good_keys)


def test_a_server_that_is_not_there_is_told_of_soon(store):
    begin = time.monotonic()
    said = store.run("prefill", "--workspace", "s3://bucket/work", code=2, AWS_ENDPOINT_URL="http://127.0.0.1:9")
    assert "cannot be reached" in said
    assert time.monotonic() - begin < 60
