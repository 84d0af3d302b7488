"""Groups of chains, recovered apart and joined, against all chains at once: the same bits."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np
import pytest
from joblib import parallel_config

from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.recovery import groups
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.between import periods_of
from maglev_offline.curate.recovery.groups import Wanted, groups_of, recover_all, surprises
from maglev_offline.curate.recovery.model import Model
from maglev_offline.curate.recovery.recover import recover
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.recovery.tracks import tracks_of
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.spread import ClusterBackend

PLANT, MDP = Plant(), Mdp()


@pytest.fixture(scope="module")
def wanted(logged):
    settings = RecoverySettings(law="pid")
    (tracks,) = tracks_of(pairs_of(logged, PLANT).samples)
    return Wanted(Model(PLANT, MDP, settings, Belief(settings).gain(PLANT, "pid"), tracks.period_s, 1.0), tracks, 2)


@pytest.fixture(scope="module")
def at_once(wanted):
    found = recover(*wanted)
    return found, periods_of(found)


def test_every_chain_is_in_one_group_and_groups_depend_on_the_chains_alone(wanted):
    parts = [one.tracks for one in groups_of(wanted, 100)]
    assert len(parts) > 1
    assert np.array_equal(np.concatenate([part.row for part in parts]), wanted.tracks.row)
    assert sum(len(part.start) for part in parts) == len(wanted.tracks.start)


@pytest.mark.parametrize("where", ["here", "cluster"])
def test_groups_give_the_bits_of_all_chains_at_once(wanted, at_once, monkeypatch, where):
    monkeypatch.setattr(groups, "SAMPLES", 50)
    monkeypatch.setattr(groups.groups_of, "__defaults__", (100,))
    with ThreadPoolExecutor(2) as pool:
        elsewhere = parallel_config(backend=ClusterBackend(pool.submit)) if where == "cluster" else nullcontext()
        with elsewhere:
            ((found, periods),) = recover_all([wanted], 2 if where == "cluster" else 1)
            (surprise,) = surprises([wanted], 2 if where == "cluster" else 1)
    whole, whole_periods = at_once
    for name in ("about", "explained", "nis_share", "surprising", "lost"):
        assert np.array_equal(getattr(found, name), getattr(whole, name), equal_nan=True), name
    for name, field in whole.found._asdict().items():
        assert np.array_equal(getattr(found.found, name), field, equal_nan=True), name
    for name, field in whole_periods._asdict().items():
        assert np.array_equal(getattr(periods, name), field, equal_nan=True), name
    assert np.array_equal(surprise, whole.found.surprise, equal_nan=True)
    assert np.array_equal(found.trusted, whole.trusted)


def test_nothing_to_recover_gives_nothing():
    assert recover_all([]) == []
    assert surprises([]) == []
