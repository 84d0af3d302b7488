"""Parts: in words, grouped by kind, and what leaving them out says of them."""

from maglev_offline.report.study.attribution import (
    attribution_figure,
    attribution_sentences,
    attribution_table,
    part_label,
    parts_in_order,
    rule_words,
)

NB = "\N{NO-BREAK SPACE}"


def test_a_planted_part_harms_and_another_helps(study):
    table = attribution_table(study.get("transfer").facts, 0.95)
    meaning = {row[0]: row[-1] for row in table.rows}
    assert meaning["DDPG, log 1"] == meaning["TD3, log 1"] == "harms"
    assert meaning["DDPG, log 2"] == "helps"
    assert meaning["DDPG, far, still"] == "does not matter"
    marks = dict(zip(meaning, table.marks, strict=True))
    assert (marks["DDPG, log 1"], marks["DDPG, log 2"]) == ("negative", "positive")


def test_sentences_name_what_holds_after_the_correction(study, with_facts):
    facts = study.get("transfer").facts
    assert attribution_sentences(facts)[0] == (
        "With DDPG, after Holm’s correction, of 4 parts of its prefilled buffer “log 1” harms; “log 2” helps."
    )
    parts = [{**part, "holds_after_holm": False} for part in facts["attribution"]["parts"]]
    facts = with_facts(attribution={**facts["attribution"], "parts": parts}).get("transfer").facts
    assert attribution_sentences(facts)[0].endswith("no part is shown to help or to harm.")


def test_parts_in_words():
    assert part_label("cells", "cell-at-rest-closing") == "middle, closing"
    assert part_label("cost_bands", "cost-4-of-4") == "cost 4 of 4 (highest)"
    rule = {"gap_error_m": [-1e6, -0.00125], "gap_velocity_m_s": [-0.0375, 0.0375]}
    assert rule_words(rule).replace(NB, " ") == "gap error < −1.25 mm, velocity ±37.5 mm/s"
    assert rule_words({"cost": [0.5, 1e6]}).replace(NB, " ") == "cost > 0.500"
    assert rule_words({"log_id": ["a\x07"]}) == "a�"


def test_figure_groups_parts_by_kind(study):
    facts = study.get("transfer").facts
    parts = facts["attribution"]["parts"]
    assert parts_in_order([*reversed(parts)])[-1] == ("cost_bands", "cost-1-of-4")
    ax = attribution_figure(facts).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == [
        "log 1",
        "log 2",
        "far, still",
        "cost 1 of 4 (lowest)",
    ]
    shares = [text.get_text().replace(NB, " ") for text in ax.texts]
    assert shares == ["60.0 %", "40.0 %", "4.12 %", "25.0 %", "rows"]
    assert len(ax.collections) == 8  # an interval for each part and algorithm
