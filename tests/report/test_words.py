"""The sentences: each verdict is called by its name, and nothing is claimed that was not found."""

import pytest

from maglev_offline.report import words


def effect(verdict, difference=-3.1, low=-5.0, high=-1.2, seeds=8):
    return {
        "verdict": verdict,
        "baseline_mean": 33.3,
        "arm_mean": 33.3 - difference,
        "difference": difference,
        "low": low,
        "high": high,
        "seeds": seeds,
    }


def study(effects, *, reached=0.5, within=0.0, settled=0.0, algorithm="ddpg", primary="area"):
    arm = {"seeds": 8, "share_reached": reached, "share_within_half_mm": within, "share_settled": settled}
    algorithms = {algorithm: {"arms": {"empty": arm, "prefill": arm}, "effects": {"prefill": effects}}}
    rows = {"prefill": {"rows_from": "log"}}
    return {"primary_metric": primary, "arms": ["empty", "prefill"], "rows": rows, "algorithms": algorithms}


def plain(text):
    return text.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (
            "negative",
            "raised the mean cost over the whole training (area: 33.3 to 36.4, difference −3.10, "
            "95 % interval −5.00 to −1.20, 8 seeds)",
        ),
        ("positive", "lowered the mean cost over the whole training (area: 33.3 to 36.4, difference −3.10, "),
        ("equivalent", "made no difference that matters to the area (33.3 to 36.4, difference −3.10, "),
        ("inconclusive", "left open which way the area (33.3 to 36.4, difference −3.10, "),
    ],
)
def test_answer_names_the_verdict(verdict, says):
    (sentence,) = words.answers(study({"area": effect(verdict)}), {"ddpg": 10_000}, 0.95, ["prefill"])
    assert plain(sentence).startswith("With DDPG, 10,000 logged rows in the buffer ")
    assert says in plain(sentence)
    assert sentence.endswith(f": {verdict}.")


def test_answer_keeps_verdicts_apart():
    (sentence,) = words.answers(
        study({"jumpstart": effect("positive"), "area": effect("negative"), "asymptote": effect("inconclusive")}),
        {},
        0.9,
        ["prefill"],
    )
    negative, positive, open_ = plain(sentence).split("; ")
    assert "area" in negative
    assert "90 % interval" in negative
    assert negative.endswith(": negative")
    assert "jumpstart" in positive
    assert positive.endswith(": positive")
    assert "asymptote" in open_


def test_a_threshold_that_no_run_reaches_says_nothing():
    found = study({"area": effect("inconclusive"), "time_to_threshold": effect("equivalent", 0, 0, 0)}, reached=0.0)
    (sentence,) = words.answers(found, {}, 0.95, ["prefill"])
    assert "equivalent" not in sentence
    assert "no run of either arm reaches the threshold" in sentence
    headline = words.headline(found | {"primary_metric": "time_to_threshold"})
    assert "Judged by the steps needed to reach the threshold" in headline
    assert "has no effect on DDPG that so many seeds could establish" in headline


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        ("negative", "harms DDPG"),
        ("positive", "helps DDPG"),
        ("equivalent", "makes no difference that matters to DDPG"),
        ("inconclusive", "has no effect on DDPG that so many seeds could establish"),
    ],
)
@pytest.mark.parametrize("other", ["negative", "positive", "equivalent", "inconclusive"])
def test_headline_is_judged_by_the_primary_metric_alone(verdict, says, other):
    found = study({"asymptote": effect(other), "area": effect(verdict)}, within=1.0, settled=1.0)
    judged = "Judged by the mean cost over the whole training, prefill with logged data"
    assert words.headline(found) == f"{judged} {says}."
    found = study({"asymptote": effect(verdict), "area": effect(other)}, within=1.0, settled=1.0, primary="asymptote")
    assert words.headline(found) == f"Judged by the cost at the end of training, prefill with logged data {says}."


def test_headline_keeps_algorithms_apart():
    found = study({"area": effect("negative")}, within=1.0, settled=1.0)
    found["algorithms"] |= study({"area": effect("positive")}, within=1.0, settled=1.0, algorithm="td3")["algorithms"]
    assert words.headline(found).endswith("prefill with logged data harms DDPG and helps TD3.")


def test_headline_says_who_has_not_learned():
    says = "DDPG has not yet learned to regulate: to settle and stay within 0.5 mm in most runs."
    assert words.headline(study({"area": effect("negative")})).endswith(says)
    two = study({"area": effect("negative")})
    two["algorithms"] |= study({"area": effect("negative")}, algorithm="td3")["algorithms"]
    assert "harms DDPG and TD3. Neither has yet learned to regulate" in words.headline(two)


@pytest.mark.parametrize(("within", "settled", "learned"), [(1, 1, True), (1, 0.5, False), (0.5, 1, False)])
def test_to_have_learned_is_to_settle_and_to_stay_in_most_runs(within, settled, learned):
    text = words.headline(study({"area": effect("negative")}, within=within, settled=settled))
    assert ("yet learned" not in text) == learned


def test_learned_counts_seeds():
    text = words.learned_sentence(study({}, within=0.375, settled=0.125), ["empty", "prefill"])
    assert plain(text).startswith(
        "Last policies whose gap error stays within 0.5 mm over the last 20 % of the episode from every start: DDPG"
    )
    assert "DDPG 3 of 8 with an empty buffer (1 settles) and 3 of 8 with a prefilled one (1 settles)" in text


def test_an_effect_names_both_means_and_their_difference():
    found = effect("negative", -8.58, -14.0, -2.0) | {"arm_mean": 41.88}
    assert plain(words.effect_words("area", found, 0.95)) == (
        "33.3 to 41.9, difference −8.58, 95 % interval −14.0 to −2.00, 8 seeds"
    )
    assert plain(words.effect_words("time_to_threshold", found, None)).startswith(
        "33.3 to 41.9 steps, difference −8.58"
    )


def test_one_seed_has_no_interval():
    text = words.effect_words("area", effect("inconclusive", low=None, high=None, seeds=1), 0.95)
    assert text == "33.3 to 36.4, difference −3.10, no interval from 1 seed"


def test_classical_controllers_beside_with_how_often_they_act():
    assert plain(words.classical_sentence({"lqr": 0.1, "lqr_held": 0.114, "lqi": None})) == (
        "For comparison, the LQR that decides as often as they do settles in 0.11 s from the reference start and "
        "the LQI at every plant step does not settle."
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


def test_arms_whose_rows_are_no_logs_are_no_prefill_with_logged_data():
    found = study({"area": effect("inconclusive")})
    control = {"area": effect("positive")}
    found["arms"] = ["empty", "half_reconstructed", "half_pid"]
    found["rows"] = {"half_reconstructed": {"rows_from": "log"}, "half_pid": {"rows_from": "pid"}}
    arms = found["algorithms"]["ddpg"]
    arms["arms"] |= dict.fromkeys(found["arms"], arms["arms"]["empty"])
    arms["effects"] = {"half_reconstructed": {"area": effect("inconclusive")}, "half_pid": control}
    assert "(“half_reconstructed”) has no effect on DDPG" in words.headline(found)
    assert words.verdict_words(found, "half_pid", "positive") == "better"
    assert words.verdict_words(found, "half_reconstructed", "positive") == "positive transfer"
    found["rows"] = {"half_pid": {"rows_from": "pid"}}
    assert words.headline(found).startswith("No arm of this study starts with rows of logs")
