"""The benchmark of balance: it runs each one, and says where one takes too much."""

import json

import curate
import pytest

from maglev_offline.curate.balance import BALANCES

pytestmark = pytest.mark.nightly


def test_a_contender_balances_and_measures_and_prints_what_it_took(capsys):
    assert curate.main(["--rows", "12000", "--contender", "quantiles"]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["chosen"] == 10_000
    assert 0 < row["balance_s"] < row["cpu_s"]
    assert row["peak_bytes"] > 30e6
    assert row["facts"]["balance"] == "quantiles"


def test_what_takes_too_long_or_too_much_memory_or_fails_is_an_error(monkeypatch, capsys):
    fine = {"chosen": 9, "balance_s": 1.0, "measures_s": 1.0, "cpu_s": 2.0, "wall_s": 3.0, "peak_bytes": 1e9}
    made = iter([fine, {**fine, "cpu_s": 61.0}, {**fine, "peak_bytes": 2.1e9}, "it broke", fine, fine])

    def run(command, longest_s):
        row = next(made)
        return row if isinstance(row, str) else {"balance": command[-1], **row}

    monkeypatch.setattr(curate, "run_alone", run)
    assert curate.main(["--quick"]) == 1
    shown = capsys.readouterr()
    names = list(BALANCES)
    assert f"{names[1]} takes 61.0 s" in shown.err
    assert f"{names[2]} takes 2,100 MB" in shown.err
    assert "it broke" in shown.err
    assert names[0] not in shown.err
    assert shown.out.count("\n| ") == 6
