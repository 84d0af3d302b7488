"""The result in three sentences: what the facts say, and no more."""

from maglev_offline.report.study.abstract import cure_sentence, foretelling_sentence


def cure(verdict, low=1.0):
    confirmed = {"verdict": verdict, "difference": 2.6, "low": low, "high": None if low is None else 4.0, "seeds": 10}
    return {
        "cure": {"candidates": ["half", "cloned"], "algorithms": {"td3": {"chosen": "half", "confirmed": confirmed}}}
    }


def told(correlation=-0.55):
    number = {"rank_correlation": correlation, "interval": [-0.86, 0.06], "arms": 32, "groups": 11}
    calibration = {"fit": {"positive": 7, "negative": 1}, "harmful": {"negative": 41, "inconclusive": 1}}
    return {"foretelling": {"algorithms": {"td3": {"error_over_advantage_std": number}}, "calibration": calibration}}


def plain(text):
    return text.replace("\N{NO-BREAK SPACE}", " ")


def test_a_confirmed_cure_helps_and_an_open_one_shows_no_effect():
    assert "for TD3 “half” helps (difference 2.60, 95 % interval 1.00 to 4.00, 10 seeds)" in plain(
        cure_sentence(cure("positive"), 0.95)
    )
    assert "shows no effect that so many seeds could establish" in cure_sentence(cure("inconclusive", -1.0), 0.95)


def test_nothing_is_said_of_a_cure_that_too_few_seeds_are_left_for_or_that_was_not_asked_for():
    assert cure_sentence(cure("inconclusive", None), 0.95) == ""
    assert cure_sentence({}, 0.95) == ""


def test_verdicts_before_training_are_told_with_what_they_met():
    text = plain(foretelling_sentence(told(), 0.95))
    assert "8 times “fit”, 1 of which did harm and 42 times “harmful”, 41 of which did harm" in text
    assert "−0.55 for TD3 (−0.86 to 0.060, 32 arms in 11 groups)" in text
    assert foretelling_sentence(told(None), 0.95) == ""
