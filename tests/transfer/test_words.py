from maglev_offline.transfer.words import (
    POWER_COLUMNS,
    answer,
    columns,
    effect_rows,
    finding_lines,
    negative_arms,
    period_lines,
    power_rows,
)

EFFECT = {
    "baseline_mean": 12.0, "arm_mean": 15.0, "difference": -3.0, "low": -4.0, "high": -2.0, "p_value_holm": 0.012,
    "verdict": "negative", "seeds": 8, "margin": 0.5, "detectable": 1.1, "seeds_needed": 31,
}  # fmt: skip
UNKNOWN = EFFECT | {"low": None, "high": None, "detectable": None, "seeds_needed": None, "verdict": "inconclusive"}
FACTS = {
    "primary_metric": "area",
    "arms": ["empty", "prefill"],
    "rows": {"prefill": {"rows_from": "log"}},
    "algorithms": {
        "ddpg": {"effects": {"prefill": {"area": UNKNOWN}}},
        "td3": {"effects": {"prefill": {"area": EFFECT}}},
    },
}


def test_the_answer_is_about_the_primary_metric():
    assert answer(FACTS) == (
        "against an empty buffer, judged by area: ddpg: prefill inconclusive; td3: prefill negative"
    )


def test_a_row_gives_both_arms_the_difference_and_how_sure_it_is():
    rows = effect_rows(FACTS)
    assert rows[1] == ["td3: area", "prefill", "12", "15", "-3", "-4 to -2", "0.012", "negative"]
    assert rows[0][5] == "-"
    assert {len(row) for row in rows} == {len(columns(0.95))}


def test_the_power_of_a_study_is_said_in_seeds():
    rows = power_rows(FACTS)
    assert rows[1] == ["td3: area", "prefill", "8", "0.5", "1.1", "31"]
    assert rows[0][4:] == ["-", "unknown"]
    assert {len(row) for row in rows} == {len(POWER_COLUMNS)}


def test_negative_transfer_is_found_in_the_primary_metric_only():
    assert negative_arms(FACTS) == ["td3 prefill"]
    assert negative_arms(FACTS | {"rows": {"prefill": {"rows_from": "shuffled"}}}) == []
    assert negative_arms(FACTS | {"primary_metric": "jumpstart", "algorithms": {"ddpg": {"effects": {}}}}) == []


def test_findings_name_the_parts_that_survive_the_correction_the_cure_and_the_foretelling():
    part = {"algorithm": "td3", "part": "log-1", "share_of_rows": 0.3, "meaning": "harms", "holds_after_holm": True}
    told = {"rank_correlation": -0.8, "interval": (-1.0, -0.3), "arms": 9}
    facts = FACTS | {
        "attribution": {"parts": [part, part | {"part": "log-2", "holds_after_holm": False}]},
        "cure": {"algorithms": {"td3": {"chosen": "half", "confirmed": {"verdict": "positive", "low": 0.1}}}},
        "foretelling": {"algorithms": {"td3": {"error_over_advantage_std": told}}},
    }
    assert finding_lines(facts) == [
        "td3: the part log-1 (30%) harms",
        "td3: the best cure, half, is positive on the other seeds",
        "td3: rank correlation of the rows' target error with what they did, over 9 arms: -0.80 (-1.00 to -0.30)",
    ]
    assert finding_lines(FACTS) == []


def test_other_periods_are_told_one_by_one():
    assert period_lines({"5": FACTS})[0].startswith("at 5 ms, against an empty buffer")
