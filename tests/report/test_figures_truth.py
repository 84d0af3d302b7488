"""The maps hold the cells and windows of the artefact, and say where there are too few."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.cells import CELLS
from maglev_offline.curate.diagnostic_cells import TOO_FEW
from maglev_offline.curate.residual_facts import sizes
from maglev_offline.report import figures_truth
from maglev_offline.report.evidence import Evidence, gather
from maglev_offline.report.sections_truth import names_of, residual_words, truth_section
from maglev_offline.report.svg import inline_svg
from maglev_offline.workspace import Workspace


@pytest.fixture(scope="module")
def evidence(made):
    return gather(Workspace(made))


@pytest.fixture(scope="module")
def section(evidence):
    return truth_section(evidence)


@pytest.fixture(scope="module")
def figures(section):
    return {block.key: block.figure() for block in section.blocks if hasattr(block, "figure")}


def cells_of(ax):
    return [patch for patch in ax.patches if patch.get_width() == 1]


def test_each_cell_is_drawn_with_its_rows_or_hatched(evidence, figures):
    cells = evidence.transitions("diagnostic_cells")
    drawn = cells_of(figures["truth"].axes[0])
    assert len(drawn) == CELLS**2
    assert sum(bool(patch.get_hatch()) for patch in drawn) == (cells["verdict"] == TOO_FEW).sum()
    written = {text.get_text() for text in figures["truth"].axes[0].texts}
    assert written == {f"{rows:,}" for rows in cells.loc[cells["verdict"] != TOO_FEW, "rows"]}


def test_colours_change_at_the_thresholds_of_the_verdict():
    cells = pd.DataFrame(
        {
            "gap_cell": [0, 1, 2, 3],
            "velocity_cell": 0,
            "gap_to_m": [0.001, 0.002, 0.003, np.inf],
            "velocity_to_m_s": np.inf,
            "rows": 100,
            "verdict": ["fit", "doubtful", "harmful", TOO_FEW],
            "error_over_advantage_std": [0.74, 0.76, 3.1, np.nan],
        }
    )
    rows = pd.DataFrame({"advantage": [0.0, 1.0, 2.0], "taught_advantage": [0.0, -1.0, 2.0], "weight": 1.0})
    ax = figures_truth.truth_figure(cells, rows).axes[0]
    red, _, blue, _ = np.transpose([patch.get_facecolor() for patch in cells_of(ax)])
    assert blue[0] > red[0]
    assert red[2] > blue[2] + 0.3
    assert abs(red[1] - blue[1]) < 0.2
    assert [label.get_text() for label in ax.get_xticklabels()] == ["1.0", "2.0", "3.0"]


def test_every_row_that_was_judged_is_counted_on_equal_axes(evidence, figures):
    ax = figures["truth"].axes[1]
    (mesh,) = (part for part in ax.collections if part.get_gid() == "advantages")
    assert mesh.get_array().sum() == len(evidence.transitions("diagnostic_rows"))
    assert ax.get_xlim() == ax.get_ylim()


def test_bars_are_the_residuals_of_the_logs_under_the_names_of_their_files(evidence, figures):
    residuals = evidence.transitions("residuals").query("steps == 1 and kind == 'log'")
    ax = figures["residual"].axes[1]
    size = sizes(residuals)
    np.testing.assert_allclose([bar.get_width() for bar in ax.patches], [*size["rms"], *size["mean"]])
    names = names_of(evidence.under("samples"))
    assert [text.get_text() for text in ax.texts] == [names[log] for log in residuals["log_id"]]
    assert all(name.endswith(".mcap") for name in names.values())


def test_figures_are_light(figures):
    assert list(figures) == ["truth", "residual"]
    for key, figure in figures.items():
        assert len(inline_svg(figure, key).encode()) < 100_000


def test_the_words_name_the_share_explained_the_growth_and_the_offset(evidence):
    found = evidence.get("transitions").facts["residual"]
    worst = {**found["worst_logs"][0], "offset": True} if found["worst_logs"] else None
    texts = " ".join(residual_words({**found, "worst_logs": [worst]}, {worst["log_id"]: "one.mcap"}))
    assert "100 ms later" in texts
    assert "grows 6.5-fold" in texts
    assert "one.mcap" in texts


def test_without_judged_rows_the_section_says_what_to_run():
    (block,) = truth_section(Evidence({})).blocks
    assert block.command == "curate"
