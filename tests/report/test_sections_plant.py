"""The section on the plant: the manifest's numbers, each missing piece left out with a sentence, one quiet page."""

import re
from dataclasses import asdict
from html import unescape

import numpy as np
import pandas as pd
import pytest

from maglev_offline.control.margins import SAMPLINGS, margins_of_all, root_locus, stable_kp_range
from maglev_offline.control.reference import classical_controllers, period_s
from maglev_offline.control.robustness import robustness_maps
from maglev_offline.control.settings import CONTROLLERS, ControlSettings
from maglev_offline.control.simulate import regulate
from maglev_offline.control.stage import linear_facts
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.report import figures_plant
from maglev_offline.report.evidence import Evidence, gather
from maglev_offline.report.numbers import number, percent, whole
from maglev_offline.report.page import Paragraph, Plot, Section, Table
from maglev_offline.report.sections_plant import is_papers, plant_section
from maglev_offline.report.stage import render
from maglev_offline.workspace import Manifest, Workspace

PLANT, MDP = Plant(), Mdp()
SETTINGS = ControlSettings(robustness_cells=4, robustness_duration_s=0.3)
FIGURES = ["force", "root-locus", "steps", "robustness"]


def responses_table():
    starts = np.array([0.006, 0.015])
    rows = []
    for kind, limit in (("nonlinear", MDP.voltage_limit_v), ("linear", None)):
        for name, controller in classical_controllers(PLANT, MDP, SETTINGS, limit).items():
            found = regulate(
                PLANT,
                MDP,
                controller,
                starts,
                0.3,
                plant_kind=kind,
                control_period_s=period_s(name, MDP),
                limited=limit is not None,
            )
            head = {"controller": name, "plant_kind": kind, "t_s": found.time_s[:-1]}
            rows += [
                pd.DataFrame({**head, "start_gap_m": start, "gap_m": found.gap_m[: len(head["t_s"]), i]})
                for i, start in enumerate(starts)
            ]
    return pd.concat(rows, ignore_index=True)


def locus_table():
    found = root_locus(PLANT, SETTINGS.pid, np.linspace(0, 5000, 51))
    count, poles = found.poles_rad_s.shape
    return pd.DataFrame(
        {
            "kp": np.repeat(found.kp, poles),
            "pole": np.tile(np.arange(poles), count),
            "real_rad_s": found.poles_rad_s.real.ravel(),
            "imag_rad_s": found.poles_rad_s.imag.ravel(),
        }
    )


def robustness_table():
    maps = robustness_maps(PLANT, MDP, SETTINGS)
    return pd.concat(
        [
            pd.DataFrame({"controller": name, "map": kind, **cases._asdict()})
            for kind, found in (("mass", maps.by_mass), ("voltage_limit", maps.by_limit))
            for name, cases in found.items()
        ],
        ignore_index=True,
    )


CLAIMS = pd.DataFrame(
    [
        ("II-B", "matrix C <b>", "[1, 0, 0]", "[1, 0, 0]", "reproduced", "linear"),
        ("VI-A", "PID settles", "5 s", "never", "not reproduced", "nonlinear"),
        ("VI-A", "PID overshoots", "25 %", "114 %", "not reproduced", "nonlinear"),
        ("III", "discount gamma", "not given", "0.99", "not testable", "nonlinear"),
    ],
    columns=["section", "statement", "paper", "measured", "verdict", "setting"],
)


def without_infinity(values):
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()}


@pytest.fixture(scope="module")
def tables():
    return {
        "responses": responses_table(),
        "root_locus": locus_table(),
        "robustness": robustness_table(),
        "claims": CLAIMS,
    }


@pytest.fixture(scope="module")
def facts():
    ranges = [stable_kp_range(PLANT, SETTINGS.pid, sampling, MDP.plant_step_s) for sampling in SAMPLINGS]
    margins = margins_of_all(PLANT, MDP, SETTINGS)
    return {
        **linear_facts(PLANT, MDP, SETTINGS),
        "kp_ranges": [asdict(one) for one in ranges],
        "margins": {name: without_infinity(asdict(one)) for name, one in margins.items()},
    }


@pytest.fixture
def make(tmp_path, tables, facts):
    """The section of an artefact that lacks some tables and facts, or whose facts or settings are others."""

    def build(missing=(), settings=None, **changed):
        workspace = Workspace(tmp_path / "workspace")
        manifest = Manifest("control", "mark", {})
        given = {"control": SETTINGS, "plant": PLANT, "mdp": MDP, **(settings or {})}
        manifest.settings = {k: v.model_dump(mode="json") for k, v in given.items() if k not in missing}
        manifest.facts = {k: v for k, v in {**facts, **changed}.items() if k not in missing}
        with workspace.commit(workspace.path("control"), manifest) as draft:
            for name, table in tables.items():
                if name not in missing:
                    table.to_parquet(draft / f"{name}.parquet")
        return plant_section(gather(workspace))

    return build


def plots(section):
    return [block.key for block in section.blocks if isinstance(block, Plot)]


def tables_of(section):
    return [block for block in section.blocks if isinstance(block, Table)]


def words(section):
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))


def test_section_has_all_its_parts(make):
    section = make()
    assert (section.key, section.title) == ("plant", "The plant and its classical controllers")
    assert plots(section) == FIGURES
    assert len(tables_of(section)) == 4
    assert not [block for block in section.blocks if isinstance(block, Paragraph) and block.kind == "note"]


def test_linear_model_stands_beside_the_papers(make, facts):
    table = tables_of(make())[0]
    assert table.head[-1] == "printed in the paper"
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["A, row 2"] == ["[2450, 0, −1.1558]"] * 2
    assert rows["A, row 3"] == ["[0, 2119.7, −3.1438]"] * 2
    assert rows["B, transposed"] == ["[0, 0, 2.6198]"] * 2
    assert rows["C"] == ["[1, 0, 0]"] * 2
    real, imag = (max(part) for part in zip(*facts["poles_rad_s"], strict=True))
    assert rows["poles, rad/s"][0].startswith(number(real, 4))
    assert f"± {number(imag, 4)}j" in rows["poles, rad/s"][0]


def test_equilibrium_is_the_manifests(make, facts):
    text = words(make())
    assert "a gap of 8 mm with 17.0 A and 20.3 V" in text
    assert f"κ = {whole(facts['kappa_a2_per_m2'])}" in text
    assert "unstable: a pole lies at 18.8 rad/s" in text


def test_another_plant_is_not_held_against_the_paper(make):
    other = Plant(mass_kg=500)
    assert is_papers(Plant(coil_turns=450, pole_area_m2=0.024, gap_max_m=0.018))
    assert not is_papers(other)
    assert tables_of(make(settings={"plant": other}))[0].head == ["", "here"]


def test_ranges_and_margins_are_the_manifests(make, facts):
    section = make()
    text = words(section)
    for one in facts["kp_ranges"]:
        assert f"from {whole(one['lowest'])} to {whole(one['highest'])} V/m" in text
    pid = facts["margins"]["pid"]
    assert f"{number(1e3 * pid['delay_margin_s'])} ms of delay" in text
    rows = {row[0]: row[1:] for row in tables_of(section)[1].rows}
    assert list(rows) == ["PID", "cascade", "LQR", "LQR, held", "LQI"]
    assert rows["PID"] == [
        *(number(pid[key]) for key in ("gain_margin_down", "gain_margin_up", "phase_margin_deg", "crossover_rad_s")),
        number(1e3 * pid["delay_margin_s"]),
        "stable",
    ]
    assert rows["LQI"][1] == "any"


def test_unstable_loops_say_so(make, facts):
    nothing = dict.fromkeys(facts["margins"]["pid"]) | {"stable": False}
    section = make(kp_ranges=[], margins={"pid": nothing, "lqi": facts["margins"]["lqi"]})
    assert "nowhere in continuous time, nowhere under forward Euler" in words(section)
    assert "where the loop is unstable as given" in words(section)
    assert tables_of(section)[1].rows[0] == ["PID", *["–"] * 5, "unstable as given"]
    assert "root-locus" in plots(section)


def test_survival_table_has_the_shares(make, tables):
    table = tables["robustness"].assign(verdict=figures_plant.robustness_classes(tables["robustness"]))
    rows = tables_of(make())[2].rows
    assert len(rows) == len(CONTROLLERS)
    for row, name in zip(rows, CONTROLLERS, strict=True):
        shares = []
        for kind in ("mass", "voltage_limit"):
            verdict = table.loc[(table["controller"] == name) & (table["map"] == kind), "verdict"]
            shares += [percent((verdict < 2).mean()), percent((verdict == 0).mean())]
        assert row[1:] == shares


def test_claims_are_counted_in_words(make):
    section = make()
    assert "4 statements of the paper were tested in 4 settings" in words(section)
    assert "1 reproduced, 2 not reproduced and 1 not testable" in words(section)
    table = tables_of(section)[3]
    assert [row[-1] for row in table.rows] == CLAIMS["verdict"].tolist()
    assert table.marks == ["positive", "negative", "negative", ""]


@pytest.mark.parametrize(
    ("missing", "figures", "sentence"),
    [
        ("root_locus", ["force", "steps", "robustness"], "no root locus"),
        ("kp_ranges", ["force", "steps", "robustness"], "no root locus"),
        ("margins", FIGURES, "no margins"),
        ("responses", ["force", "root-locus", "robustness"], "no responses"),
        ("robustness", ["force", "root-locus", "steps"], "no map of robustness"),
        ("a", FIGURES[1:], "no linear model"),
        ("plant", FIGURES[1:], "no plant"),
        ("mdp", FIGURES, ""),
        ("claims", FIGURES, "with `claims = true` in the recipe’s table [control]"),
    ],
)
def test_older_artefacts_leave_parts_out_with_a_sentence(make, missing, figures, sentence):
    section = make(missing=(missing,))
    assert plots(section) == figures
    notes = [block for block in section.blocks if isinstance(block, Paragraph) and block.kind == "note"]
    assert len(notes) == bool(sentence)
    assert sentence in words(section)
    assert all(note.command == "control" for note in notes)


def test_without_controllers_there_is_one_sentence(tmp_path):
    section = plant_section(gather(Workspace(tmp_path)))
    assert [block.command for block in section.blocks] == ["control"]


def test_disturbances_are_named(make):
    loaded = SETTINGS.model_copy(update={"constant_load_n": 500.0, "mass_error_share": 0.1})
    captions = {
        block.key: block.caption for block in make(settings={"control": loaded}).blocks if hasattr(block, "key")
    }
    assert "With a constant load of 500 N and a mass off by 10" in captions["steps"]


def test_page_is_self_contained_and_the_same_each_time(make, tmp_path, read_page):
    pages = [render("Title", Section("head", ""), [make()], Evidence({})) for _ in range(2)]
    assert pages[0] == pages[1]
    path = tmp_path / "page.html"
    path.write_text(pages[0], encoding="utf-8")
    page = read_page(path)
    assert page.errors == []
    assert len(page.ids) == len(set(page.ids))
    assert all(reference.startswith(("#", "data:image/png;base64,")) for reference in page.references)
    assert "http" not in pages[0].replace("http-equiv", "")
    assert "script-src 'none'" in unescape(pages[0])
    assert "matrix C &lt;b&gt;" in pages[0]
    drawings = re.findall(r"<svg .*?</svg>", pages[0], flags=re.S)
    assert len(drawings) == len(FIGURES)
    assert sum(map(len, drawings)) < 400_000
