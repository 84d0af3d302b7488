"""The table of codes is whole: every code can be told, and every code that a check makes is in it."""

import re
from pathlib import Path
from string import Formatter

import pytest

import maglev_offline.ingest.checks as checks
from maglev_offline.ingest.checks import CODES
from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.findings import MOST_PLACES, SEVERITIES, Place


@pytest.mark.parametrize("code", CODES)
def test_an_entry_is_whole(code):
    entry = CODES[code]
    assert re.fullmatch(r"[a-z][a-z_]*", code)
    assert entry.severity in SEVERITIES
    assert entry.about in ("recording", "signal", "use")
    assert entry.sentence.endswith(".")
    assert entry.what.endswith(".")
    assert entry.todo


@pytest.mark.parametrize("code", CODES)
def test_a_check_makes_every_code(code):
    sources = "".join(path.read_text() for path in Path(checks.__file__).parent.glob("*.py") if path.stem != "codes")
    assert f'"{code}"' in sources


def test_the_words_are_filled_with_the_numbers():
    finding = make("clock_reset", "log", "topic", "point", {"largest_back_s": 45.0}, count=2)
    assert finding.what == "Times at which the clock goes back: 2, at most by 45 s."
    assert (finding.severity, finding.about, finding.count) == ("warning", "recording", 2)


def test_what_is_to_be_done_names_no_number_that_is_lacking():
    for entry in CODES.values():
        names = {name for text in (entry.what, entry.todo) for _, name, _, _ in Formatter().parse(text) if name}
        assert all(re.fullmatch(r"[a-z_]+", name) for name in names)


def test_places_are_cut_and_counted():
    finding = make("hole", "l", "t", "p", {"longest_s": 1.0, "bridge_ms": 25}, places=[Place()] * (MOST_PLACES + 5))
    assert len(finding.places) == MOST_PLACES
    assert finding.count == MOST_PLACES + 5
