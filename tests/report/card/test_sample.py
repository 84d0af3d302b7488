"""The rows in the page: a uniform draw, marked as the artefact has them."""

import base64

import numpy as np
import pandas as pd
import pytest

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.report.card.sample import (
    BETWEEN,
    CURATED,
    FALSE,
    HELD_OUT,
    KEY,
    TRUE,
    packed,
    read_candidates,
    sample_of,
)


@pytest.fixture(scope="module")
def folder(carded):
    return carded / "transitions"


@pytest.fixture(scope="module")
def candidates(folder):
    return read_candidates(folder)


def decoded(text, kind, rows):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, rows)


def test_few_rows_are_all_there(folder, candidates):
    assert len(sample_of(candidates, folder, Plant(), Mdp(), seed=0)) == len(candidates)


def test_draw_is_seeded_without_repeats_and_in_the_shares_of_the_splits(folder, candidates):
    drawn = sample_of(candidates, folder, Plant(), Mdp(), seed=0, most=200)
    assert len(drawn) == 200
    assert not drawn.duplicated(KEY).any()
    share = (candidates["split"] == "train").mean()
    assert (drawn["split"] == "train").sum() == round(200 * share)
    assert drawn.equals(sample_of(candidates, folder, Plant(), Mdp(), seed=0, most=200))
    assert not drawn[KEY].equals(sample_of(candidates, folder, Plant(), Mdp(), seed=1, most=200)[KEY])


def test_marks_are_those_of_the_artefact(folder, candidates):
    drawn = sample_of(candidates, folder, Plant(), Mdp(), seed=0)
    curated = pd.read_parquet(folder / "transitions.parquet")
    assert (drawn["state"] == CURATED).sum() == len(curated)
    assert ((drawn["state"] == HELD_OUT) == (drawn["split"] == "validation")).all()
    judged = pd.read_parquet(folder / "diagnostic_rows.parquet")
    spread = judged["advantage"].std(ddof=0)  # so few rows are all judged, each for itself
    of_row = drawn.merge(judged, on=KEY)
    error = (of_row["taught_advantage"] - of_row["advantage"]).abs() / spread
    expected = np.select([error <= 0.75, error < 3], [TRUE, BETWEEN], FALSE)
    assert (of_row["judged"] == expected).all()


def test_page_gets_the_very_numbers_of_the_table(folder, candidates):
    drawn = sample_of(candidates, folder, Plant(), Mdp(), seed=0, most=200)
    found = packed(drawn, candidates, [])
    for column, values in zip(found["columns"], decoded(found["numbers"], "<f8", 200), strict=True):
        assert (values == drawn[column["name"]].to_numpy()).all()
        assert (column["from"], column["to"]) == (candidates[column["name"]].min(), candidates[column["name"]].max())
    logs, points, state, judged = decoded(found["codes"], "<u2", 200)
    assert [found["logs"][k] for k in logs] == drawn["log_id"].tolist()
    assert [found["points"][k] for k in points] == drawn["point"].tolist()
    assert (state == drawn["state"]).all()
    assert (judged == drawn["judged"]).all()
