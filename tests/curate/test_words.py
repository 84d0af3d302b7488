import pytest

from maglev_offline.curate.words import balance_words, exit_code, verdict_words

FACTS = {
    "construction": "semi_markov",
    "diagnostic": {
        "verdict": "harmful",
        "error_over_advantage_std": 4.386,
        "error_over_advantage_std_interval": [3.65, 5.29],
        "correlation_with_advantage": -0.281,
        "correlation_with_advantage_interval": None,
    },
}


def test_a_clause_says_construction_verdict_and_both_numbers_with_their_intervals():
    words = verdict_words(FACTS)
    assert words.startswith("semi_markov rows are harmful")
    assert "4.39 (3.65 to 5.29)" in words
    assert "-0.28 (no interval)" in words


def test_what_cannot_be_reckoned_is_unknown_and_what_was_not_judged_is_said_so():
    unknown = {**FACTS["diagnostic"], "correlation_with_advantage": None}
    assert verdict_words({**FACTS, "diagnostic": unknown}).endswith("unknown")
    assert "not judged" in verdict_words({})


@pytest.mark.parametrize(("fail_on", "codes"), [("never", [0, 0, 0]), ("doubtful", [0, 1, 2]), ("harmful", [0, 0, 2])])
def test_exit_codes_are_those_of_inspect(fail_on, codes):
    assert [exit_code(verdict, fail_on) for verdict in ("fit", "doubtful", "harmful")] == codes


def test_a_clause_says_what_balance_did():
    facts = {
        "balance": "quantiles",
        "occupancy_before": {"effective_cells": 13.6, "occupied_cells": 589},
        "occupancy_after": {"effective_cells": 194.2, "occupied_cells": 500},
        "low_cost_share_kept": 0.17,
        "visited_states": {"distance": 0.2, "policies": {"lqr": {"states": 500, "before": 0.81, "after": 0.79}}},
    }
    words = balance_words(facts)
    assert words.startswith("balance quantiles: effective cells 14 -> 194 of 589 occupied, 17% of the low-cost rows")
    assert words.endswith("81% -> 79% of the states that the LQR visits")
