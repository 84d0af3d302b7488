import json

import pytest

from maglev_offline.errors import LogError
from maglev_offline.ingest.inspect import inspect_log
from maglev_offline.ingest.request import Request


def test_a_log_at_a_glance(tmp_path, write_log, mcap_files):
    extra = [mcap_files.Msg("/rosout", 5, {"level": 1})]
    path = write_log(
        tmp_path / "a.mcap", [0, 10, 20, 60, 50], extra=extra, compression="lz4", metadata={"x": {"simulated": "true"}}
    )
    summary = inspect_log(path, Request()).summary
    assert summary.file == "a.mcap"
    assert summary.size_bytes == path.stat().st_size
    assert summary.simulated
    assert summary.compressions == ("lz4",)
    assert summary.messages == 6
    state, rosout = summary.channels
    assert (state.messages, state.period_ms, state.longest_silence_ms, state.steps_back) == (5, 10.0, 30.0, 1)
    assert state.fields == ("gap_mm", "coil_current_a", "coil_voltage_v")
    assert (rosout.messages, rosout.period_ms) == (1, None)
    assert summary.points == ("F1",)
    assert summary.signals["gap"] == {"field": "gap_mm", "unit": "mm"}
    assert summary.why_no_signals == ""
    assert json.loads(json.dumps(summary.as_dict()))["channels"][0]["topic"] == "/suspension/F1/state"


def test_a_log_whose_signals_cannot_be_found_is_shown_all_the_same(levitador):
    summary = inspect_log(levitador / "constant_ros2.mcap", Request()).summary
    assert summary.signals is None
    assert "[signals]" in summary.why_no_signals
    assert summary.channels[0].period_ms == 10.0


def test_a_damaged_log_is_refused(tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"no")
    with pytest.raises(LogError, match="not an MCAP file"):
        inspect_log(tmp_path / "a.mcap", Request())
