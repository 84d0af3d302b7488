import numpy as np
import pytest

from maglev_offline.errors import InputError, MaglevOfflineError
from maglev_offline.ingest.ledger import RULE_VERSION, SCHEMA, Quarantined, check_sums, counts, rows, table, together
from maglev_offline.logs.columns import NO_TIME


def entries():
    return [
        Quarantined("message", "not_finite", np.array([30, NO_TIME]), np.array([3, 1]), "/a", "F1", "gap"),
        rows("F1", "/a", "contact", np.array([40])),
        together("/b", "unmapped_topic", 7),
        Quarantined("message", "out_of_range", np.empty(0, np.int64), np.empty(0, np.int64), "/a"),
    ]


def test_one_row_for_each_message_and_one_for_a_together():
    found = table("log-1", entries())
    assert found.schema == SCHEMA
    frame = found.to_pandas()
    assert frame["code"].tolist() == ["not_finite", "not_finite", "unmapped_topic", "contact"]
    assert frame["message_index"].tolist() == [1, 3, -1, -1]
    assert frame["count"].tolist() == [1, 1, 7, 1]
    assert frame["t"].isna().tolist() == [True, False, True, False]
    assert set(frame["rule_version"]) == {RULE_VERSION}


def test_an_empty_ledger_is_a_table_too():
    assert table("log-1", []).schema == SCHEMA


def test_counts_by_code():
    assert counts(entries()) == {"contact": 1, "not_finite": 2, "unmapped_topic": 7}
    assert counts(entries(), "sample") == {"contact": 1}


def test_damage_has_its_byte_in_the_file():
    frame = table("log-1", [together("/a", "chunk_crc_mismatch", 12, "why", byte_offset=4096)]).to_pandas()
    assert frame[["count", "byte_offset"]].to_numpy().tolist() == [[12, 4096]]
    assert table("log-1", entries()).to_pandas()["byte_offset"].tolist() == [-1] * 4


def test_a_ledger_that_does_not_add_up_is_a_fault_of_ours():
    aside = {"message": counts(entries(), "message"), "sample": counts(entries(), "sample")}
    check_sums("a.mcap", aside, messages={"in": 19, "used": 10}, rows={"in": 5, "used": 4})
    with pytest.raises(MaglevOfflineError, match="20 messages came in, 10 were used and 9 quarantined") as found:
        check_sums("a.mcap", aside, messages={"in": 20, "used": 10}, rows={"in": 5, "used": 4})
    assert not isinstance(found.value, InputError)
    with pytest.raises(MaglevOfflineError, match="5 samples came in"):
        check_sums("a.mcap", aside, messages={"in": 19, "used": 10}, rows={"in": 5, "used": 5})
