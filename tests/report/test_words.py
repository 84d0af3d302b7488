"""The sentences: each verdict is called by its name, and nothing is claimed that was not found."""

import pytest

from maglev_offline.report import words


def effect(verdict, difference=-3.1, low=-5.0, high=-1.2, seeds=8):
    return {"verdict": verdict, "difference": difference, "low": low, "high": high, "seeds": seeds}


def study(effects, *, reached=0.5, within=0.0, settled=0.0, algorithm="ddpg"):
    arm = {"seeds": 8, "share_reached": reached, "share_within_half_mm": within, "share_settled": settled}
    return {"algorithms": {algorithm: {"arms": {"empty": arm, "prefill": arm}, "effects": {"prefill": effects}}}}


def plain(text):
    return text.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (
            "negative",
            "raised the mean cost over the whole training (area: −3.10, 95 % interval −5.00 to −1.20, 8 seeds)",
        ),
        ("positive", "lowered the mean cost over the whole training (area:"),
        ("equivalent", "made no difference that matters to the area ("),
        ("inconclusive", "left open which way the area ("),
    ],
)
def test_answer_names_the_verdict(verdict, says):
    (sentence,) = words.answers(study({"area": effect(verdict)}), {"ddpg": 10_000}, 0.95)
    assert plain(sentence).startswith("With DDPG, 10,000 logged rows in the buffer ")
    assert says in plain(sentence)
    assert sentence.endswith(f": {words.VERDICT_WORDS[verdict]}.")


def test_answer_keeps_verdicts_apart():
    (sentence,) = words.answers(
        study({"jumpstart": effect("positive"), "area": effect("negative"), "asymptote": effect("inconclusive")}),
        {},
        0.9,
    )
    negative, positive, open_ = plain(sentence).split("; ")
    assert "area" in negative
    assert "90 % interval" in negative
    assert negative.endswith("negative transfer")
    assert "jumpstart" in positive
    assert positive.endswith("positive transfer")
    assert "asymptote" in open_


def test_a_threshold_that_no_run_reaches_says_nothing():
    found = study({"area": effect("inconclusive"), "time_to_threshold": effect("equivalent", 0, 0, 0)}, reached=0.0)
    (sentence,) = words.answers(found, {}, 0.95)
    assert "equivalent" not in sentence
    assert "no run of either arm reaches the threshold" in sentence
    assert "makes no difference" not in words.headline(found)


@pytest.mark.parametrize(
    ("verdicts", "says"),
    [
        (("negative", "inconclusive"), "harms DDPG"),
        (("positive", "equivalent"), "helps DDPG"),
        (("positive", "negative"), "helps DDPG in one respect and harms it in another"),
        (("equivalent", "equivalent"), "makes no difference that matters to DDPG"),
        (("equivalent", "inconclusive"), "has no effect on DDPG that so many seeds could establish"),
    ],
)
def test_headline(verdicts, says):
    found = study(dict(zip(("area", "asymptote"), map(effect, verdicts), strict=True)), within=1.0, settled=1.0)
    assert words.headline(found) == f"Prefill with logged data {says}."


def test_headline_says_who_has_not_learned():
    assert "DDPG has not yet learned to hold the gap" in words.headline(study({"area": effect("negative")}))
    two = study({"area": effect("negative")})
    two["algorithms"] |= study({"area": effect("negative")}, algorithm="td3")["algorithms"]
    assert "harms DDPG and TD3. Neither has yet learned" in words.headline(two)


def test_learned_counts_seeds():
    text = words.learned_sentence(study({}, within=0.375, settled=0.125))
    assert "DDPG 3 of 8 with an empty buffer (1 settles) and 3 of 8 with a prefilled one (1 settles)" in text


def test_one_seed_has_no_interval():
    text = words.effect_words("area", effect("inconclusive", low=None, high=None, seeds=1), 0.95)
    assert text == "−3.10, no interval from 1 seed"


def test_classical_controllers_beside():
    assert plain(words.classical_sentence({"lqr": 0.114, "lqi": None})) == (
        "For comparison, LQR settles in 0.11 s and LQI does not settle from the reference start."
    )
    assert words.classical_sentence({}) == ""


@pytest.mark.parametrize(
    ("simulated", "logs", "says"),
    [
        (0, 3, ""),
        (1, 1, "The log is simulated"),
        (3, 3, "All 3 logs are simulated"),
        (1, 3, "1 of 3 logs is simulated"),
    ],
)
def test_simulated_is_said_plainly(simulated, logs, says):
    assert words.simulated_sentence(simulated, logs).startswith(says)


def test_unknown_code_is_still_readable():
    assert words.reason("brand_new_rule") == "Brand new rule."
