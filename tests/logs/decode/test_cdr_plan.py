import pytest

from maglev_offline.logs.decode.cdr_plan import Number, Repeat, Segment, String, Time, find, make_steps
from maglev_offline.logs.decode.ros2_definitions import read_message_type

TOP = read_message_type(
    "a/State",
    b"builtin_interfaces/Time stamp\nfloat64 gap\nbool on\nCoil[2] coils\nCoil[] spare\nstring name\n"
    b"===\nMSG: a/Coil\nuint8 id\nfloat64 current\nfloat32[3] turns",
)


def test_a_path_leads_to_a_number_or_to_the_two_parts_of_a_time():
    slots = {}
    assert find(TOP, ("gap",), slots) == Number(0)
    assert find(TOP, ("stamp",), slots) == Time(1, 2)
    assert find(TOP, ("stamp", "sec"), slots) == Number(1)
    assert find(TOP, ("coils", "1", "turns", "2"), slots) == Number(3)
    assert find(TOP, ("spare", "7", "current"), slots) == Number(4)
    assert slots == {
        ("gap",): 0,
        ("stamp", "sec"): 1,
        ("stamp", "nanosec"): 2,
        ("coils", 1, "turns", 2): 3,
        ("spare", 7, "current"): 4,
    }


@pytest.mark.parametrize(
    "path", ["on", "name", "coils", "coils.2.id", "coils.0", "coils.*.id", "gap.0", "nowhere", "name.0", "gap.x"]
)
def test_what_is_missing_or_no_number_has_no_source(path):
    slots = {}
    assert find(TOP, tuple(path.split(".")), slots) is None
    assert slots == {}


def test_fields_of_fixed_size_are_one_step_and_aligned_to_their_own_size():
    slots = {}
    find(TOP, ("coils", "0", "current"), slots)
    find(TOP, ("coils", "1", "current"), slots)
    first, *rest = make_steps(TOP, slots)
    assert isinstance(first, Segment)
    # stamp 0-8, gap 8-16, on 16, id 17, current 24-32, turns 32-44, id 44, current 48-56, turns 56-68
    layout = first.layouts[0]
    assert layout.size == 68
    assert [(c.first, c.span, c.fields) for c in layout.clusters] == [(24, 32, ((0, 0, "f8"), (1, 24, "f8")))]
    assert [type(step) for step in rest] == [Repeat, String]


def test_a_segment_has_a_layout_for_every_phase_it_may_begin_at():
    coil = dict(TOP.members)["spare"].element
    (segment,) = make_steps(coil, {("current",): 0})
    sizes = [layout.size for layout in segment.layouts]
    # id, then up to 7 bytes until `current` is aligned, then 8 + 12 bytes
    assert sizes == [8 + 20, 7 + 20, 6 + 20, 5 + 20, 4 + 20, 3 + 20, 2 + 20, 1 + 20]


def test_a_message_of_too_many_parts_has_no_plan():
    slots = {}
    for k in range(7000):
        find(TOP, ("spare", str(k), "current"), slots)
    with pytest.raises(ValueError, match="too many parts"):
        make_steps(TOP, slots)
