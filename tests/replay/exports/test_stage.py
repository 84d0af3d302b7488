import numpy as np
import pytest

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.exports.stage import FORMS, make_export
from maglev_offline.replay.prefill import make_prefill
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.report.evidence import gather
from maglev_offline.workspace import Manifest, changed_files

PLANT, MDP = Plant(), Mdp()


@pytest.fixture
def prefilled(transitions, put_transitions):
    workspace = put_transitions(transitions)
    make_prefill(workspace, "ddpg", PrefillSettings(), PLANT, MDP)
    return workspace


@pytest.mark.parametrize("name", FORMS)
def test_an_export_is_an_artefact_that_says_what_lies_where(prefilled, name):
    folder, fresh = make_export(prefilled, "ddpg", name, PLANT, MDP)
    manifest = Manifest.read(folder)
    assert fresh
    assert folder == prefilled.path("exports", f"ddpg-{name}")
    assert manifest.counts == {"rows": 100}
    assert manifest.facts["gamma"] == 0.9
    assert manifest.facts["construction"] == "raw"
    assert {"observation", "action", "-cost", "next_observation", "terminated"} <= set(manifest.facts["columns"])
    assert manifest.files
    assert not changed_files(folder, manifest)


@pytest.mark.parametrize("name", FORMS)
def test_the_same_prefill_gives_the_same_bytes_and_an_unchanged_one_is_left_alone(prefilled, name):
    folder, _ = make_export(prefilled, "ddpg", name, PLANT, MDP)
    before = Manifest.read(folder).files
    assert make_export(prefilled, "ddpg", name, PLANT, MDP) == (folder, False)
    for path in before:
        (folder / path).unlink()
    assert make_export(prefilled, "ddpg", name, PLANT, MDP) == (folder, True)
    assert Manifest.read(folder).files == before


def test_a_changed_prefill_is_exported_again(prefilled):
    make_export(prefilled, "ddpg", "npz", PLANT, MDP)
    make_prefill(prefilled, "ddpg", PrefillSettings(rows=30), PLANT, MDP)
    folder, fresh = make_export(prefilled, "ddpg", "npz", PLANT, MDP)
    assert fresh
    assert len(np.load(folder / "prefill.npz")["rewards"]) == 30


def test_what_a_form_cannot_hold_leaves_nothing_behind(transitions, put_transitions):
    own = transitions.assign(discount=0.3487 * ~transitions["terminated"])
    workspace = put_transitions(own, construction="semi_markov")
    make_prefill(workspace, "td3", PrefillSettings(), PLANT, MDP)
    with pytest.raises(InputError, match="rows of the construction semi_markov"):
        make_export(workspace, "td3", "sb3", PLANT, MDP)
    assert not list(workspace.path("exports").iterdir())
    assert make_export(workspace, "td3", "npz", PLANT, MDP)[1]


def test_no_prefill_says_what_to_run(put_transitions, transitions):
    with pytest.raises(ArtefactError, match="--algo td3"):
        make_export(put_transitions(transitions), "td3", "npz", PLANT, MDP)


def test_the_report_takes_an_export_for_no_prefill(prefilled):
    make_export(prefilled, "ddpg", "npz", PLANT, MDP)
    assert list(gather(prefilled).prefills()) == ["ddpg"]
