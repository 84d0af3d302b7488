import numpy as np
import pytest
from safetensors.numpy import save_file

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.buffer import ReplayBuffer
from maglev_offline.replay.prefill import load_prefill, make_prefill, packed, scaled
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.workspace import Manifest, Workspace

PLANT, MDP, ALL = Plant(), Mdp(), PrefillSettings()


def test_columns_are_the_transitions_over_their_scales(transitions):
    mdp = Mdp(
        gap_scale_m=0.004, velocity_scale_m_s=0.1, current_scale_a=5.0, voltage_limit_v=250, discount=0.95,
        control_period_ms=10,
    )  # fmt: skip
    found = scaled(transitions.assign(discount=0.95 * ~transitions["terminated"]), mdp)
    for row in range(len(transitions)):
        one = transitions.iloc[row]
        seen = [one["gap_error_m"] / 0.004, one["gap_velocity_m_s"] / 0.1, one["current_error_a"] / 5]
        then = [one["next_gap_error_m"] / 0.004, one["next_gap_velocity_m_s"] / 0.1, one["next_current_error_a"] / 5]
        np.testing.assert_allclose(found["observation"][row], seen, rtol=1e-6)
        np.testing.assert_allclose(found["next_observation"][row], then, rtol=1e-6)
        assert found["action"][row] == pytest.approx(one["voltage_deviation_v"] / 250, rel=1e-6)
        assert found["cost"][row] == pytest.approx(one["cost"], rel=1e-6)
        assert found["discount"][row] == pytest.approx(0.0 if one["terminated"] else 0.95)


def test_only_a_terminated_row_cuts_the_discount(transitions):
    found = scaled(transitions, MDP)
    np.testing.assert_array_equal(found["discount"] == 0, transitions["terminated"])
    assert (transitions["truncated"] & ~transitions["terminated"]).any()
    np.testing.assert_array_equal(found["truncated"], transitions["truncated"])


def test_the_discount_is_that_of_the_row(transitions, put_transitions):
    own = np.linspace(0.3, 0.9, 100)
    table = transitions.assign(discount=own * ~transitions["terminated"])
    found = load_prefill(make_prefill(put_transitions(table), "td3", ALL, PLANT, MDP)[0])
    np.testing.assert_allclose(found["discount"], np.where(transitions["terminated"], 0, own), rtol=1e-6)


def test_a_buffer_without_a_slot_for_new_rows_is_refused_before_anything_is_made(transitions, put_transitions):
    workspace = put_transitions(transitions)
    with pytest.raises(InputError, match="100 prefilled rows do not fit into 100 slots"):
        make_prefill(workspace, "ddpg", ALL, PLANT, MDP, capacity=100)
    assert not workspace.path("prefill").exists()
    assert make_prefill(workspace, "ddpg", ALL, PLANT, MDP, capacity=101)[1]
    assert make_prefill(workspace, "ddpg", PrefillSettings(rows=99), PLANT, MDP, capacity=100)[1]
    with pytest.raises(InputError, match="do not fit"):
        make_prefill(workspace, "ddpg", PrefillSettings(rows=99), PLANT, MDP, capacity=99)


def test_an_action_beyond_the_limit_is_refused_with_the_number(transitions):
    with pytest.raises(InputError, match=r"row \d+, column voltage_deviation_v.*limit of 100 V.*mdp.voltage_limit_v"):
        scaled(transitions, Mdp(voltage_limit_v=100))


@pytest.mark.parametrize("column", ["gap_error_m", "voltage_deviation_v", "cost", "next_current_error_a", "discount"])
def test_a_value_that_is_not_finite_is_refused(transitions, column):
    table = transitions.copy()
    table.loc[7, column] = np.nan
    with pytest.raises(InputError, match=f"row 7, column {column}: the value is not finite"):
        scaled(table, MDP)


def test_the_artefact_comes_back_as_it_was_made(transitions, put_transitions):
    folder, fresh = make_prefill(put_transitions(transitions), "ddpg", ALL, PLANT, MDP)
    found = load_prefill(folder)
    assert fresh
    np.testing.assert_array_equal(found["transition_row"], np.arange(100))
    expected = scaled(transitions, MDP)
    assert set(found) == {*expected, "transition_row"}
    for name, column in expected.items():
        assert found[name].dtype == column.dtype
        np.testing.assert_array_equal(found[name], column)


def test_packed_rows_fill_the_first_slots_of_a_buffer_in_order(transitions, put_transitions):
    folder, _ = make_prefill(put_transitions(transitions), "td3", ALL, PLANT, MDP)
    columns = load_prefill(folder)
    buffer = ReplayBuffer(2, 200)
    buffer.prefill(packed(columns))
    batch = buffer.sample(np.tile((np.arange(100) + 0.5) / 100, (2, 1)))
    for seed in range(2):
        for name in ("observation", "next_observation"):
            np.testing.assert_array_equal(getattr(batch, name)[seed].numpy(), columns[name])
        for name in ("action", "cost", "discount"):
            np.testing.assert_array_equal(getattr(batch, name)[seed, :, 0].numpy(), columns[name])


def test_every_transition_is_a_row_or_left_out_for_a_reason(transitions, put_transitions):
    folder, _ = make_prefill(put_transitions(transitions), "ddpg", PrefillSettings(rows=30), PLANT, MDP)
    manifest = Manifest.read(folder)
    assert manifest.counts == {"transitions": 100, "rows": 30}
    assert manifest.left_out == {"over_prefill_rows": 70}
    assert manifest.facts["mean_cost"] == pytest.approx(load_prefill(folder)["cost"].mean())


def test_a_subset_of_rows_is_drawn_by_its_seed(transitions, put_transitions):
    def rows(seed):
        workspace = put_transitions(transitions)
        return load_prefill(make_prefill(workspace, "ddpg", PrefillSettings(rows=30, seed=seed), PLANT, MDP)[0])

    first, again, other = (rows(seed)["transition_row"] for seed in (0, 0, 1))
    assert (np.diff(first) > 0).all()
    assert len(first) == 30
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_unchanged_transitions_are_left_alone_and_changed_ones_are_not(transitions, put_transitions):
    workspace = put_transitions(transitions)
    folder, _ = make_prefill(workspace, "ddpg", ALL, PLANT, MDP)
    assert make_prefill(workspace, "ddpg", ALL, PLANT, MDP) == (folder, False)
    assert make_prefill(workspace, "ddpg", PrefillSettings(rows=5), PLANT, MDP)[1]
    put_transitions(transitions.iloc[:50])
    assert make_prefill(workspace, "ddpg", PrefillSettings(rows=5), PLANT, MDP)[1]


def test_the_same_transitions_give_the_same_bytes(transitions, put_transitions):
    folders = [
        make_prefill(put_transitions(transitions), algorithm, ALL, PLANT, MDP)[0] for algorithm in ("ddpg", "td3")
    ]
    assert folders[0].name == "ddpg"
    assert (folders[0] / "prefill.safetensors").read_bytes() == (folders[1] / "prefill.safetensors").read_bytes()


@pytest.mark.parametrize(("plant", "mdp"), [(Plant(mass_kg=600), MDP), (PLANT, Mdp(discount=0.8))])
def test_transitions_of_another_plant_or_process_are_refused(transitions, put_transitions, plant, mdp):
    workspace = put_transitions(transitions)
    with pytest.raises(ArtefactError, match=r"another \[plant\] or \[mdp\].*Run `maglev-offline curate`"):
        make_prefill(workspace, "ddpg", ALL, plant, mdp)
    assert not workspace.path("prefill", "ddpg").exists()


def test_an_empty_workspace_says_what_to_run(tmp_path):
    with pytest.raises(ArtefactError, match=r"no curated transitions.*Run `maglev-offline ingest"):
        make_prefill(Workspace(tmp_path), "ddpg", ALL, PLANT, MDP)


@pytest.mark.parametrize("damage", ["cut", "gone", "another"])
@pytest.mark.parametrize("before", [False, True], ids=["never made", "made before"])
def test_transitions_that_are_not_what_was_curated_are_refused(transitions, put_transitions, damage, before):
    workspace = put_transitions(transitions)
    if before:
        make_prefill(workspace, "ddpg", ALL, PLANT, MDP)
    path = workspace.path("transitions", "transitions.parquet")
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:100])
    elif damage == "gone":
        path.unlink()
    else:
        transitions.assign(cost=0.0).to_parquet(path)
    with pytest.raises(ArtefactError, match=r"transitions.parquet is not what was written.*run its stage again"):
        make_prefill(workspace, "ddpg", ALL, PLANT, MDP)


def test_a_prefill_that_was_changed_is_made_anew(transitions, put_transitions):
    workspace = put_transitions(transitions)
    folder, _ = make_prefill(workspace, "ddpg", ALL, PLANT, MDP)
    path = folder / "prefill.safetensors"
    before = path.read_bytes()
    path.write_bytes(before[:-4] + b"\x00\x01\x02\x03")
    assert make_prefill(workspace, "ddpg", ALL, PLANT, MDP)[1]
    assert path.read_bytes() == before


def test_a_missing_or_damaged_prefill_is_told_of(transitions, put_transitions, tmp_path):
    with pytest.raises(ArtefactError, match=r"there is no prefill.*--algo td3"):
        load_prefill(tmp_path / "td3")
    folder, _ = make_prefill(put_transitions(transitions), "ddpg", ALL, PLANT, MDP)
    (folder / "prefill.safetensors").write_bytes(b"\x08")
    with pytest.raises(ArtefactError, match="cannot be read"):
        load_prefill(folder)


@pytest.mark.parametrize(
    "changes",
    [{"cost": None}, {"cost": np.zeros(3, np.float32)}, {"action": np.full(2, np.nan, np.float32)},
     {"action": np.full(2, 1.5, np.float32)}, {"cost": np.zeros(2)}, {"cost": np.float32(1)}],
)  # fmt: skip
def test_a_prefill_of_others_holds_rows_or_is_refused(tmp_path, changes):
    three, one = np.zeros((2, 3), np.float32), np.zeros(2, np.float32)
    columns = {"observation": three, "next_observation": three, "action": one, "cost": one, "discount": one,
               "terminated": one > 0, "truncated": one > 0, "transition_row": np.arange(2)}  # fmt: skip
    save_file(columns, tmp_path / "prefill.safetensors")
    assert len(load_prefill(tmp_path)["cost"]) == 2
    columns = {name: value for name, value in (columns | changes).items() if value is not None}
    save_file({name: np.asarray(value) for name, value in columns.items()}, tmp_path / "prefill.safetensors")
    with pytest.raises(ArtefactError, match="the prefill cannot be read"):
        load_prefill(tmp_path)
