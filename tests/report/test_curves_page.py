"""The curves in a browser: they draw without an error or a request, and a hand or keys can question them."""

import json
import re
import shutil
import subprocess
from html import unescape

import pytest

from maglev_offline.report.stage import PAGE

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no chromium here to open the page in")

HAND = """
const live = document.querySelector(".live");
const panel = live.querySelector(".panel");
const drawing = panel.querySelector("svg");
drawing.setPointerCapture = () => {}; // made-up events have no pointer to capture
const lines = () => [...live.querySelectorAll("[data-arm]")].map((line) => line.dataset.arm);
const paths = () => live.querySelectorAll(".panel path").length;
const ends = () => [Number(live.dataset.from), Number(live.dataset.to)];
const press = (key) => panel.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
const point = (kind, share) => {
  const seen = drawing.getBoundingClientRect();
  drawing.dispatchEvent(new PointerEvent(kind,
    { clientX: seen.left + share * seen.width, clientY: seen.top + 0.5 * seen.height, bubbles: true }));
};
const box = (text) =>
  [...live.querySelectorAll("label")].find((one) => one.textContent.includes(text)).querySelector("input");
const button = (text) => [...live.querySelectorAll("button")].find((one) => one.textContent === text);
const said = { role: panel.getAttribute("role"), all_arms: lines() };

box("prefilled").click(); said.one_arm = lines();
button("none").click(); said.no_arm = lines();
button("all").click(); said.arms_again = lines();

press("Home"); said.first = panel.getAttribute("aria-valuetext");
press("ArrowRight"); said.second = panel.getAttribute("aria-valuenow");
press("+"); said.closer = ends();
press("-"); said.out_again = ends();
press("Escape"); said.whole = ends();

point("pointermove", 0.5); said.at = Number(live.dataset.at);
point("pointerdown", 0.4); point("pointermove", 0.6); point("pointerup", 0.8); said.dragged = ends();
drawing.dispatchEvent(new MouseEvent("dblclick")); said.whole_again = ends();

said.bands = paths();
box("every run").click(); said.runs = paths();
point("pointermove", 0.5); said.nearest = live.querySelector(".nearby").textContent;

const page = document.documentElement;
said.over = [400, 1100].flatMap((width) => {
  page.style.width = `${width}px`; // a headless window has a least width of its own
  const edge = page.getBoundingClientRect().right + 1;
  const over = [...live.querySelectorAll("*")].filter((one) => one.getBoundingClientRect().right > edge);
  return over.map((one) => one.outerHTML);
});
said.asked = performance.getEntriesByType("resource").map((one) => one.name);
const told = { id: "said", textContent: JSON.stringify(said) };
document.body.append(Object.assign(document.createElement("output"), told));
"""


def opened(text, home):
    """What the browser makes of a page, and its own log."""
    copy = home / "page.html"
    copy.write_text(text, encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={home}/profile"]
    command += ["--enable-logging=stderr", "--window-size=1100,900", "--dump-dom", copy.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return done.stdout, done.stderr


@pytest.fixture(scope="module")
def text(reported):
    return reported.path("report", PAGE).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def said(text, tmp_path_factory):
    """What the curves said while a hand went over them."""
    # The hand of the test is no script that the page's policy lets in.
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    dom, log = opened(free.replace("</body>", f"<script>{HAND}</script></body>"), tmp_path_factory.mktemp("hand"))
    found = re.search(r'<output id="said">(.*?)</output>', dom, re.S)
    assert found is not None, log
    return json.loads(unescape(found[1]))


def test_the_page_as_it_is_draws_its_curves_without_an_error(text, tmp_path):
    dom, log = opened(text, tmp_path)
    assert dom.count('class="panel"') == 2
    assert dom.count('data-arm="prefill"') == 2
    assert "CONSOLE" not in log


def test_nothing_is_asked_for_outside_the_page(said):
    assert said["asked"] == []


def test_boxes_choose_the_arms(said):
    assert said["all_arms"] == said["arms_again"] == ["empty", "prefill"] * 2
    assert said["one_arm"] == ["empty"] * 2
    assert said["no_arm"] == []


def test_keys_read_the_curves_aloud_and_zoom(said):
    assert said["role"] == "slider"
    assert re.match(r"0 steps: empty buffer [\d.]+; prefilled buffer [\d.]+$", said["first"])  # 3 seeds, no interval
    assert said["second"] == "1"
    low, high = said["closer"]
    assert 0 < high - low < 400
    assert said["out_again"] == said["whole"] == [0, 400]


def test_a_drag_zooms_and_two_clicks_show_all(said):
    assert 100 <= said["at"] <= 250
    low, high = said["dragged"]
    assert 100 < low < 200
    assert 270 < high < 360
    assert said["whole_again"] == [0, 400]


def test_every_run_is_drawn_when_asked_and_the_nearest_is_named_with_its_artefact(said, reported):
    panels, arms, seeds = 2, 2, 3
    assert said["bands"] == panels * arms * 2
    assert said["runs"] == panels * arms * (seeds + 1)
    pattern = r"Nearest run: DDPG, .* buffer, seed \d, cost [\d.,]+ \((training/ddpg-\S+), ([0-9a-f]{16})\)"
    named = re.fullmatch(pattern, said["nearest"])
    assert named is not None
    assert reported.path(named[1], "manifest.json").exists()


def test_nothing_runs_over_the_edge_of_a_screen_of_400_pixels(said):
    assert said["over"] == []
