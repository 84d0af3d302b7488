import json

import pytest

from maglev_offline import console
from maglev_offline.console import Talk
from maglev_offline.errors import InputError


def test_results_go_to_standard_output_and_remarks_to_standard_error(capsys):
    talk = Talk()
    talk.say("a remark")
    talk.warn("look here")
    talk.result({"rows": 1}, "one row")
    assert capsys.readouterr() == ("one row\n", "a remark\nwarning: look here\n")


def test_json_is_all_there_is_on_standard_output(capsys):
    talk = Talk(as_json=True)
    talk.say("a remark")
    talk.table("Logs", ["log"], [["a"]])
    talk.lines("for people")
    talk.result({"rows": 1, "name": "gap in µm"}, "for people")
    out, err = capsys.readouterr()
    assert json.loads(out) == {"rows": 1, "name": "gap in µm"}
    assert err == "a remark\n"


def test_a_number_that_json_does_not_know_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        Talk(as_json=True).result({"cost": float("nan")})


def test_a_quiet_run_tells_its_result_its_warnings_and_its_errors_only(capsys, monkeypatch):
    monkeypatch.setattr(console, "SECONDS_BETWEEN_LINES", 0.0)
    talk = Talk(quiet=True)
    talk.say("a remark")
    with talk.task("training", 10, "steps") as tick:
        tick(5)
    talk.warn("look here")
    talk.fail(InputError("it is cut.", where="a.mcap"))
    talk.lines("the result")
    assert capsys.readouterr() == ("the result\n", "warning: look here\nerror: a.mcap: it is cut.\n")


def test_the_long_part_of_an_error_is_told_once_for_all_logs_that_have_it(capsys):
    talk = Talk()
    for name, messages in (("a.mcap", 1500), ("b.mcap", 12)):
        talk.error(f"{name}: no signals. The log holds:\n  /magnet: gap, {messages:,} messages")
    first = "a.mcap: no signals. The log holds:\n  /magnet: gap, 1,500 messages"
    second = "b.mcap: no signals. The log holds:"
    assert capsys.readouterr().err == f"error: {first}\nerror: {second} the same as above.\n"


@pytest.mark.parametrize("name", ["/a[bold]b[/]", "/[red]x", "/car:car:", "[signals] gap", "a\\[b]", "ends in \\"])
def test_a_name_is_shown_as_it_is_and_never_read_as_markup(capsys, name):
    talk = Talk()
    talk.say(name)
    talk.warn(name)
    talk.fail(InputError(name))
    talk.lines(name)
    talk.table(name, ["topic", "n"], [[name, "1"]])
    out, err = capsys.readouterr()
    assert out.count(name) == 3
    assert err.count(name) == 3


def test_a_name_cannot_steer_the_terminal(capsys):
    talk = Talk()
    talk.say("a\x1b[2Jb\x07")
    talk.table("t\x1b]0;x", ["topic"], [["a\x9b31mb"]])
    out, err = capsys.readouterr()
    assert not {"\x1b", "\x07", "\x9b"} & set(out + err)
    assert "b" in err


def test_long_lines_and_tables_are_not_wrapped_without_a_terminal(capsys):
    talk = Talk()
    talk.lines("word " * 100)
    talk.table("", ["topic", "schema"], [["/" + "x" * 100, "y" * 60]])
    out = capsys.readouterr().out
    assert "word " * 99 in out
    assert "x" * 100 in out
    assert "\x1b" not in out


def test_an_empty_table_is_not_shown(capsys):
    Talk().table("Logs", ["log"], [])
    assert capsys.readouterr().out == ""


def test_a_long_task_says_a_plain_line_now_and_then(capsys, monkeypatch):
    clock = iter([0.0, 4.0, 11.0, 12.0, 25.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    with Talk().task("training", 2000, "steps") as tick:
        tick(500)
        tick(500)
        tick(500)
        tick(500)
    assert capsys.readouterr() == (
        "",
        "training: 1,000 of 2,000 steps (50%, 90.9 steps/s, 0:00:11 left)\n"
        "training: 2,000 of 2,000 steps (100%, 80 steps/s, 0:00:00 left)\n",
    )


def test_a_task_without_work_says_nothing(capsys, monkeypatch):
    monkeypatch.setattr(console, "SECONDS_BETWEEN_LINES", 0.0)
    with Talk().task("ingest", 0, "log"):
        pass
    assert capsys.readouterr() == ("", "")
