"""A whole workspace, made by the real stages in a few seconds, and what reads a page."""

import shutil
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import pytest

from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.control.settings import ControlSettings
from maglev_offline.control.stage import run_control
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.curate.stage import curate
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.store import ingest_logs
from maglev_offline.logs.surrogate import generate
from maglev_offline.logs.surrogate_settings import SurrogateSettings
from maglev_offline.recipe import Recipe
from maglev_offline.report.settings import ReportSettings
from maglev_offline.report.stage import build_report
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.stage import run_transfer
from maglev_offline.workspace import Workspace

RECIPE = Recipe(
    name="tiny",
    surrogate=SurrogateSettings(logs=2, points=2, duration_s=60),
    curate=CurateSettings(target_rows=300),
    training=TrainingSettings(
        seeds=3, block=4, steps=400, exploratory_steps=100, batch_size=16, hidden=(8, 8), buffer_capacity=2000
    ),
    evaluation=EvaluationSettings(every_steps=50, start_gaps_m=(0.006, 0.015), selection_gaps_m=(0.010,)),
    transfer=TransferSettings(resamples=200),
    control=ControlSettings(
        duration_s=1.2,
        stored_fully_s=0.6,
        start_gaps_m=(0.006,),
        robustness_cells=3,
        robustness_duration_s=0.2,
    ),
)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The root of the finished workspace; tests copy it rather than change it."""
    home = tmp_path_factory.mktemp("report")
    workspace, recipe = Workspace(home / "workspace"), RECIPE
    logs = generate(home / "logs", plant=recipe.plant, mdp=recipe.mdp, settings=recipe.surrogate)
    ingest_logs(logs, workspace, Request(settings=recipe.ingest, plant=recipe.plant))
    curate(workspace, recipe.curate, recipe.plant, recipe.mdp)
    run_control(workspace, plant=recipe.plant, mdp=recipe.mdp, settings=recipe.control)
    run_transfer(workspace, recipe.world, recipe.transfer, recipe.sources)
    return workspace.root


@pytest.fixture(scope="session")
def reported(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    """A copy of the finished workspace with its report, all figures drawn, to look at only."""
    workspace = Workspace(Path(shutil.copytree(made, tmp_path_factory.mktemp("page") / "workspace")))
    _, fresh = build_report(workspace, ReportSettings(), RECIPE.plain(), RECIPE.name)
    assert fresh
    return workspace


@pytest.fixture
def workspace(made: Path, tmp_path: Path) -> Workspace:
    """A copy of the finished workspace."""
    return Workspace(Path(shutil.copytree(made, tmp_path / "workspace")))


@pytest.fixture(scope="session")
def recipe() -> Recipe:
    """The recipe of the finished workspace."""
    return RECIPE


VOID = {"meta", "link", "br", "hr", "img", "input"}


class _Page(HTMLParser):
    """Checks that elements nest, and collects ids, references, rows of tables and the text."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.found = SimpleNamespace(ids=[], references=[], tags=[], rows=[], text="", errors=[])

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.handle_startendtag(tag, attrs)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.tags.append((tag, dict(attrs)))
        for name, value in attrs:
            if name == "id":
                self.found.ids.append(value)
            if name in ("src", "href", "xlink:href", "action", "data", "poster", "srcset"):
                self.found.references.append(value)
        if tag == "tr":
            self.found.rows.append([])
        if tag in ("td", "th"):
            self.found.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.found.errors.append((tag, self.getpos()))

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.found.text += data
        if {"td", "th"} & set(self.open):
            self.found.rows[-1][-1] += data


@pytest.fixture(scope="session")
def read_page():
    """Parse a page into ids, references, tags, rows of tables, text and errors of nesting."""

    def read(path: Path) -> SimpleNamespace:
        parser = _Page()
        parser.feed(path.read_text(encoding="utf-8"))
        parser.close()
        parser.found.errors += [(tag, "never closed") for tag in parser.open]
        return parser.found

    return read
