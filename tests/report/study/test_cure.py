"""The cure: what chose it, what confirmed it, and a sentence that claims no more."""

from maglev_offline.report.study.cure import cure_sentences, cure_table, seed_range


def test_the_planted_cure_is_confirmed_for_one_algorithm_only(study):
    facts = study.get("transfer").facts
    table = cure_table(facts, 0.95)
    first, second = (dict(zip(table.head[:3], row[:3], strict=True)) | {"verdict": row[-1]} for row in table.rows)
    assert first == {
        "algorithm": "DDPG", "chosen arm": "good", "chosen on seeds": "0 to 5", "verdict": "positive transfer"
    }  # fmt: skip
    assert second["verdict"] == "negative transfer"
    sentences = cure_sentences(facts, 0.95)
    assert sentences[0].startswith("With DDPG, of 2 candidates “good” looks best on the first half of the seeds; ")
    assert sentences[0].endswith("confirmed, it helps.")
    assert sentences[1].endswith("not confirmed, it harms.")


def test_without_an_interval_none_is_claimed(study):
    facts = study.get("transfer").facts
    cure = facts["cure"]["algorithms"]["ddpg"]
    effect = {**cure["confirmed"], "low": None, "high": None, "verdict": "inconclusive"}
    facts = {**facts, "cure": {"candidates": ["good"], "algorithms": {"ddpg": {**cure, "confirmed": effect}}}}
    (sentence,) = cure_sentences(facts, 0.95)
    assert sentence.startswith("With DDPG, the only candidate, “good”, looks best")
    assert "(no interval from 6 seeds): not confirmed, inconclusive." in sentence


def test_seeds_are_named_as_a_range_where_they_are_one():
    assert seed_range([3, 4, 5]) == "3 to 5"
    assert seed_range([1, 3]) == "1, 3"
