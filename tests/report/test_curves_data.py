"""The curves as the page's script gets them: every run, where it is, and a middle that few bad runs do not move."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from maglev_offline.report.curves_data import curves_data
from maglev_offline.report.evidence import Artefact
from maglev_offline.workspace import Manifest


def data(seeds, bad=0, **changes):
    rows = [
        {
            "algorithm": "td3",
            "arm": arm,
            "seed": seed,
            "env_step": step,
            "cost": 10.0 + seed / 10 + (500 if seed < bad else 0),
        }
        for arm in ("empty", "prefill")
        for seed in range(seeds)
        for step in (0, 100)
    ]
    manifest = Manifest("training/td3-prefill/seeds-0000-0003", "mark", {})
    manifest.facts = {"seeds": list(range(4))}
    block = Artefact(manifest.artefact, Path("training/td3-prefill/seeds-0000-0003"), manifest, "f" * 64)
    asked = {"shown": ["empty"], "reference": {"pid": 81.23456}, "threshold": 16.5, "exploratory_steps": 50}
    return curves_data(pd.DataFrame(rows), [block], confidence=0.95, **(asked | changes))


def test_every_run_is_there_with_the_block_that_holds_it():
    found = data(6)
    (panel,) = found["panels"]
    line = panel["arms"]["prefill"]
    assert np.shape(line["runs"]) == (6, 2)
    assert line["blocks"] == [0, 0, 0, 0, -1, -1]
    assert found["blocks"] == [{"name": "training/td3-prefill/seeds-0000-0003", "hash": "f" * 16}]
    assert panel["arms"]["empty"]["blocks"] == [-1] * 6


def test_one_bad_run_of_eight_does_not_move_the_middle():
    good, bad = (data(8, bad=bad)["panels"][0]["arms"]["empty"] for bad in (0, 1))
    assert bad["middle"] == pytest.approx(good["middle"], abs=0.2)
    assert max(bad["runs"][0]) > 500


def test_the_interval_holds_the_middle_and_few_seeds_have_none():
    line = data(8)["panels"][0]["arms"]["empty"]
    assert line["low"][0] < line["middle"][0] < line["high"][0]
    assert data(5)["panels"][0]["arms"]["empty"]["low"] == [None, None]


def test_costs_have_four_digits():
    found = data(6, reference={"pid": 81.23456})
    assert found["references"][0]["cost"] == 81.23


def test_only_arms_that_are_asked_for_are_shown_at_first():
    assert [(arm["name"], arm["shown"]) for arm in data(6)["arms"]] == [("empty", True), ("prefill", False)]
