"""The sections of a study: there where there is something to say, the same bytes each time, true to the manifest."""

import re

import pytest

from maglev_offline.report.evidence import Evidence
from maglev_offline.report.page import Paragraph, Plot, Table
from maglev_offline.report.study.sections import differences_section, profiles_section, why_section
from maglev_offline.report.style import ARMS, arm_stroke
from maglev_offline.report.svg import inline_svg

SECTIONS = (differences_section, profiles_section, why_section)


@pytest.fixture(scope="module")
def sections(study):
    return {section.key: section for section in (make(study) for make in SECTIONS)}


def words(section):
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))


def test_all_three_are_there(sections):
    assert list(sections) == ["differences", "profiles", "why"]
    keys = [block.key for section in sections.values() for block in section.blocks if isinstance(block, Plot)]
    assert keys == ["differences", "profiles", "attribution", "foretelling"]
    for section in sections.values():
        for block in section.blocks:
            if isinstance(block, Plot | Table):
                assert re.search(r"From transfer \([^()]*(manifest\.json|metrics\.parquet)\)\.$", block.caption)


def test_without_a_study_there_is_nothing():
    assert [make(Evidence({})) for make in SECTIONS] == [None, None, None]


def test_two_arms_have_no_why(plain_study):
    assert [section and section.key for section in (make(plain_study) for make in SECTIONS)] == [
        "differences",
        "profiles",
        None,
    ]


def test_why_shows_what_there_is_only(with_facts):
    section = why_section(with_facts(attribution={}, foretelling={}))
    assert [type(block) for block in section.blocks] == [Paragraph, Table]


def test_sentences_say_what_the_manifest_says(sections):
    said = words(sections["differences"])
    assert "DDPG, judged by area: “good” beats the empty buffer; “prefilled buffer” and “bad” do worse" in said
    assert "“same” makes no difference that matters. Holm’s correction changes none of it." in said
    reached = words(sections["profiles"])
    assert "With DDPG, the runs that reach it are 12 of 12 (empty buffer), " in reached
    assert "0 of 12 (bad)" in reached


def test_holm_is_said_where_it_changes_something(study, with_facts):
    algorithms = study.get("transfer").facts["algorithms"]
    effects = {arm: {m: {**e} for m, e in found.items()} for arm, found in algorithms["ddpg"]["effects"].items()}
    changed = {"ddpg": {**algorithms["ddpg"], "effects": effects}}
    effects["prefill"]["area"]["holds_after_holm"] = effects["bad"]["area"]["holds_after_holm"] = False
    said = words(differences_section(with_facts(algorithms=changed)))
    assert said.endswith("After Holm’s correction only “good” still differs.")
    effects["good"]["area"]["holds_after_holm"] = False
    said = words(differences_section(with_facts(algorithms=changed)))
    assert said.endswith("After Holm’s correction none of these differences holds.")


def test_the_same_study_gives_the_same_bytes(sections, study):
    again = {section.key: section for section in (make(study) for make in (why_section,))}
    for key, section in again.items():
        for first, second in zip(sections[key].blocks, section.blocks, strict=True):
            if isinstance(first, Plot):
                svg = inline_svg(first.figure(), first.key)
                assert svg == inline_svg(second.figure(), second.key)
                assert len(svg) < 150_000


def test_many_arms_stay_apart():
    arms = ["empty", "prefill", *(f"arm{k}" for k in range(15))]
    strokes = {(stroke.colour, str(stroke.dash)) for stroke in (arm_stroke(arm, arms) for arm in arms)}
    assert len(strokes) == 17
    assert arm_stroke("empty", arms) == ARMS["empty"]
