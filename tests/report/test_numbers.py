"""Numbers as readers see them."""

import math

import pytest

from maglev_offline.report.numbers import listing, number, percent, spread, whole


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (-3.14159, "−3.14"),
        (12345.6, "12,346"),
        (0.04567, "0.0457"),
        (9.999, "10.0"),
        (1.2e-5, "1.20 × 10⁻⁵"),
        (-2.5e8, "−2.50 × 10⁸"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "–"),
    ],
)
def test_number(value, text):
    assert number(value) == text


def test_whole_and_percent():
    assert whole(1234567) == "1,234,567"
    assert whole(None) == "–"
    assert percent(0.125) == "12.5\N{NO-BREAK SPACE}%"
    assert percent(1e-6).startswith("< 0.1")
    assert percent(0.99999).startswith("> 99.9")
    assert percent(None) == "–"


def test_spread_leaves_out_what_does_not_exist():
    assert spread([1.0, 2.0, 3.0, math.nan]).replace("\N{NO-BREAK SPACE}", " ") == "2.00 (1.5 to 2.5)"
    assert spread([5.0]) == "5.00"
    assert spread([math.nan]) == "–"


def test_listing():
    assert [listing(list("abc")[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
