import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.errors import InputError
from maglev_offline.ingest.merge import Part, merge_order, merged_sha256


def names(*parts):
    return [part.name for part in merge_order(parts)]


def test_parts_come_in_order_of_their_first_time_then_of_their_names():
    late, early = Part("a", {"/gap": (20, 30)}), Part("b", {"/gap": (0, 10), "/current": (2, 12)})
    assert names(late, early) == ["b", "a"]
    assert names(Part("d", {"/current": (5, 6)}), Part("c", {"/gap": (5, 6)})) == ["c", "d"]


def test_a_part_without_messages_comes_last():
    assert names(Part("a"), Part("b", {"/gap": (-5, 10)})) == ["b", "a"]


@pytest.mark.parametrize("second", [(5, 15), (0, 10), (2, 3), (9, 20)])
def test_parts_that_overlap_on_a_topic_are_refused_and_both_are_named(second):
    with pytest.raises(InputError, match=r"overlaps with [ab] for .* s on /gap, so they are not parts") as told:
        names(Part("a", {"/gap": (0, 10)}), Part("b", {"/gap": second}))
    assert {told.value.where, told.value.what.split()[3]} == {"a", "b"}


def test_an_overlap_is_found_behind_a_short_part_in_between():
    parts = [Part("a", {"/gap": (0, 100)}), Part("b", {"/gap": (100, 100)}), Part("c", {"/gap": (50, 60)})]
    with pytest.raises(InputError, match=r"^c: it overlaps with a for 0\.000 s on /gap"):
        names(*parts)


def test_parts_may_meet_in_one_instant_and_run_side_by_side_on_other_topics():
    assert names(Part("b", {"/gap": (10, 20)}), Part("a", {"/gap": (0, 10)})) == ["a", "b"]
    assert names(Part("b", {"/current": (0, 20)}), Part("a", {"/gap": (0, 20)})) == ["a", "b"]


def test_a_part_that_is_named_twice_is_refused():
    with pytest.raises(InputError, match=r"^a: it is named twice"):
        names(Part("a", {"/gap": (0, 1)}), Part("a", {"/gap": (2, 3)}))


@given(st.permutations([Part(f"p{k}", {"/gap": (10 * k, 10 * k + 9), f"/own{k}": (0, 99)}) for k in range(6)]))
def test_the_order_in_which_parts_are_named_changes_nothing(parts):
    assert names(*parts) == [f"p{k}" for k in range(6)]


spans = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 10)), min_size=1, max_size=6)


@given(spans)
def test_parts_are_one_recording_only_if_no_two_of_them_overlap(found):
    parts = [Part(f"p{k}", {"/gap": (first, first + length)}) for k, (first, length) in enumerate(found)]
    clash = any(
        max(a.topics["/gap"][0], b.topics["/gap"][0]) < min(a.topics["/gap"][1], b.topics["/gap"][1])
        or (a.topics["/gap"][0] < b.topics["/gap"][0] < a.topics["/gap"][1])
        for a in parts
        for b in parts
        if a is not b
    )
    if clash:
        with pytest.raises(InputError, match="overlaps with"):
            merge_order(parts)
    else:
        assert len(merge_order(parts)) == len(parts)


def test_a_recording_is_known_by_its_parts_and_their_order():
    assert len({merged_sha256(h) for h in (["a", "b"], ["b", "a"], ["a"], ["a", "b", "c"])}) == 4
    assert merged_sha256(iter(["a", "b"])) == merged_sha256(["a", "b"])
