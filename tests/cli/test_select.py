"""`ingest` of a part of the logs by time, topic, point and condition; of several files as one; and a dry run."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from maglev_offline.logs.channels import read_info
from maglev_offline.workspace import Workspace

STEMS = ["surrogate-01-pid-json", "surrogate-02-cascade-cdr", "surrogate-03-pid-protobuf"]
ONE = f"logs/{STEMS[1]}.mcap"
"""A log without a contact, of two points: nothing is put aside in it but what a selection leaves out, and repeats."""
S = 10**9
T0 = 1_700_000_000 * S


@pytest.fixture
def ingested(here, call):
    """Ingest one log with these options: its two tables, its counts, and what was left out."""

    def run(*options, logs=(ONE,)):
        called = call("ingest", *logs, *options, "--json")
        assert (called.code, "Traceback" in called.err) == (0, False), called.err
        (log,) = called.json["logs"]
        folder = here / log["artefact"]
        return Ingested(
            pq.read_table(folder / "samples.parquet").to_pandas(),
            pq.read_table(folder / "quarantine.parquet").to_pandas(),
            log["counts"],
            log["left_out"],
        )

    return run


class Ingested:
    def __init__(self, samples, ledger, counts, left_out):
        self.samples, self.ledger, self.counts, self.left_out = samples, ledger, counts, left_out
        # Whatever is selected, every message and every row is used or stands in the ledger, with its reason.
        assert self.sum_of("message") == counts["messages"] - counts["messages_used"]
        assert self.sum_of("sample") == counts["grid_rows"] - counts["rows"]
        assert len(samples) == counts["rows"] > 0
        assert self.codes() == left_out

    def sum_of(self, level):
        return self.ledger.loc[self.ledger["level"] == level, "count"].sum()

    def codes(self):
        return self.ledger.groupby("code")["count"].sum().to_dict()

    def of(self, code):
        return self.ledger[self.ledger["code"] == code]


def times(frame):
    return frame["t"].astype("int64").to_numpy()


@pytest.fixture
def log(here):
    """What the log says of itself."""
    return read_info(here / ONE)


class TestTime:
    def test_a_span_from_the_logs_beginning(self, ingested, log):
        made = ingested("--start", "+5s", "--end", "+10s")
        first = log.first_log_time_ns
        # The samples are timed by the sender, and the selection by the recorder, some milliseconds later.
        assert first + 4.9 * S <= times(made.samples).min() < times(made.samples).max() < first + 10 * S
        left = made.of("not_selected_time")
        assert left["count"].sum() == made.counts["messages"] - 98
        assert set(left["detail"]) == {"before +5s", "not before +10s"}
        assert set(made.left_out) == {"not_selected_time"}

    def test_the_same_span_as_dates(self, ingested):
        begins = np.datetime64("2024-01-02T08:00:05")
        by_date = ingested("--start", f"{begins}Z", "--end", "2024-01-02T16:00:10+08:00")
        assert 5 * S <= times(by_date.samples).min() - begins.astype("datetime64[ns]").astype(int) + 5 * S < 5.2 * S
        assert 90 <= len(by_date.samples) <= 102

    def test_spans_that_adjoin_share_no_message_and_lose_none(self, ingested):
        parts = [ingested("--end", "+12s"), ingested("--start", "+12s")]
        selected = [part.counts["messages"] - part.left_out["not_selected_time"] for part in parts]
        assert sum(selected) == parts[0].counts["messages"]


class TestTopicAndPoint:
    @pytest.mark.parametrize("option", [("--topic", "/suspension/P1/*"), ("--exclude-topic", "*/P2/state")])
    def test_a_topic_alone(self, ingested, log, option):
        made = ingested(*option)
        assert set(made.samples["point"]) == {"P1"}
        left = made.of("not_selected_topic")
        assert set(left["topic"]) == {"/suspension/P2/state"}
        counted = {channel.topic: channel.message_count for channel in log.channels}
        assert left["count"].sum() == counted["/suspension/P2/state"]

    def test_a_point_alone(self, ingested, log):
        made = ingested("--point", "P2")
        assert set(made.samples["point"]) == {"P2"}
        assert set(made.of("not_selected_point")["topic"]) == {"/suspension/P1/state"}

    def test_options_may_be_given_more_than_once(self, ingested):
        assert set(ingested("--point", "P1", "--point", "P2").samples["point"]) == {"P1", "P2"}

    @pytest.mark.parametrize("option", [("--point", "P9"), ("--topic", "/none"), ("--start", "+1h")])
    def test_a_selection_of_nothing_is_refused_in_words(self, here, call, option):
        called = call("ingest", ONE, *option, "--json")
        assert (called.code, called.json["status"]) == (2, "refused")
        assert "Traceback" not in called.err
        assert Workspace(here / "workspace").list("samples") == []


class TestCondition:
    def test_rows_that_fulfil_it(self, ingested):
        whole = ingested(logs=(f"logs/{STEMS[0]}.mcap",))
        fast = ingested("--where", "speed_m_s > 5", logs=(f"logs/{STEMS[0]}.mcap",))
        assert fast.samples["speed_m_s"].min() > 5
        wanted = (whole.samples["speed_m_s"] > 5).sum()
        assert 0 < wanted < len(whole.samples)
        assert len(fast.samples) == wanted - fast.left_out.get("lone_sample", 0)
        left = fast.of("not_selected_condition")
        assert left["count"].sum() == len(whole.samples) - wanted
        assert set(left["detail"]) == {"speed_m_s > 5"}
        assert set(left["level"]) == {"sample"}
        assert fast.counts["messages_used"] == whole.counts["messages_used"]

    def test_rows_that_fulfil_all_of_several(self, ingested):
        made = ingested("--where", "speed_m_s > 2", "--where", "gap_m between 0.0075 and 0.0085")
        assert made.samples["speed_m_s"].min() > 2
        assert made.samples["gap_m"].between(0.0075, 0.0085).all()
        assert set(made.of("not_selected_condition")["detail"]) <= {"speed_m_s > 2", "gap_m between 0.0075 and 0.0085"}

    def test_a_segment_ends_where_a_row_was_left_out(self, ingested):
        made = ingested("--where", "not 0.00799 < gap_m < 0.00801")
        for _, rows in made.samples.groupby(["point", "segment"]):
            assert (np.diff(times(rows)) == S // 10).all()
            assert rows["step"].tolist() == list(range(len(rows)))

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("speed_m_s >", "is no condition"),
            ("speed_m_s", "speed_m_s"),
            ("__import__('os')", "__import__"),
            ("speed_km_h > 5", "there is no column speed_km_h; there are chainage_m, contact, current_a, gap_m"),
        ],
    )
    def test_a_wrong_one_ends_in_2_with_words(self, here, call, text, said):
        called = call("ingest", "logs", "--where", text)
        assert called.code == 2
        assert called.err.splitlines()[-1].startswith("error: ")
        assert said in called.err
        assert "Traceback" not in called.err
        assert Workspace(here / "workspace").list("samples") == []

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            (("--start", "yesterday"), "'yesterday' is no time"),
            (("--start", "2024-01-01T08:00:00"), "has no zone"),
            (("--start", "+10s", "--end", "+5s"), "must be after start"),
        ],
    )
    def test_so_does_a_wrong_time(self, here, call, options, said):
        called = call("ingest", "logs", *options)
        assert called.code == 2
        assert said in called.err
        assert not (here / "workspace").exists()


class TestDryRun:
    @pytest.mark.parametrize(
        "options", [(), ("--where", "gap_m < 0.0082"), ("--start", "+5s", "--point", "P1"), ("--merge",)]
    )
    def test_it_writes_nothing_at_all(self, here, call, options):
        before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
        called = call("ingest", "logs", "--dry-run", "--json", *options)
        assert called.code == 0
        assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before
        assert {log["status"] for log in called.json["logs"]} == {"not written"}
        assert {log["artefact"] for log in called.json["logs"]} == {None}
        assert called.json["transitions"] is None

    def test_it_says_what_would_come_of_it(self, here, call):
        options = ("logs", "--where", "gap_m < 0.0082", "--start", "+2s", "--json")
        would, did = call("ingest", "--dry-run", *options).json, call("ingest", *options).json
        assert [(log["counts"], log["left_out"]) for log in would["logs"]] == [
            (log["counts"], log["left_out"]) for log in did["logs"]
        ]

    def test_it_leaves_a_workspace_as_it_is(self, here, call):
        call("ingest", ONE)
        before = {path: path.stat().st_mtime_ns for path in (here / "workspace").rglob("*")}
        assert call("ingest", "logs", "--dry-run").code == 0
        assert {path: path.stat().st_mtime_ns for path in (here / "workspace").rglob("*")} == before

    def test_a_log_that_cannot_be_read_is_refused_and_the_others_are_told(self, here, call):
        (here / "bad.mcap").write_text("no MCAP")
        called = call("ingest", "logs", "bad.mcap", "--dry-run", "--json")
        assert called.code == 2
        assert sorted(log["status"] for log in called.json["logs"]) == ["not written"] * 3 + ["refused"]
        assert not (here / "workspace").exists()


class TestMerge:
    @pytest.fixture
    def parts(self, here, mcap_files):
        """Write messages number `first` to `last` of one drive to a file."""

        def write(name, first, last):
            values = [
                {
                    "gap_mm": 8 + np.sin(k / 9),
                    "coil_current_a": 17 + np.cos(k / 7),
                    "coil_voltage_v": 20 + np.sin(k / 5),
                }
                for k in range(first, last)
            ]
            messages = [
                mcap_files.Msg("/suspension/F1/state", T0 + k * S // 10, value)
                for k, value in zip(range(first, last), values, strict=True)
            ]
            return mcap_files.write(here / name, messages)

        return write

    def test_two_halves_become_the_whole(self, here, call, parts):
        parts("whole.mcap", 0, 200)
        # By name the second half comes first: the order is that of time.
        halves = [parts("b.mcap", 0, 100), parts("a.mcap", 100, 200)]
        (merged,) = call("ingest", *halves, "--merge", "--json").json["logs"]
        (whole,) = call("ingest", "whole.mcap", "--workspace", "other", "--json").json["logs"]
        assert merged["counts"] == whole["counts"]
        assert merged["counts"]["segments"] == 1
        tables = [
            pq.read_table(here / log["artefact"] / "samples.parquet")
            .to_pandas()
            .drop(columns="log_id", errors="ignore")
            for log in (merged, whole)
        ]
        assert tables[0].equals(tables[1])

    def test_the_order_in_which_they_are_named_does_not_matter(self, here, call, parts):
        halves = [parts("b.mcap", 0, 100), parts("a.mcap", 100, 200)]
        one = call("ingest", *halves, "--merge", "--json", "--workspace", "one").json["logs"]
        two = call("ingest", *halves[::-1], "--merge", "--json", "--workspace", "two").json["logs"]
        assert [log["log_id"] for log in one] == [log["log_id"] for log in two]
        manifests = [json.loads((here / log[0]["artefact"] / "manifest.json").read_text()) for log in (one, two)]
        assert manifests[0]["files"] == manifests[1]["files"]

    def test_it_does_nothing_a_second_time(self, here, call, parts):
        halves = [parts("a.mcap", 0, 100), parts("b.mcap", 100, 200)]
        assert [call("ingest", *halves, "--merge", "--json").json["logs"][0]["status"] for _ in range(2)] == [
            "ingested",
            "skipped",
        ]

    @pytest.mark.parametrize("dry", [(), ("--dry-run",)])
    def test_parts_that_overlap_are_refused_in_words(self, here, call, parts, dry):
        halves = [parts("a.mcap", 0, 120), parts("b.mcap", 100, 200)]
        called = call("ingest", *halves, "--merge", *dry)
        assert called.code == 2
        assert "b.mcap: it overlaps with" in called.err
        assert "a.mcap for 1.900 s on /suspension/F1/state, so they are not parts of one recording." in called.err
        assert "without --merge" in called.err
        assert "Traceback" not in called.err
        assert Workspace(here / "workspace").list("samples") == []

    def test_a_part_that_cannot_be_read_is_refused_with_all(self, here, call, parts):
        (here / "bad.mcap").write_text("no MCAP")
        called = call("ingest", parts("a.mcap", 0, 100), "bad.mcap", "--merge")
        assert called.code == 2
        assert "bad.mcap" in called.err
        assert "Traceback" not in called.err

    def test_without_it_they_are_two_logs(self, call, parts):
        logs = call("ingest", parts("a.mcap", 0, 100), parts("b.mcap", 100, 200), "--json").json["logs"]
        assert [log["counts"]["rows"] for log in logs] == [100, 100]


def test_a_selection_and_none_are_two_artefacts_of_one_name(here, call):
    shutil.rmtree(here / "workspace", ignore_errors=True)
    selected = call("ingest", ONE, "--point", "P1", "--json").json["logs"][0]
    whole = call("ingest", ONE, "--json").json["logs"][0]
    assert (selected["status"], whole["status"]) == ("ingested", "ingested")
    assert selected["artefact"] == whole["artefact"]
    assert whole["counts"]["points"] == 2
