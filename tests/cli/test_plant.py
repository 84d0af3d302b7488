"""The commands on the plant: control with its options, identify, and a fitted plant in other commands."""

import pytest

from maglev_offline.identify.plants import load_plant
from maglev_offline.workspace import Manifest

QUICK = ("--recipe", "tiny.toml")


def test_control_prints_the_linear_model_the_range_of_kp_and_the_margins_and_plots_a_page(here, call):
    done = call("control", *QUICK)
    assert done.code == 0
    assert "[2450.0, 0.0, -1.1558], [0.0, 2119.6736, -3.1438]" in done.out
    assert "stable for Kp 2545 to 3517 (continuous)" in done.out
    assert "phase margin 2.47 degrees, delay margin 1.42 ms" in done.out
    page = (here / "workspace/control_page/control.html").read_text()
    assert "The plant and its classical controllers" in page
    assert page.count("<svg") >= 4


@pytest.mark.usefixtures("undrawn")
def test_the_options_of_control_reach_the_simulation(here, call):
    options = ("--integrator", "rk4", "--gap-max-mm", "18", "--constant-load-n", "500", "--mass-error", "0.05")
    assert call("control", *QUICK, *options).code == 0
    settings = Manifest.read(here / "workspace/control").settings
    assert settings["control"]["integrator"] == settings["mdp"]["integrator"] == "rk4"
    assert settings["plant"]["gap_max_m"] == 0.018
    assert settings["control"]["constant_load_n"] == 500
    assert settings["control"]["mass_error_share"] == 0.05


@pytest.mark.usefixtures("undrawn")
def test_a_voltage_that_does_not_suffice_is_told_with_its_number(here, call):
    done = call("control", *QUICK, "--voltage-limit-v", "30", "--gap-max-mm", "30")
    assert done.code == 0
    assert "do not bring the magnet back from 15 mm with a voltage limit of 30 V" in done.err


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--voltage-limit-v", "nan"), "voltage_limit_v"),
        (("--integrator", "heun"), "integrator"),
        (("--gap-max-mm", "5"), "set_point_m = 0.008 must lie between the stops"),
        (("--mass-error", "-1"), "mass_error_share"),
    ],
)
def test_a_number_that_cannot_be_is_named(here, call, options, named):
    done = call("control", *QUICK, *options)
    assert done.code == 2
    assert named in done.err
    assert not (here / "workspace/control").exists()


def test_rows_of_100_ms_are_told_to_be_too_coarse_to_identify_from(here, call):
    call("ingest", "logs", *QUICK)
    done = call("identify", "--json")
    assert done.code == 0
    assert "rad" in done.err
    verdicts = {name: found["verdict"] for name, found in done.json["facts"]["parameters"].items()}
    assert verdicts["gain_h_m_per_kg"] != "identified"
    assert load_plant(here / "workspace/identify/plant.toml").mass_kg == 700


def test_without_samples_there_is_nothing_to_identify_from(here, call):
    done = call("identify")
    assert done.code == 2
    assert "no samples" in done.err


@pytest.mark.usefixtures("undrawn")
def test_a_plant_file_takes_the_place_of_the_recipes_plant_and_is_remembered(here, call):
    (here / "plant.toml").write_text("[plant]\nmass_kg = 650\n")
    assert call("control", *QUICK, "--plant", "plant.toml").code == 0
    assert Manifest.read(here / "workspace/control").settings["plant"]["mass_kg"] == 650
    assert call("control", "--json").json["status"] == "unchanged"
    wrong = call("control", "--plant", "nowhere.toml")
    assert wrong.code == 2
    assert "no such plant file" in wrong.err
