"""The page in a browser: the rules it writes are a recipe, and do to all rows what it counted in its sample."""

import json
import re
import shutil
import subprocess
import tomllib
from html import unescape
from pathlib import Path
from urllib.parse import quote

import pytest

from maglev_offline.curate.stage import curate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import parse_recipe
from maglev_offline.report.card.sample import KEY, read_candidates, sample_of
from maglev_offline.workspace import Workspace

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no chromium here to open the page in")


@pytest.fixture
def opened(tmp_path):
    """Open a page at an address and give what it says when it is loaded: the rules as TOML, and the rows it counts."""

    def run(page: Path, rules: object = None) -> tuple[str, int]:
        address = page.as_uri() + ("" if rules is None else f"#rules={quote(json.dumps(rules))}")
        command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/profile"]
        done = subprocess.run([*command, "--dump-dom", address], capture_output=True, text=True, timeout=120)
        toml = re.search(r'<textarea id="toml"[^>]*>(.*?)</textarea>', done.stdout, re.S)
        count = re.search(r'<output id="count" data-used="(\d+)"', done.stdout)
        assert toml is not None, done.stderr
        assert count is not None, done.stdout[-2000:]
        return unescape(toml[1]), int(count[1])

    return run


@pytest.fixture(scope="module")
def sample(carded):
    folder = carded / "transitions"
    return sample_of(read_candidates(folder), folder, Plant(), Mdp(), seed=0)


def kept(recipe, toml, carded, home, sample):
    """How many rows of the sample are candidates still, after `curate` with the rules of the page."""
    tables = recipe.plain()
    for name in ("include", "exclude"):
        tables["curate"].pop(name, None)
    rules = tomllib.loads(toml).get("curate", {})
    tables["curate"] |= rules
    made = parse_recipe(tables, "the page")
    workspace = Workspace(Path(shutil.copytree(carded, home / "workspace")))
    folder, fresh = curate(workspace, made.curate, made.plant, made.mdp)
    assert fresh
    return len(sample[KEY].merge(read_candidates(folder)[KEY], on=KEY))


def test_rules_of_the_page_do_to_all_rows_what_it_counted(opened, carded, recipe, tmp_path, sample):
    train = sample.loc[sample["split"] == "train", "log_id"].iloc[0]
    edge = float(sample["gap_error_m"].quantile(0.4, interpolation="nearest"))  # a row lies just on it
    asked = [
        *({"kind": "exclude", **rule.model_dump(exclude_none=True)} for rule in recipe.curate.exclude),
        {"kind": "include", "voltage_deviation_v": [-20, 12.5], "log_id": [train]},
        {"kind": "include", "current_error_a": [-0.25, 1e-7], "gap_velocity_m_s": [-0.01, 1]},
        {"kind": "exclude", "gap_error_m": [edge, 0.0003]},
    ]
    toml, used = opened(carded / "card" / "card.html", asked)
    rules = tomllib.loads(toml)["curate"]
    assert rules["include"] == [{k: v for k, v in rule.items() if k != "kind"} for rule in asked[1:3]]
    assert len(rules["exclude"]) == 2
    assert 0 < used < len(sample)
    assert kept(recipe, toml, carded, tmp_path, sample) == used


def test_page_begins_with_the_rules_of_the_recipe_whatever_its_address_holds(opened, carded, recipe, sample):
    toml, used = opened(carded / "card" / "card.html", "no list of rules")
    assert tomllib.loads(toml) == {"curate": {"exclude": recipe.plain()["curate"]["exclude"]}}
    assert used == len(sample)
    toml, used = opened(carded / "card" / "card.html", [{"kind": "include", "weight": [0, 1], "cost": [1, 0]}, None, 7])
    assert tomllib.loads(toml) == {}
    assert used == len(sample)


ACTIONS = """
const press = (kind, x, y) => canvas.dispatchEvent(new PointerEvent(kind, { clientX: x, clientY: y, pointerId: 1 }));
canvas.setPointerCapture = () => {};
const seen = canvas.getBoundingClientRect();
press("pointerdown", seen.left + 0.4 * seen.width, seen.top + 0.2 * seen.height);
press("pointermove", seen.left + 0.6 * seen.width, seen.top + 0.6 * seen.height);
press("pointerup", seen.left + 0.6 * seen.width, seen.top + 0.6 * seen.height);
at("voltage_deviation_v-from").value = "-5";
tellRanges();
at("exclude").click();
at("rules").querySelector("button").click();
"""


def test_rectangle_that_is_drawn_and_a_range_that_is_typed_become_one_rule(opened, carded, recipe, tmp_path, sample):
    text = (carded / "card" / "card.html").read_text()
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)  # for the hand of the test
    page = tmp_path / "page.html"
    page.write_text(text.replace("</body>", f"<script>{ACTIONS}</script></body>"))
    toml, used = opened(page)
    (rule,) = tomllib.loads(toml)["curate"]["exclude"]  # the recipe's own was removed
    assert list(rule) == ["gap_error_m", "gap_velocity_m_s", "voltage_deviation_v"]
    assert rule["voltage_deviation_v"] == [-5, read_candidates(carded / "transitions")["voltage_deviation_v"].max()]
    assert all(low < high for low, high in rule.values())
    assert 0 < used < len(sample)
    assert kept(recipe, toml, carded, tmp_path, sample) == used
