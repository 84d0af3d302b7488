"""The `[signals]` table refuses what cannot be meant."""

import pytest
from pydantic import ValidationError

from maglev_offline.logs.signals import Signal, SignalMap

NEEDED = {
    "topic": "/suspension/(?P<point>[^/]+)/state",
    "gap": {"field": "gap_mm", "unit": "mm"},
    "current": {"field": "i", "unit": "A"},
    "voltage": {"field": "u", "unit": "V"},
}


def test_gap_current_and_voltage_are_enough():
    found = SignalMap.model_validate(NEEDED)
    assert list(found.signals()) == ["gap", "current", "voltage"]


def test_the_point_is_the_named_group_of_the_topic():
    found = SignalMap.model_validate(NEEDED)
    assert found.point_of("/suspension/F1/state", found.gap) == "F1"
    assert found.point_of("/suspension/F1/state/x", found.gap) is None


def test_without_the_group_the_topic_is_the_point():
    found = SignalMap.model_validate({**NEEDED, "topic": "/levitator/state"})
    assert found.point_of("/levitator/state", found.gap) == "levitator_state"


def test_a_signal_may_have_a_topic_of_its_own():
    found = SignalMap.model_validate({**NEEDED, "gap": {**NEEDED["gap"], "topic": "/gap/(?P<point>.+)"}})
    assert found.point_of("/gap/F1", found.gap) == "F1"
    assert found.point_of("/gap/F1", found.current) is None


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"gap": {"field": "gap", "unit": "V"}}, "cannot be turned into 'm'"),
        ({"gap": {"field": "gap", "unit": "parsnip"}}, "'parsnip' is no unit that is known"),
        ({"gap": {"field": "", "unit": "m"}}, "at least 1 character"),
        ({"topic": "/a(b"}, "no regular expression"),
        ({"topic": "/(?P<car>.+)/x"}, "one named group only"),
        ({"clock": "header"}, "go together"),
        ({"clock_field": "header.stamp"}, "go together"),
        ({"clock": "header", "clock_field": "t", "clock_unit": "mm"}, "cannot be turned into 's'"),
        ({"context": {"gap_m": {"field": "x", "unit": "m"}}}, "name of its own"),
        ({"context": {"Speed": {"field": "x", "unit": "m"}}}, "lower-case"),
        ({"gpa": {"field": "gap", "unit": "m"}}, "Extra inputs"),
    ],
)
def test_what_cannot_be_meant_is_refused(change, complaint):
    with pytest.raises(ValidationError, match=complaint):
        SignalMap.model_validate({**NEEDED, **change})


def test_a_sign_is_one_or_minus_one():
    with pytest.raises(ValidationError, match="Input should be -1 or 1"):
        Signal(field="x", unit="m", sign=2)
