"""`inspect`: what it ends with, what it gives to scripts and to people, and what it does with logs it cannot read."""

import json
import math
import os
import shutil

import pytest

T0 = 1_700_000_000_000_000_000
STEMS = ["surrogate-01-pid-json", "surrogate-02-cascade-cdr", "surrogate-03-pid-protobuf"]
FIELDS = {"code", "severity", "about", "log", "topic", "point", "what", "todo", "numbers", "count", "places"}


@pytest.fixture
def write(here, mcap_files):
    """Write a log of one point; `values` gives the message number k."""

    def write(name, values, period_ms=100, messages=300):
        path = here / name
        path.parent.mkdir(exist_ok=True)
        made = [mcap_files.Msg("/suspension/F1/state", T0 + k * period_ms * 10**6, values(k)) for k in range(messages)]
        return mcap_files.write(path, made)

    return write


def swinging(k):
    return {
        "gap_mm": 8 + math.sin(k / 9),
        "coil_current_a": 17 + math.cos(k / 9),
        "coil_voltage_v": 20 + math.sin(k / 5 + 1),
    }


def negative_gap(k):
    return {**swinging(k), "gap_mm": -3 - math.sin(k / 9)}


class TestExitCode:
    @pytest.mark.parametrize(("fail_on", "code"), [("never", 0), ("info", 1), ("warning", 1), ("error", 0)])
    def test_of_logs_whose_worst_finding_is_a_warning(self, here, call, fail_on, code):
        called = call("inspect", "logs", "--fail-on", fail_on, "--json")
        assert (called.code, called.json["worst"], called.json["status"]) == (code, "warning", "done")

    @pytest.mark.parametrize(("fail_on", "code"), [("never", 0), ("info", 2), ("warning", 2), ("error", 2)])
    def test_of_a_log_in_which_something_cannot_be(self, write, call, fail_on, code):
        called = call("inspect", write("a.mcap", negative_gap), "--fail-on", fail_on, "--json")
        assert (called.code, called.json["worst"]) == (code, "error")
        assert "gap_below_zero" in {one["code"] for one in called.json["logs"][0]["findings"]}

    def test_an_error_fails_unless_another_severity_is_given(self, write, call):
        assert call("inspect", write("a.mcap", negative_gap)).code == 2

    def test_a_severity_that_there_is_not_is_refused(self, here, call):
        called = call("inspect", "logs", "--fail-on", "fatal")
        assert called.code == 2
        assert "--fail-on" in called.err
        assert "Traceback" not in called.err


class TestForScripts:
    def test_findings_have_stable_fields(self, here, call):
        data = call("inspect", "logs", "--json").json
        assert set(data) == {"status", "worst", "logs", "across", "refused"}
        assert [log["file"] for log in data["logs"]] == [f"{stem}.mcap" for stem in STEMS]
        for log in data["logs"]:
            assert log["findings"]
            for finding in log["findings"]:
                assert set(finding) == FIELDS
                assert finding["severity"] in ("info", "warning", "error")
                assert finding["log"] == log["file"]
                assert finding["what"]
                assert finding["todo"]
                assert finding["count"] >= max(len(finding["places"]), 1)

    def test_the_order_of_the_logs_and_the_number_of_processes_change_nothing(self, here, call):
        names = [here / f"logs/{stem}.mcap" for stem in STEMS]
        once = call("inspect", *names, "--json", "--jobs", 1).out
        assert call("inspect", *reversed(names), "--json", "--jobs", 2).out == once

    def test_a_number_that_overflows_is_null(self, write, call):
        def spike(k):
            odd = {100: -1.7e308, 101: 1.7e308, 102: -1.7e308}
            return {**swinging(k), "coil_current_a": odd.get(k, 17 + math.cos(k / 9))}

        called = call("inspect", write("a.mcap", spike, period_ms=10), "--json", "--fail-on", "never")
        assert called.code == 0
        (spikes,) = [one for one in called.json["logs"][0]["findings"] if one["code"] == "spikes"]
        assert spikes["numbers"]["largest_jump"] is None

    def test_nothing_is_written(self, here, call):
        before = sorted(here.rglob("*"))
        call("inspect", "logs", "--json")
        assert sorted(here.rglob("*")) == before


class TestForPeople:
    def test_a_finding_is_told_with_its_place_and_what_to_do(self, write, call):
        shown = call("inspect", write("a.mcap", negative_gap)).out
        assert "error: gap_below_zero (point F1 /suspension/F1/state): The gap is below 0 in 300 messages" in shown
        assert "at 2023-11-14T22:13:20.000Z to 2023-11-14T22:13:49.900Z message 0-299" in shown
        assert "Correct the signal's offset or sign in [signals]." in shown

    def test_the_page_names_the_logs_and_their_findings(self, here, call):
        called = call("inspect", "logs", "--html", "page.html")
        assert called.code == 0
        page = (here / "page.html").read_text(encoding="utf-8")
        assert all(f"{stem}.mcap" in page for stem in STEMS)
        assert "coarse_time_base" in page
        assert "page.html" in called.out

    def test_json_and_page_may_be_asked_for_at_once(self, here, call):
        called = call("inspect", "logs", "--json", "--html", "page.html")
        assert called.json["status"] == "done"
        assert (here / "page.html").is_file()

    def test_a_name_that_looks_like_markup_stays_text(self, here, call):
        shutil.copy(here / f"logs/{STEMS[0]}.mcap", here / "<b>[red]x.mcap")
        called = call("inspect", "<b>[[]red]x.mcap", "--html", "page.html")
        assert "<b>[red]x.mcap" in called.out
        page = (here / "page.html").read_text(encoding="utf-8")
        assert "<b>[red]x" not in page
        assert "&lt;b&gt;[red]x.mcap" in page

    @pytest.mark.parametrize(
        ("page", "said"), [("none/page.html", "none: there is no such folder."), ("logs", "logs: this is a folder")]
    )
    def test_a_page_that_cannot_lie_there_is_refused_before_the_logs_are_read(self, here, call, page, said):
        called = call("inspect", "logs", "--html", page)
        assert called.code == 2
        assert called.err.startswith("error: ")
        assert said in called.err
        assert called.out == ""


class TestRefused:
    @pytest.mark.parametrize("content", [b"", b"this is no MCAP"])
    @pytest.mark.parametrize("fail_on", ["never", "error"])
    def test_a_log_that_cannot_be_read_ends_in_2_and_the_others_are_shown(self, here, call, content, fail_on):
        (here / "bad.mcap").write_bytes(content)
        called = call("inspect", "bad.mcap", "logs", "--json", "--fail-on", fail_on)
        assert called.code == 2
        assert called.json["status"] == "refused"
        assert [log["file"] for log in called.json["logs"]] == [f"{stem}.mcap" for stem in STEMS]
        (refused,) = called.json["refused"]
        assert refused["where"] == "bad.mcap"
        assert refused["what"]
        assert refused["todo"]
        assert "Traceback" not in called.err
        assert [line for line in called.err.splitlines() if line.startswith("error: bad.mcap: ")]

    @pytest.mark.parametrize(("share", "least", "most"), [(0, 0, 0), (0.5, 100, 200)])
    def test_a_log_that_was_cut_is_shown_with_its_damage(self, here, write, call, share, least, most):
        whole = write("whole.mcap", swinging).read_bytes()
        (here / "cut.mcap").write_bytes(whole[: max(round(share * len(whole)), 8)])  # at least the magic
        called = call("inspect", "cut.mcap", "--json")
        assert (called.code, called.json["worst"], called.json["refused"]) == (2, "error", [])
        (log,) = called.json["logs"]
        assert not log["whole_file"]
        assert least <= log["messages"] <= most
        assert "Traceback" not in called.err

    def test_a_file_may_have_any_bytes_for_its_name(self, here, call):
        name = os.fsdecode(b"logs/b\xff.mcap")
        try:
            shutil.copy(here / f"logs/{STEMS[0]}.mcap", here / name)
        except OSError:
            pytest.skip("the file system takes no such name")
        called = call("inspect", name, "--html", "page.html")
        assert called.code == 0
        assert "b\\udcff.mcap" in called.out
        assert "b\\udcff.mcap" in (here / "page.html").read_text(encoding="utf-8")
        called = call("inspect", "logs", "--json")  # and the log that it is a copy of
        assert {one["log"] for one in called.json["across"]} == {f"{STEMS[0]}.mcap", "b\\udcff.mcap"}


class TestSharedContent:
    def test_a_copy_is_told_of_both_of_its_names(self, here, call):
        shutil.copy(here / f"logs/{STEMS[0]}.mcap", here / "copy.mcap")
        called = call("inspect", "copy.mcap", f"logs/{STEMS[0]}.mcap", "--json")
        assert (called.code, called.json["worst"]) == (2, "error")
        told = {(one["code"], one["log"], one["numbers"]["other_log"], one["point"]) for one in called.json["across"]}
        names = ("copy.mcap", f"{STEMS[0]}.mcap")
        assert told == {
            ("duplicate_content", a, b, point) for a, b in (names, names[::-1]) for point in ("P1", "P2")
        }  # fmt: skip

    def test_a_copy_of_the_same_name_in_another_folder_is_told_by_its_path(self, here, call):
        (here / "other").mkdir()
        shutil.copy(here / f"logs/{STEMS[0]}.mcap", here / "other")
        across = call("inspect", "logs", "other", "--json").json["across"]
        assert {one["log"] for one in across} == {f"logs/{STEMS[0]}.mcap", f"other/{STEMS[0]}.mcap"}
        assert {one["code"] for one in across} == {"duplicate_content"}

    def test_people_are_told_of_it_too(self, here, call):
        shutil.copy(here / f"logs/{STEMS[0]}.mcap", here / "copy.mcap")
        assert "error: duplicate_content" in call("inspect", "copy.mcap", "logs").out

    def test_different_logs_share_nothing(self, here, call):
        assert call("inspect", "logs", "--json").json["across"] == []


def test_json_is_one_document_without_anything_else(here, call):
    called = call("inspect", "logs", "--json", "--quiet")
    assert json.loads(called.out)
    assert called.err == ""
