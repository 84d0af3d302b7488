import pytest

from maglev_offline.curate.words import balance_words, exit_code, region_words, residual_lines, verdict_words

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


RESIDUAL = {
    "duration_s": 0.1,
    "growth": 6.52,
    "logs": {"judged": 3, "explained": 1, "open": 0, "unexplained": 2, "offset": 1},
    "regions": {"judged": 20, "explained": 4, "open": 6, "unexplained": 10, "offset": 2},
    "worst_logs": [
        {"log_id": "log-c", "rms_state_scales": 3.07, "offset_share": 0.92, "offset": True},
        {"log_id": "log-a", "rms_state_scales": 0.5, "offset_share": 0.1, "offset": False},
    ],
    "worst_regions": [
        {
            "gap_from_m": -0.0019,
            "gap_to_m": -0.00047,
            "velocity_from_m_s": 0.034,
            "velocity_to_m_s": None,
            "rms_state_scales": 4.3,
            "offset_share": 0.92,
            "offset": True,
        }
    ],
}


def test_two_lines_say_what_the_simulator_explains_and_what_it_does_not_worst_first():
    first, second = residual_lines({"residual": RESIDUAL})
    assert first.startswith("100 ms ahead the simulator explains 1 of 3 logs and 4 of 20 regions")
    assert "grows 6.52-fold" in first
    assert "log-c (3.1 state scales, 92% of it offset), log-a (0.5 state scales)" in second
    assert "gap error -1.9 to -0.47 mm and velocity above 34 mm/s (4.3 state scales" in second
    assert "another plant or load" in second


def test_what_is_explained_or_was_not_compared_takes_no_second_line():
    explained = {**RESIDUAL, "growth": 1.1, "worst_logs": [], "worst_regions": []}
    assert residual_lines({"residual": explained}) == [
        "100 ms ahead the simulator explains 1 of 3 logs and 4 of 20 regions"
    ]
    assert residual_lines({"residual": None}) == residual_lines({}) == []


def test_a_region_is_named_by_the_ends_it_has():
    ends = {"gap_from_m": None, "gap_to_m": -0.001, "velocity_from_m_s": None, "velocity_to_m_s": None}
    assert region_words(ends) == "gap error below -1 mm and velocity anywhere"


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
