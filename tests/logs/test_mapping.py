"""Which topic gives which signal of which point, found by the recipe or by names and units."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from maglev_offline.errors import LogError
from maglev_offline.logs.channels import ChannelInfo
from maglev_offline.logs.mapping import resolve, si_factor, to_si
from maglev_offline.logs.signals import Signal, SignalMap

STATE = ("gap_mm", "coil_current_a", "coil_voltage_v")


def channel(topic, *fields, encoding="json", schema_encoding="jsonschema", messages=10):
    return ChannelInfo(1, topic, encoding, schema_encoding, "State", messages, 0, 1, fields, ())


def a_map(**changes):
    table = {
        "topic": "/suspension/(?P<point>[^/]+)/state",
        "gap": {"field": "gap_mm", "unit": "mm"},
        "current": {"field": "coil_current_a", "unit": "A"},
        "voltage": {"field": "coil_voltage_v", "unit": "V"},
    }
    return SignalMap.model_validate({**table, **changes})


class TestWithAMap:
    def test_each_topic_is_a_point(self):
        plan = resolve(a_map(), [channel(f"/suspension/{p}/state", *STATE) for p in ("F2", "F1")])
        assert not plan.detected
        assert list(plan.sources) == ["F1", "F2"]
        assert plan.topics["/suspension/F1/state"].points == ("F1",)
        assert plan.topics["/suspension/F1/state"].paths == STATE

    def test_signals_of_a_point_may_lie_on_different_topics(self):
        used = a_map(voltage={"field": "u", "unit": "V", "topic": "/driver/(?P<point>[^/]+)"})
        channels = [channel("/suspension/F1/state", "gap_mm", "coil_current_a"), channel("/driver/F1", "u")]
        plan = resolve(used, channels)
        assert plan.sources == {
            "F1": {"gap": "/suspension/F1/state", "current": "/suspension/F1/state", "voltage": "/driver/F1"}
        }
        assert list(plan.topics["/driver/F1"].signals) == ["voltage"]

    def test_a_topic_without_a_point_of_its_own_is_shared_by_all(self):
        used = a_map(context={"speed_m_s": {"field": "v", "unit": "km/h", "topic": "/vehicle"}})
        channels = [channel(f"/suspension/{p}/state", *STATE) for p in ("F1", "F2")]
        plan = resolve(used, [*channels, channel("/vehicle", "v")])
        assert plan.topics["/vehicle"].points == ("F1", "F2")

    def test_topics_without_any_point_make_one(self):
        used = a_map(
            topic="/nothing",
            gap={"field": "x", "unit": "mm", "topic": "/gap"},
            current={"field": "x", "unit": "A", "topic": "/current"},
            voltage={"field": "x", "unit": "V", "topic": "/voltage"},
        )
        plan = resolve(used, [channel(topic, "x") for topic in ("/gap", "/current", "/voltage")])
        assert list(plan.sources) == ["gap"]

    def test_a_point_that_lacks_a_signal_is_left_out_and_told(self):
        channels = [channel("/suspension/F1/state", *STATE), channel("/suspension/F2/state", *STATE[:2])]
        plan = resolve(a_map(), channels)
        assert list(plan.sources) == ["F1"]
        assert plan.incomplete == {
            "F2": "lacks voltage (topic /suspension/F2/state has no numeric field 'coil_voltage_v')"
        }

    def test_channels_without_messages_are_not_there(self):
        with pytest.raises(LogError, match="matches no topic"):
            resolve(a_map(), [channel("/suspension/F1/state", *STATE, messages=0)])

    def test_one_signal_on_two_topics_is_ambiguous(self):
        used = a_map(topic="/(?:left|right)/(?P<point>[^/]+)")
        with pytest.raises(LogError, match="point 'F1' is given by 2 topics: /left/F1, /right/F1"):
            resolve(used, [channel("/left/F1", *STATE), channel("/right/F1", *STATE)])

    def test_a_field_that_is_not_there(self):
        used = a_map(gap={"field": "gpa_mm", "unit": "mm"})
        with pytest.raises(LogError, match="has no numeric field 'gpa_mm'") as found:
            resolve(used, [channel("/suspension/F1/state", *STATE)])
        assert "gap_mm, coil_current_a, coil_voltage_v" in found.value.todo

    def test_an_encoding_that_cannot_be_decoded(self):
        closed = channel("/suspension/F1/state", encoding="cdr", schema_encoding="ros2idl")
        with pytest.raises(LogError, match="/suspension/F1/state have an encoding that cannot be decoded"):
            resolve(a_map(), [closed])

    def test_a_clock_field_that_is_not_there(self):
        used = a_map(clock="header", clock_field="header.stamp")
        with pytest.raises(LogError, match=r"clock field 'header.stamp' is not on topic /suspension/F1/state"):
            resolve(used, [channel("/suspension/F1/state", *STATE)])

    def test_a_star_stands_for_any_index(self):
        used = a_map(gap={"field": "magnets.2.gap", "unit": "mm"})
        assert resolve(used, [channel("/suspension/F1/state", "magnets.*.gap", *STATE[1:])]).sources


class TestWithoutAMap:
    def test_names_and_units_of_the_surrogate_logs(self):
        fields = ("gap_mm", "gap_velocity_mm_s", "coil_current_a", "coil_voltage_v", "set_point_mm",
                  "speed_km_h", "load_kg", "chainage_m", "temperature_degc")  # fmt: skip
        plan = resolve(None, [channel(f"/suspension/{p}/state", *fields) for p in ("F1", "F2")])
        used = plan.signal_map
        assert plan.detected
        assert list(plan.sources) == ["F1", "F2"]
        assert used.topic == "/suspension/(?P<point>[^/]+)/state"
        assert (used.gap.unit, used.velocity.unit, used.set_point.unit) == ("mm", "mm/s", "mm")
        assert {n: s.unit for n, s in used.context.items()} == {
            "speed_m_s": "km/h", "load_kg": "kg", "chainage_m": "m"}  # fmt: skip
        assert SignalMap.model_validate(used.model_dump(mode="json")) == used

    def test_other_units_and_nested_fields(self):
        plan = resolve(None, [channel("/rig/a", "s.gap_um", "s.gap_velocity_m_s", "s.current_ma", "s.voltage_v")])
        used = plan.signal_map
        assert (used.gap.field, used.gap.unit) == ("s.gap_um", "um")
        assert (used.current.unit, used.velocity.unit) == ("mA", "m/s")
        assert list(plan.sources) == ["rig_a"]

    def test_the_less_nested_of_two_fields_is_taken(self):
        plan = resolve(None, [channel("/rig", "raw.gap_mm", *STATE)])
        assert plan.signal_map.gap.field == "gap_mm"

    def test_two_fields_with_the_same_claim_are_not_chosen_between(self):
        with pytest.raises(LogError, match="have to be named"):
            resolve(None, [channel("/rig", "gap_mm", "gap_um", *STATE[1:])])

    def test_points_share_what_all_of_them_have(self):
        channels = [channel("/a", *STATE, "load_kg"), channel("/b", *STATE)]
        plan = resolve(None, channels)
        assert list(plan.sources) == ["a", "b"]
        assert plan.signal_map.context == {}

    def test_points_that_differ_in_units_are_refused(self):
        with pytest.raises(LogError, match="differently"):
            resolve(None, [channel("/a", *STATE), channel("/b", "gap_um", *STATE[1:])])

    def test_where_names_do_not_tell_a_table_is_offered(self):
        fields = ("t", "y", "y_obs", "dy_obs", "i", "u", "yd")
        with pytest.raises(LogError) as found:
            resolve(None, [channel("/levitator/state", *fields), channel("/rosout")], where="a.mcap")
        assert "a.mcap" in found.value.paragraph()
        assert "/levitator/state (json/jsonschema, 10 messages): t, y, y_obs" in found.value.todo
        table = tomllib.loads(found.value.todo[found.value.todo.index("[signals]") :])["signals"]
        offered = SignalMap.model_validate(table)
        assert (offered.gap.field, offered.current.field, offered.voltage.field) == ("y", "i", "u")
        assert offered.set_point.field == "yd"
        assert resolve(offered, [channel("/levitator/state", *fields)]).sources

    def test_the_offer_leaves_open_what_it_cannot_guess(self):
        with pytest.raises(LogError) as found:
            resolve(None, [channel(f"/car/{k}/magnet", "gap_mm", "temperature") for k in (1, 2)])
        todo = found.value.todo
        assert '# voltage = { field = "...", unit = "V" }  # not found: name it' in todo
        table = tomllib.loads(todo[todo.index("[signals]") :])["signals"]
        assert table["gap"] == {"field": "gap_mm", "unit": "mm"}
        assert re.fullmatch(table["topic"], "/car/2/magnet")["point"] == "2"

    def test_the_offer_takes_a_unit_that_only_one_signal_has_and_the_period_of_the_log(self):
        log = replace(channel("/magnet", "airgap_um", "coil_ma", "volts", messages=5), last_log_time_ns=80_000_000)
        with pytest.raises(LogError) as found:
            resolve(None, [log])
        table = tomllib.loads(found.value.todo[found.value.todo.index("[signals]") :])
        assert table["signals"]["current"] == {"field": "coil_ma", "unit": "mA"}
        assert table["ingest"]["grid_ms"] == 20
        assert 'unit = "V" }  # a guess, and the unit more so' in found.value.todo

    def test_a_log_without_numbers(self):
        with pytest.raises(LogError) as found:
            resolve(None, [channel("/rosout")])
        assert "no numeric fields" in found.value.todo
        assert "[signals]" not in found.value.todo


class TestUnits:
    def test_si_value_is_sign_times_offset_value_times_unit(self):
        signal = Signal(field="x", unit="mm", sign=-1, offset=2.0, valid=(-5.0, 0.0))
        values, outside = to_si("gap", signal, np.array([1.0, 4.0, np.nan]))
        np.testing.assert_allclose(values, [-0.003, -0.006, np.nan])
        assert outside.tolist() == [False, True, False]

    @pytest.mark.parametrize("millimetres", [0.5, 9.0, 16.0, 19.5])
    def test_a_millimetre_value_is_the_metre_value_that_a_recipe_writes(self, millimetres):
        values, _ = to_si("gap", Signal(field="x", unit="mm"), np.array([millimetres]))
        assert values[0] == float(f"{millimetres}e-3")

    @pytest.mark.parametrize(
        ("name", "unit", "factor"),
        [("speed_m_s", "km/h", 1 / 3.6), ("load_kg", "tonne", 1e3), ("chainage_m", "km", 1e3),
         ("supply_v", "mV", 1e-3), ("mode", "dimensionless", 1.0), ("force_n", "kN", 1e3)],
    )  # fmt: skip
    def test_a_context_column_ends_in_its_unit(self, name, unit, factor):
        assert si_factor(name, Signal(field="x", unit=unit)) == pytest.approx(factor)

    def test_a_context_column_without_a_unit_is_refused(self):
        used = a_map(context={"speed": {"field": "gap_mm", "unit": "km/h"}})
        with pytest.raises(LogError, match="context column 'speed' does not end in a unit"):
            resolve(used, [channel("/suspension/F1/state", *STATE)])


def test_a_signalling_nan_of_a_sensor_is_a_nan_without_a_warning():
    raw = np.array([0x7FF0000000000001, 0], dtype=np.uint64).view(np.float64)
    values, outside = to_si("gap", Signal(field="gap", unit="mm", valid=(0.0, 20.0)), raw)
    assert np.isnan(values[0])
    assert values[1] == 0
    assert not outside.any()
