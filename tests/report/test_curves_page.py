"""The curves in a browser: they draw without an error or a request, and a hand or keys can question them."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest

from maglev_offline.report.settings import ReportSettings
from maglev_offline.report.stage import PAGE, build_report
from maglev_offline.workspace import Workspace

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no chromium here to open the page in")

TOOLS = """
const live = document.querySelector(".live");
const panel = live.querySelector(".panel");
const lines = () => [...live.querySelectorAll("[data-arm]")].map((line) => line.dataset.arm);
const ends = () => [Number(live.dataset.from), Number(live.dataset.to)];
const press = (key) => panel.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
const point = (kind, share) => {
  const seen = panel.querySelector("svg").getBoundingClientRect();
  panel.querySelector("svg").dispatchEvent(new PointerEvent(kind,
    { clientX: seen.left + share * seen.width, clientY: seen.top + 0.5 * seen.height, bubbles: true }));
};
const box = (text) =>
  [...live.querySelectorAll("label")].find((one) => one.textContent.includes(text)).querySelector("input");
const button = (text) => [...live.querySelectorAll("button")].find((one) => one.textContent === text);
const said = {};
"""


@pytest.fixture(scope="module")
def page(made, recipe, tmp_path_factory):
    workspace = Workspace(Path(shutil.copytree(made, tmp_path_factory.mktemp("live") / "workspace")))
    build_report(workspace, ReportSettings(), recipe.plain(), recipe.name)
    return workspace.path("report", PAGE)


@pytest.fixture
def asked(page, tmp_path):
    """Open the page, do what the script says, and return what it wrote into `said`, and the browser's own log."""

    def run(script: str, width: int = 1100) -> tuple[dict[str, object], str]:
        text = page.read_text(encoding="utf-8")
        if script:  # for the hand of the test, which the page's policy does not let in
            text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
            told = 'document.body.append(Object.assign(document.createElement("output"), '
            told += '{ id: "said", textContent: JSON.stringify(said) }));'
            text = text.replace("</body>", f"<script>{TOOLS}{script};{told}</script></body>")
        copy = tmp_path / "page.html"
        copy.write_text(text, encoding="utf-8")
        command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/profile"]
        command += ["--enable-logging=stderr", f"--window-size={width},900", "--dump-dom", copy.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        if not script:
            return {"dom": done.stdout}, done.stderr
        found = re.search(r'<output id="said">(.*?)</output>', done.stdout, re.S)
        assert found is not None, done.stderr
        return json.loads(unescape(found[1])), done.stderr

    return run


def test_the_page_as_it_is_draws_its_curves_without_an_error(asked):
    found, log = asked("")
    assert found["dom"].count('class="panel"') == 2
    assert found["dom"].count('data-arm="prefill"') == 2
    assert "CONSOLE" not in log


def test_nothing_is_asked_for_outside_the_page(asked):
    found, _ = asked('said.asked = performance.getEntriesByType("resource").map((one) => one.name)')
    assert found["asked"] == []


def test_boxes_choose_the_arms(asked):
    found, _ = asked(
        'said.all = lines(); box("prefilled").click(); said.one = lines(); button("none").click(); said.none = lines();'
        'button("all").click(); said.back = lines()'
    )
    assert found["all"] == found["back"] == ["empty", "prefill"] * 2
    assert found["one"] == ["empty"] * 2
    assert found["none"] == []


def test_keys_read_the_curves_aloud_and_zoom(asked):
    found, _ = asked(
        'press("Home"); said.first = panel.getAttribute("aria-valuetext"); press("ArrowRight");'
        'said.second = panel.getAttribute("aria-valuenow"); press("+"); said.closer = ends();'
        'press("Escape"); said.all = ends();'
        "said.role = panel.getAttribute('role')"
    )
    assert found["role"] == "slider"
    assert re.match(r"0 steps: empty buffer [\d.]+ \([\d.]+ to [\d.]+\); prefilled buffer", found["first"])
    assert found["second"] == "1"
    assert found["closer"][1] - found["closer"][0] < 400
    assert found["all"] == [0, 400]


def test_a_drag_zooms_and_two_clicks_show_all(asked):
    found, _ = asked(
        'point("pointermove", 0.5); said.at = Number(live.dataset.at); point("pointerdown", 0.4);'
        'point("pointermove", 0.6); point("pointerup", 0.8); said.near = ends();'
        'panel.querySelector("svg").dispatchEvent(new MouseEvent("dblclick"));'
        "said.all = ends()"
    )
    assert 100 <= found["at"] <= 250
    low, high = found["near"]
    assert 100 < low < 200
    assert 270 < high < 360
    assert found["all"] == [0, 400]


def test_every_run_is_drawn_when_asked_and_the_nearest_is_named_with_its_artefact(asked, page):
    found, _ = asked(
        'const count = () => live.querySelectorAll(".panel path").length; said.before = count();'
        'box("every run").click();'
        'said.after = count(); point("pointermove", 0.5); said.run = live.querySelector(".nearby").textContent'
    )
    assert (found["before"], found["after"]) == (2 * 2 * 2, 2 * 2 * (3 + 1))
    named = re.fullmatch(
        r"Nearest run: DDPG, .* buffer, seed \d, cost [\d.,]+ \((training/ddpg-\S+), ([0-9a-f]{16})\)", found["run"]
    )
    assert named is not None
    manifest = page.parents[1] / named[1] / "manifest.json"
    assert manifest.exists()


@pytest.mark.parametrize("width", [400, 1100])
def test_nothing_runs_over_the_edge_of_a_screen(asked, width):
    # A headless window has a least width of its own.
    found, _ = asked(
        f"const page = document.documentElement; page.style.width = '{width}px';"
        "const edge = page.getBoundingClientRect().right;"
        "said.over = [...live.querySelectorAll('*')].filter((one) => one.getBoundingClientRect().right > edge + 1)"
        ".map((one) => one.outerHTML.slice(0, 80))",
        width,
    )
    assert found["over"] == []
