"""What a user may be handed, and how it is read: `read(folder, whole)` says how it ended, and raises what is wrong.

A target has `files`, some whole ones to begin with, each a mapping from name to content; one of the names is changed.
"""

import io
import json
import random
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mutators import mutated, mutated_text
from safetensors.numpy import save, save_file

from maglev_offline.agents.checkpoint import Checkpoint, Unusable
from maglev_offline.errors import ArtefactError, InputError, RecipeError
from maglev_offline.identify.plants import load_plant
from maglev_offline.ingest.log import ingest_log
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.surrogate import generate
from maglev_offline.logs.surrogate_settings import SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.c_header import as_c_header
from maglev_offline.policies.policy import Origin, Policy
from maglev_offline.policies.tensors import as_safetensors, load_policy
from maglev_offline.recipe import load_recipe, recall, remember
from maglev_offline.replay.buffer import WIDTH
from maglev_offline.replay.exports import sb3
from maglev_offline.replay.prefill import load_prefill, packed
from maglev_offline.workspace import Manifest, Workspace, changed_files

Files = Mapping[str, bytes]


class Target(NamedTuple):
    """`files`: whole ones; `read`: reads a folder with one of them changed by `change`, which is given another, too."""

    files: tuple[Files, ...]
    read: Callable[[Path, Files], str]
    change: Callable[[bytes, bytes, str], bytes] = mutated


def all_targets(scratch: Path) -> dict[str, Target]:
    """Every target, by name."""
    return {
        "mcap": Target(logs := _logs(scratch), _read_log),
        "messages": Target(logs[:3], _read_log, _other_messages),
        "recipe": Target(_recipes(), _read_recipe, mutated_text),
        "plant": Target(_plants(), _read_plant, mutated_text),
        "prefill": Target(_prefills(), _read_prefill),
        "sb3": Target(_sb3s(scratch), _read_sb3),
        "checkpoint": Target(_checkpoints(scratch), _read_checkpoint),
        "policy": Target(_policies(), _read_policy),
        "manifest": Target(_manifests(scratch), _read_manifest, mutated_text),
        "remembered": Target(({"recipe.json": json.dumps(load_recipe(PIPELINES / "levitator.toml").plain()).encode()},),
                             _read_remembered, mutated_text),
    }  # fmt: skip


PIPELINES = Path(__file__).parents[2] / "pipelines"
SURROGATE = SurrogateSettings(logs=3, points=1, duration_s=4)
REQUEST = Request(None, IngestSettings(), Plant())


def _logs(scratch):
    """A surrogate log in each encoding, as it is, and again without check sums and without chunks."""
    paths = generate(scratch / "logs", plant=Plant(), mdp=Mdp(), settings=SURROGATE)
    ways = ({"compression": CompressionType.NONE, "enable_crcs": False, "chunk_size": 1024},
            {"compression": CompressionType.LZ4, "chunk_size": 512}, {"use_chunking": False})  # fmt: skip
    whole = [path.read_bytes() for path in paths]
    return tuple({"a.mcap": data} for data in (*whole, *(_rewritten(data, way) for data in whole for way in ways)))


def _rewritten(data, way, of_payload=bytes, of_schema=bytes):
    """The same messages written another way, with payloads and definitions changed."""
    out, topics = io.BytesIO(), {}
    writer = Writer(out, **way)
    writer.start()
    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages(log_time_order=False):
        if channel.id not in topics:
            known = writer.register_schema(schema.name, schema.encoding, of_schema(schema.data)) if schema else 0
            topics[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
        payload = of_payload(message.data)
        writer.add_message(topics[channel.id], message.log_time, payload, message.publish_time, message.sequence)
    writer.finish()
    return out.getvalue()


def _other_messages(data, other, seed):
    """A sound file, whose check sums hold, around payloads (and now and then definitions) that are changed."""
    draw = random.Random(seed)
    often, of_definition = draw.choice((0.02, 0.1, 1.0)), draw.random() < 0.2

    def change(content):
        return mutated(content, content, f"{seed} {draw.random()}")

    def of_payload(content):
        return change(content) if draw.random() < often else content

    whole = {"compression": CompressionType.NONE}
    return _rewritten(data, whole, of_payload, change if of_definition else bytes)


def _read_log(folder, whole):
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    try:
        made = ingest_log(folder / "a.mcap", "a", REQUEST, out)
    except InputError:
        return "refused"
    ledger, samples = (pq.read_table(out / f"{name}.parquet") for name in ("quarantine", "samples"))
    rows = ledger.select(["level", "code", "count"]).to_pylist()
    lost = {level: sum(row["count"] for row in rows if row["level"] == level) for level in ("message", "sample")}
    assert made.counts["messages"] == made.counts["messages_used"] + lost["message"], "messages are lost in silence"
    assert made.counts["grid_rows"] == len(samples) + lost["sample"], "samples are lost in silence"
    assert sum(made.left_out.values()) == lost["message"] + lost["sample"], "the ledger does not add up"
    for name in ("gap_m", "current_a", "voltage_v"):
        assert np.isfinite(samples[name].to_numpy()).all(), f"{name} is not finite"
    return "used in part" if lost["message"] else "used"


def _recipes():
    return tuple({"r.toml": path.read_bytes()} for path in sorted(PIPELINES.glob("*.toml")))


def _read_recipe(folder, whole):
    try:
        recipe = load_recipe(folder / "r.toml")
    except RecipeError:
        return "refused"
    remember(folder, recipe)
    again = recall(folder)
    assert again is not None
    assert again.plain() == recipe.plain(), "the workspace remembers another recipe"
    return "used"


def _read_remembered(folder, whole):
    try:
        found = recall(folder)
    except RecipeError:
        return "refused"
    assert found is not None
    return "used"


def _plants():
    text = "[plant]\n" + "".join(f"{k} = {v}\n" for k, v in Plant().model_dump().items() if v is not None)
    return ({"p.toml": text.encode()},)


def _read_plant(folder, whole):
    try:
        plant = load_plant(folder / "p.toml")
    except RecipeError:
        return "refused"
    assert np.isfinite(plant.equilibrium()).all(), "the plant has no equilibrium"
    return "used"


def _prefills():
    rng = np.random.default_rng(1)
    columns = {
        "observation": rng.normal(size=(20, 3)).astype(np.float32),
        "action": rng.uniform(-1, 1, 20).astype(np.float32),
        "cost": rng.uniform(0, 9, 20).astype(np.float32),
        "next_observation": rng.normal(size=(20, 3)).astype(np.float32),
        "discount": np.full(20, 0.9, np.float32),
        "terminated": np.zeros(20, bool),
        "truncated": np.zeros(20, bool),
        "transition_row": np.arange(20),
    }
    return ({"prefill.safetensors": save(columns)},)


def _read_prefill(folder, whole):
    try:
        columns = load_prefill(folder)
    except ArtefactError:
        return "refused"
    rows = packed(columns)
    assert rows.shape == (len(columns["cost"]), WIDTH)
    assert np.isfinite(rows).all(), "rows are not finite"
    return "used"


def _sb3s(scratch):
    rng = np.random.default_rng(2)
    columns = {
        "observations": rng.normal(size=(20, 3)).astype(np.float32),
        "next_observations": rng.normal(size=(20, 3)).astype(np.float32),
        "actions": rng.uniform(-1, 1, (20, 1)).astype(np.float32),
        "rewards": -rng.uniform(0, 9, 20).astype(np.float32),
        "terminations": np.zeros(20, bool),
    }
    facts = {"construction": "raw", "gamma": 0.9, "control_period_ms": 10.0, "gap_scale_m": 0.01,
             "velocity_scale_m_s": 0.1, "current_scale_a": 10.0, "voltage_limit_v": 200.0}  # fmt: skip
    save_file(columns, scratch / sb3.FILE, {"sb3": json.dumps(facts)})
    return ({sb3.FILE: (scratch / sb3.FILE).read_bytes()},)


def _read_sb3(folder, whole):
    try:
        columns, facts = sb3.read(folder)
    except InputError:
        return "refused"
    assert isinstance(facts["gamma"], float)
    assert all(np.isfinite(value).all() for value in columns.values())
    return "used"


STATE = {"net.w1": np.arange(6, dtype=np.float32).reshape(2, 3), "streams": np.array([[2**63 + 1, 7]], np.uint64),
         "step": np.array(40)}  # fmt: skip
ROWS = np.arange(5 * 2 * WIDTH, dtype=np.float32).reshape(5, 2, WIDTH)


def _checkpoints(scratch):
    made = Checkpoint(scratch / "partial", "mark", 2)
    made.folder.mkdir()
    made.save(40, STATE, ROWS)
    return ({path.name: path.read_bytes() for path in sorted(made.folder.iterdir())},)


def _read_checkpoint(folder, whole):
    try:
        found = Checkpoint(folder, "mark", 2).load(100)
    except Unusable:
        return "refused"
    if found is None:
        return "none"
    assert found.step == 40, "it goes on at another step"
    np.testing.assert_array_equal(found.rows, ROWS)
    assert found.state.keys() == STATE.keys()
    for name, value in STATE.items():
        np.testing.assert_array_equal(found.state[name], value)
    return "used"


def _policies():
    rng = np.random.default_rng(3)
    shapes = {"w1": (3, 5), "b1": (1, 5), "w2": (5, 4), "b2": (1, 4), "w3": (4, 1), "b3": (1, 1)}
    net = {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    normed = {f"{name}_{layer}": rng.uniform(0.5, 2, (1, 5 if layer == 1 else 4)).astype(np.float32)
              for name in ("gain", "shift", "mean", "var") for layer in (1, 2)}  # fmt: skip
    origin = Origin("td3", "empty", 3, "best", "torch", "training/x", "f" * 64, "a" * 64, "b" * 64)
    return tuple({"p.st": as_safetensors(Policy(one, Plant(), Mdp(), origin))} for one in (net, net | normed))


def _read_policy(folder, whole):
    try:
        policy = load_policy(folder / "p.st")
    except ArtefactError:
        return "refused"
    with np.errstate(all="ignore"):
        assert np.isfinite(policy.voltage([0.008, 0.01, np.nan], [0.0, 0.1, 0.0], [20.0, 25.0, 1.0])).all()
    as_c_header(policy)
    return "used"


def _manifests(scratch):
    workspace = Workspace(scratch / "workspace")
    manifest = Manifest("a", "f" * 64, {"log": "a" * 64}, {"rows": 7}, {"gone": 1}, {"facts": [1, 2.5, None, {"b": 1}]})
    with workspace.commit(workspace.path("a"), manifest) as draft:
        (draft / "x.txt").write_text("x")
    return ({"manifest.json": (workspace.path("a") / "manifest.json").read_bytes()},)


def _read_manifest(folder, whole):
    try:
        found = Manifest.read(folder)
    except ArtefactError:
        return "refused"
    changed_files(folder, found)
    if found.seal:
        assert json.loads(whole["manifest.json"]) == json.loads((folder / "manifest.json").read_bytes())
    return "used"
