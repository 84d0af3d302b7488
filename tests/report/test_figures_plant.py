"""The figures of the plant hold the data that they are given."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.control.margins import SAMPLINGS, root_locus, stable_kp_range
from maglev_offline.control.robustness import robustness_maps
from maglev_offline.control.settings import CONTROLLERS, ControlSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import suspension_force
from maglev_offline.physics.parameters import Plant
from maglev_offline.report import figures_plant
from maglev_offline.report.svg import inline_svg

PLANT, MDP = Plant(), Mdp()
SETTINGS = ControlSettings(robustness_cells=4, robustness_duration_s=0.3)


@pytest.fixture(scope="module")
def locus():
    found = root_locus(PLANT, SETTINGS.pid)
    poles = found.poles_rad_s
    return pd.DataFrame(
        {
            "kp": np.repeat(found.kp, poles.shape[1]),
            "pole": np.tile(np.arange(poles.shape[1]), len(poles)),
            "real_rad_s": poles.real.ravel(),
            "imag_rad_s": poles.imag.ravel(),
        }
    )


@pytest.fixture(scope="module")
def ranges():
    found = [stable_kp_range(PLANT, SETTINGS.pid, sampling, 1e-3) for sampling in SAMPLINGS]
    return [vars(one) for one in found]


@pytest.fixture(scope="module")
def robustness():
    maps = robustness_maps(PLANT, MDP, SETTINGS)
    return pd.concat(
        [
            pd.DataFrame({"controller": name, "map": kind, **cases._asdict()})
            for kind, found in (("mass", maps.by_mass), ("voltage_limit", maps.by_limit))
            for name, cases in found.items()
        ],
        ignore_index=True,
    )


@pytest.fixture
def responses():
    t = np.arange(0, 0.6, 0.1)
    rows = []
    for name in ("pid", "lqi", "other"):
        for kind, swing in (("linear", 40.0), ("nonlinear", 7.0)):
            for start in np.linspace(0.004, 0.015, 7):
                gap = 0.008 + (start - 0.008) * np.cos(20 * t) * (swing / 7 if name == "pid" else 1)
                rows.append(
                    pd.DataFrame({"controller": name, "plant_kind": kind, "start_gap_m": start, "t_s": t, "gap_m": gap})
                )
    return pd.concat(rows, ignore_index=True)


def drawn(ax, gid):
    return [line for line in ax.get_lines() if str(line.get_gid()) == gid]


def notes(ax):
    return [text.get_text() for text in ax.texts]


def labels_have_units(figure):
    for ax in figure.axes:
        for text in (ax.get_xlabel(), ax.get_ylabel()):
            assert not text or ", " in text, text
    return True


def test_force_is_the_plants():
    figure = figures_plant.force_figure(PLANT)
    above, over = figure.axes
    point = PLANT.equilibrium()
    for share in figures_plant.CURRENT_SHARES:
        (line,) = drawn(over, f"force-{share:g}")
        gap = line.get_xdata() / 1e3
        np.testing.assert_allclose(line.get_ydata(), suspension_force(PLANT, gap, share * point.current_a) / 1e3)
    for level in figures_plant.FORCE_LEVELS:
        (line,) = drawn(above, f"level-{level:g}")
        force = suspension_force(PLANT, line.get_xdata() / 1e3, line.get_ydata())
        np.testing.assert_allclose(force, level * 700 * 9.8)
    (dot,) = drawn(over, "equilibrium")
    assert dot.get_xdata()[0] == pytest.approx(8)
    assert dot.get_ydata()[0] == pytest.approx(6.86)
    assert "6.86 kN = m g" in notes(above)
    assert "equilibrium: 8 mm, 17.0 A" in notes(above)
    assert labels_have_units(figure)


def test_force_of_a_small_magnet_is_in_newton():
    lab = Plant(
        mass_kg=0.06,
        resistance_ohm=4.0,
        inductance_slope_h_m=2e-5,
        inductance_offset_h=0.02,
        pole_offset_m=0.004,
        set_point_m=0.01,
        gap_min_m=0.0,
        gap_max_m=0.02,
    )
    figure = figures_plant.force_figure(lab)
    assert "suspension force, N" in [ax.get_ylabel() for ax in figure.axes]
    assert "0.588 N = m g" in notes(figure.axes[0])
    for level in figures_plant.FORCE_LEVELS:
        for line in drawn(figure.axes[0], f"level-{level:g}"):
            np.testing.assert_allclose(
                suspension_force(lab, line.get_xdata() / 1e3, line.get_ydata()), level * 0.06 * 9.8
            )


def test_root_locus_has_every_pole_and_the_ranges(locus, ranges):
    figure = figures_plant.root_locus_figure(locus, ranges, 3100.0)
    plane, origin, largest = figure.axes[:3]
    for ax in (plane, origin):
        points = ax.collections[0]
        np.testing.assert_array_equal(points.get_offsets(), locus[["real_rad_s", "imag_rad_s"]])
        np.testing.assert_array_equal(points.get_array(), locus["kp"])
        assert len(drawn(ax, "recipe")[0].get_xdata()) == 4
        assert drawn(ax, "imaginary-axis")[0].get_xdata() == [0, 0]
    (line,) = drawn(largest, "largest")
    np.testing.assert_array_equal(line.get_ydata(), locus.groupby("kp")["real_rad_s"].max())
    for one in ranges[1:]:
        limits = [drawn(largest, f"{one['sampling']}-{place}")[0].get_xdata()[0] for place in (0, 1)]
        assert limits == [one["lowest"], one["highest"]]
    (shaded,) = [patch for patch in largest.patches if patch.get_gid() == "stable"]
    assert shaded.get_x() == ranges[0]["lowest"]
    assert shaded.get_x() + shaded.get_width() == pytest.approx(ranges[0]["highest"])
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == [
        "Kp = 3,100 V/m",
        "stable, continuous",
        "stable, forward Euler, 1 ms",
        "stable, zero-order hold, 1 ms",
    ]
    assert labels_have_units(figure)


def test_root_locus_without_a_stable_range_or_the_recipes_gain(locus):
    figure = figures_plant.root_locus_figure(locus, [], 1e6)
    assert not any(drawn(ax, "recipe") for ax in figure.axes)
    assert not [patch for patch in figure.axes[2].patches if patch.get_gid() == "stable"]


def test_classes_of_survival():
    table = pd.DataFrame({"survives": [True, True, True, False, False], "worst_error_m": [1e-4, 5e-4, 1e-3, 1e-4, 1]})
    np.testing.assert_array_equal(figures_plant.robustness_classes(table), [0, 0, 1, 2, 2])
    table["worst_error_m"] = np.nan
    np.testing.assert_array_equal(figures_plant.robustness_classes(table), [1, 1, 1, 2, 2])


def test_robustness_has_a_cell_for_each_case(robustness):
    figure = figures_plant.robustness_figure(robustness, PLANT, MDP.voltage_limit_v)
    assert len(figure.axes) == 2 * len(CONTROLLERS)
    classes = figures_plant.robustness_classes(robustness)
    for row, (kind, column, label) in enumerate(figures_plant.MAPS):
        assert figure.axes[row * len(CONTROLLERS)].get_ylabel() == label
        for place, name in enumerate(CONTROLLERS):
            ax = figure.axes[row * len(CONTROLLERS) + place]
            (mesh,) = ax.collections
            cells = np.asarray(mesh.get_array()).reshape(4, 4)
            cases = (robustness["map"] == kind) & (robustness["controller"] == name)
            varied, starts = (np.unique(robustness.loc[cases, key]) for key in (column, "start_gap_m"))
            for i, value in enumerate(varied):
                for j, start in enumerate(starts):
                    one = cases & (robustness[column] == value) & (robustness["start_gap_m"] == start)
                    assert cells[i, j] == classes[one.to_numpy()][0]
            assert drawn(ax, "set-point")[0].get_xdata()[0] == 8
            assert drawn(ax, "nominal")[0].get_ydata()[0] == (700, 200)[row]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[:3] == [label for label, _ in figures_plant.SURVIVAL_CLASSES]
    assert labels_have_units(figure)


def test_robustness_without_the_plant_has_no_marks(robustness):
    figure = figures_plant.robustness_figure(robustness[robustness["map"] == "mass"])
    assert not any(ax.get_lines() for ax in figure.axes)
    assert len(figure.legends[0].get_texts()) == 3


def test_step_responses_set_linear_beside_nonlinear(responses):
    figure = figures_plant.step_responses_figure(responses, 0.008, 0.35)
    axes = [ax for ax in figure.axes if ax.get_visible()]
    titles = [ax.get_title(loc="left") for ax in axes]
    assert titles[:4] == ["PID, linear", "PID, nonlinear", "LQI, linear", "LQI, nonlinear"]
    assert len(axes) == 6
    lines = [line for line in axes[1].get_lines() if str(line.get_gid()).startswith("start")]
    assert len(lines) == 5
    for line, start in ((lines[0], 0.004), (lines[-1], 0.015)):
        rows = responses.query("controller == 'pid' and plant_kind == 'nonlinear' and t_s <= 0.35")
        rows = rows[np.isclose(rows["start_gap_m"], start)]
        np.testing.assert_allclose(line.get_ydata(), 1e3 * rows["gap_m"])
        np.testing.assert_array_equal(line.get_xdata(), rows["t_s"])
    low, high = axes[0].get_ylim()
    kept = responses.query("plant_kind == 'nonlinear' and t_s <= 0.35")["gap_m"] * 1e3
    assert low < kept.min() < kept.max() < high < 20
    assert len(notes(axes[0])) == 2
    assert notes(axes[0])[0].startswith("↑ to 48.0 mm")
    assert notes(axes[1]) == []
    assert all(ax.get_xlabel() == "time, s" for ax in axes[2:])
    assert labels_have_units(figure)


def test_step_responses_of_one_kind(responses):
    linear = responses[responses["plant_kind"] == "linear"]
    figure = figures_plant.step_responses_figure(linear)
    assert len([ax for ax in figure.axes if ax.get_visible()]) == 3


@pytest.mark.nightly
def test_drawings_are_the_same_each_time(locus, ranges, robustness, responses):
    def draw():
        return [
            inline_svg(figure, "key")
            for figure in (
                figures_plant.force_figure(PLANT),
                figures_plant.root_locus_figure(locus, ranges, 3100.0),
                figures_plant.robustness_figure(robustness, PLANT, 200.0),
                figures_plant.step_responses_figure(responses, 0.008),
            )
        ]

    first = draw()
    assert first == draw()
    assert all("http" not in text for text in first)
    assert sum(map(len, first)) < 400_000
