import json

import pytest

from maglev_offline.doctor.check import Check, exit_code, lines, plain, worst

OK = Check("disk", "disk", "ok", "9 GB free")
NOTE = Check("extra", "extra export", "note", "onnx not here", "pip install 'maglev-offline[export]'")
PROBLEM = Check("lock", "lock", "problem", "in use", "Wait.")


@pytest.mark.parametrize(
    ("checks", "state", "code"),
    [([], "ok", 0), ([OK], "ok", 0), ([NOTE, OK], "note", 0), ([OK, PROBLEM], "problem", 2)],
)
def test_only_a_problem_ends_in_an_exit_code(checks, state, code):
    assert (worst(checks), exit_code(checks)) == (state, code)


def test_each_line_begins_with_its_state_and_what_to_do_is_below():
    assert lines([OK, NOTE, PROBLEM]) == [
        "ok       disk: 9 GB free",
        "note     extra export: onnx not here",
        "         pip install 'maglev-offline[export]'",
        "problem  lock: in use",
        "         Wait.",
        "1 problem stands in the way of the whole road.",
    ]


def test_dependencies_that_are_well_share_a_line():
    well = [Check("dependency", name, "ok", "1.0") for name in ("mcap", "numpy")]
    told = lines([well[0], Check("dependency", "torch", "problem", "not here"), well[1]])
    assert told[:2] == ["ok       dependencies: mcap 1.0, numpy 1.0", "problem  torch: not here"]


def test_quiet_leaves_out_what_is_well():
    assert lines([OK], quiet=True) == ["Nothing stands in the way of the whole road."]
    assert lines([OK, PROBLEM, PROBLEM], quiet=True)[-1] == "2 problems stand in the way of the whole road."


def test_scripts_get_all_of_it():
    found = plain([OK, NOTE])
    assert json.loads(json.dumps(found)) == found
    assert (found["worst"], found["counts"]) == ("note", {"ok": 1, "note": 1, "problem": 0})
    assert [set(check) for check in found["checks"]] == [{"code", "about", "state", "what", "todo", "facts"}] * 2
