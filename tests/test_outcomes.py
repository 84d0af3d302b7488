from maglev_offline.ingest.log_outcome import LogOutcome
from maglev_offline.outcomes import LOG_COLUMNS, Done, Ingested


def outcome(tmp_path, status):
    return LogOutcome(tmp_path / f"{status}.mcap", f"{status}-id", status, {"rows": 1200}, {}, "message", None)


def test_a_stage_says_whether_it_did_anything(tmp_path):
    done, unchanged = (Done("curate", tmp_path, fresh, "9 transitions", {"rows": 9}) for fresh in (True, False))
    assert done.plain() == {"stage": "curate", "status": "done", "artefact": str(tmp_path), "rows": 9}
    assert unchanged.plain()["status"] == "unchanged"
    assert done.lines() == ["curate: 9 transitions", f"  -> {tmp_path}"]
    assert "nothing was done" in unchanged.lines()[0]


def test_notes_of_a_stage_stand_below_its_sentence(tmp_path):
    done = Done("curate", tmp_path, True, "9 transitions", notes=["one", "two"])
    assert done.lines() == ["curate: 9 transitions", "  one", "  two", f"  -> {tmp_path}"]


def test_ingestion_is_refused_where_one_log_is(tmp_path):
    good, bad = outcome(tmp_path, "ingested"), outcome(tmp_path, "refused")
    assert Ingested([good], None).plain()["status"] == "done"
    mixed = Ingested([good, bad], None)
    assert mixed.refused == [bad]
    assert mixed.plain()["status"] == "refused"
    assert mixed.rows()[0] == ["ingested.mcap", "ingested", "-", "-", "-", "1,200", "-"]
    assert all(len(row) == len(LOG_COLUMNS) for row in mixed.rows())
