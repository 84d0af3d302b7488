"""The page of `inspect`: all that was found is on it, what a log says stays text, and it needs nothing else."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.ingest.findings import Finding, Place
from maglev_offline.ingest.inspect_lanes import MOST_LANES, WIDTH, lanes_of, time_range
from maglev_offline.ingest.inspect_page import inspect_page

T0 = 1_704_096_000 * 10**9  # 2024-01-01 08:00:00
S = 10**9

VOID = {"meta", "link", "br", "hr", "img", "input"}


class Page(HTMLParser):
    """Elements, attributes and text of a page; every element must be closed in its place."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.text = ""
        self.styles = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "style":
            self.styles += data
        else:
            self.text += data.replace("\xa0", " ")


def channel(topic: str = "/suspension/P1/state", **changes: Any) -> dict[str, Any]:
    return {
        "topic": topic, "message_encoding": "cdr", "schema_encoding": "ros2msg", "schema_name": "maglev/msg/State",
        "decodable": True, "messages": 12_345, "first_log_time_ns": T0, "last_log_time_ns": T0 + 100 * S,
        "period_ms": 4.0, "jitter_ms": 0.25, "longest_silence_ms": 1500.0, "steps_back": 2,
        "fields": ("gap_mm",), "times": (), **changes,
    }  # fmt: skip


def summary(**changes: Any) -> dict[str, Any]:
    return {
        "file": "a.mcap", "size_bytes": 1_234_567, "sha256": "ab" * 32, "simulated": False, "whole_file": True,
        "metadata": {"run": {"driver": "K. Ohm"}}, "compressions": ("zstd",), "messages": 12_345,
        "channels": (channel(),),
        "signals": {"topic": "/suspension/(?P<point>[^/]+)/state", "gap": {"field": "gap_mm", "unit": "mm", "sign": -1},
                    "context": {"speed_m_s": {"field": "speed", "unit": "km/h"}}},
        "points": ("P1",), "points_left_out": {"P2": "lacks voltage"}, "why_no_signals": "",
        "counts": {"rows": 1000}, "left_out": {"not_finite": 3}, "decoded_by": {"cdr": 12_345}, **changes,
    }  # fmt: skip


def finding(code: str = "stuck", severity: Any = "warning", **changes: Any) -> Finding:
    told: dict[str, Any] = {
        "code": code, "severity": severity, "about": "signal", "log": "a.mcap", "topic": "/suspension/P1/state",
        "point": "P1", "what": "The gap does not move.", "todo": "Look at the sensor.", "numbers": {"longest_s": 3.5},
        "count": 1, "places": (Place(T0 + 10 * S, T0 + 20 * S, 100, 200),), **changes,
    }  # fmt: skip
    return Finding(**told)


def test_a_log_with_all_that_is_known_of_it() -> None:
    page = Page(inspect_page([summary(simulated=True)], [finding()]))
    for words in (
        "a.mcap", "SIMULATED", "1.23 MB", "ab" * 32, "12,345", "250 Hz", "0.25 ms", "1,500 ms", "cdr", "msg/State",
        "gap_mm", "sign -1", "speed_m_s", "km/h", "P2: lacks voltage", "K. Ohm", "not finite 3", "stuck",
        "The gap does not move.", "Look at the sensor.", "longest s", "3.5",
        "2024-01-01 08:00:10.000 UTC for 10 s; messages 100 to 200", "1 warning",
    ):  # fmt: skip
        assert words in page.text, words
    assert "SIMULATED" not in Page(inspect_page([summary()], [])).text


def test_the_page_needs_nothing_else() -> None:
    page = Page(inspect_page([summary(), summary(file="b.mcap")], [finding()]))
    assert not set(page.tags) & {"script", "img", "link", "iframe", "object", "form", "base"}
    assert not [a for a in page.attributes if a[1] in ("src", "srcset", "action") or a[1].startswith("on")]
    assert all(value.startswith("#log-") for _, name, value in page.attributes if name == "href")
    assert "url(" not in page.styles
    assert "@import" not in page.styles
    assert ("meta", "content", "default-src 'none'; style-src 'unsafe-inline'") in page.attributes
    ids = [value for _, name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))


NASTY = "</title></svg><script>alert(1)</script>\"'><img src=x onerror=alert(1)>{{ 7*7 }}&amp;"


def every_text(value: Any, text: str) -> Any:
    """Put the text into every string of a summary, keys that a log chooses included."""
    if isinstance(value, str):
        return value + text
    if isinstance(value, dict):
        return {key: every_text(one, text) for key, one in value.items()}
    return type(value)(every_text(one, text) for one in value) if isinstance(value, list | tuple) else value


def nasty_page(text: str) -> str:
    log = every_text(summary(), text)
    log |= {"metadata": {text: {text: text}}, "points_left_out": {text: text}}
    log["signals"]["context"] = {text: {"field": text, "unit": text, text: text}}
    found = [
        finding(code=text, topic=topic, log=log["file"], point=text, what=text, todo=text, numbers={text: text})
        for topic in (log["channels"][0]["topic"], text, "")
    ]
    unmapped = summary(file=text, signals=None, why_no_signals=text)
    return inspect_page([log, unmapped], [*found, finding(log=f"no such log {text}")])


def test_what_a_log_says_stays_text() -> None:
    page = Page(nasty_page(NASTY))
    assert not {"script", "img"} & set(page.tags)
    assert not [a for a in page.attributes if a[1].startswith("on")]
    assert page.text.count("<script>alert(1)</script>") > 10
    assert "{{ 7*7 }}" in page.text
    assert any(NASTY in value for tag, name, value in page.attributes if (tag, name) == ("svg", "aria-label"))


@settings(deadline=None, max_examples=25)
@given(st.text(max_size=30))
def test_any_text_makes_a_page_that_can_be_written_and_read(text: str) -> None:
    plain, page = Page(nasty_page("")), nasty_page(text)
    page.encode()
    parsed = Page(page)
    assert set(parsed.tags) <= set(plain.tags) | {"p", "dd", "dt", "ul", "li", "div", "section"}
    assert not re.search("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", page)


def test_findings_stand_under_their_log_the_worst_first() -> None:
    found = [
        finding("z_info", "info"),
        finding("m_warning", "warning"),
        finding("b_error", "error"),
        finding("a_error", "error"),
        finding("of_b", "error", log="b.mcap"),
        finding("of_nobody", "error", log="c.mcap"),
    ]
    text = Page(inspect_page([summary(), summary(file="b.mcap")], found)).text
    places = [text.rindex(code) for code in ("a_error", "b_error", "m_warning", "z_info", "of_b", "of_nobody")]
    first_findings = text.index("\nFindings\n")
    assert [first_findings, *places] == sorted([first_findings, *places])
    assert "Findings of other logs" in text
    assert "4 errors" in text[:300]


def test_only_the_first_places_are_written_and_the_others_counted() -> None:
    places = tuple(Place(T0 + k * S) for k in range(100))
    text = Page(inspect_page([summary()], [finding(count=1234, places=places)])).text
    assert "08:00:04.000" in text
    assert "08:00:05.000" not in text
    assert "and 1,229 more" in text


def test_places_of_bytes_and_messages() -> None:
    places = (Place(byte_offset=4096, byte_length=512), Place(first_message=7, last_message=7), Place(first_message=3))
    text = Page(inspect_page([summary()], [finding(places=places, count=3)])).text
    for words in ("byte 4,096, 512 bytes", "message 7", "message 3"):
        assert words in text
    assert "more" not in text[text.index("byte 4,096") : text.index("Channels")]


@pytest.mark.parametrize("t_ns", [-(2**63), -1, 0, 2**63 - 1, 2**64 - 1])
def test_any_number_may_be_a_time(t_ns: int) -> None:
    log = summary(channels=(channel(first_log_time_ns=t_ns, last_log_time_ns=t_ns), channel("/b")))
    Page(inspect_page([log], [finding(places=(Place(t_ns, t_ns + 1),))]))


def test_an_empty_log_and_one_that_cannot_be_read() -> None:
    nothing = channel(first_log_time_ns=None, last_log_time_ns=None, period_ms=None, jitter_ms=None,
                      longest_silence_ms=None, messages=0, decodable=False, schema_name="")  # fmt: skip
    log = summary(channels=(nothing,), signals=None, why_no_signals="No gap is in it.", metadata={}, compressions=())
    text = Page(inspect_page([log], [])).text
    for words in ("No gap is in it.", "cdr (cannot be decoded)", "None.", "0 errors"):
        assert words in text
    assert "Time line" not in text
    assert "0 logs" in Page(inspect_page([], [])).text


def test_numbers_that_are_none_or_not_finite() -> None:
    text = Page(
        inspect_page([summary()], [finding(numbers={"a": float("nan"), "b": None, "c": -0.5, "d": 12_345})])
    ).text
    for words in ("nan", "–", "−0.5", "12,345"):
        assert words in text


def test_same_page_again() -> None:
    assert inspect_page([summary()], [finding()]) == inspect_page([summary()], [finding()])


def marks(
    found: list[Finding], channels: tuple[dict[str, Any], ...] = (channel(),)
) -> Iterator[tuple[str, float, float]]:
    span = time_range(channels)
    assert span is not None
    for lane in lanes_of(channels, found, span):
        for mark in lane.marks:
            yield lane.name, mark.x, mark.width


def test_places_lie_on_the_lane_of_their_topic() -> None:
    assert list(marks([finding()])) == [("/suspension/P1/state", 100.0, 100.0)]
    assert list(marks([finding(topic="")])) == [("point P1", 100.0, 100.0)]
    assert list(marks([finding(topic="", point="")])) == [("the whole log", 100.0, 100.0)]
    assert list(marks([finding(places=(Place(first_message=3),))])) == []


@given(st.integers(-(2**70), 2**70), st.integers(-(2**70), 2**70))
def test_a_mark_never_leaves_its_lane(start_ns: int, end_ns: int) -> None:
    ((_, x, width),) = marks([finding(places=(Place(start_ns, end_ns),))])
    assert x >= 0
    assert width > 0
    assert x + width <= WIDTH + 0.01


def test_stretches_of_a_channel_are_drawn_where_they_are_known() -> None:
    parts = ((T0, T0 + 25 * S), (T0 + 50 * S, T0 + 100 * S))
    channels = (channel(stretches=parts), channel("/b"))
    one, other = lanes_of(channels, [], (T0, T0 + 100 * S))
    assert one.bars == [(0.0, 250.0), (500.0, 500.0)]
    assert other.bars == [(0.0, 1000.0)]


def test_of_very_many_topics_those_with_findings_are_shown() -> None:
    channels = tuple(channel(f"/t{k:03d}") for k in range(200))
    lanes = lanes_of(channels, [finding(topic="/t150")], (T0, T0 + 100 * S))
    assert len(lanes) == MOST_LANES
    assert lanes[0].name == "/t150"
