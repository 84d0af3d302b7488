from pathlib import Path

import pytest

from maglev_offline.errors import RecipeError
from maglev_offline.physics.parameters import MU_0
from maglev_offline.recipe import Recipe, load_recipe, parse_recipe, recall, remember

PIPELINES = sorted((Path(__file__).parents[1] / "pipelines").glob("*.toml"))

SIGNALS = """
[signals]
topic = "/(?P<point>.+)"
gap = { field = "gap", unit = "mm" }
current = { field = "current", unit = "A" }
voltage = { field = "voltage", unit = "V" }
"""


@pytest.fixture
def mistakes(tmp_path):
    """What is said of a recipe with this text."""

    def load(text):
        path = tmp_path / "wrong.toml"
        path.write_text(text)
        with pytest.raises(RecipeError) as caught:
            load_recipe(path)
        assert caught.value.where == str(path)
        assert caught.value.exit_code == 2
        assert "\n" not in caught.value.paragraph()
        return caught.value.what

    return load


def test_an_empty_recipe_is_the_defaults(tmp_path):
    (tmp_path / "empty.toml").touch()
    assert load_recipe(tmp_path / "empty.toml") == Recipe()


def test_a_recipe_holds_what_its_file_says(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text('name = "own"\n[plant]\nmass_kg = 650\n[control.pid]\nkp = 1.5\n' + SIGNALS)
    recipe = load_recipe(path)
    assert recipe.name == "own"
    assert recipe.plant.mass_kg == 650
    assert recipe.control.pid.kp == 1.5
    assert recipe.signals.gap.unit == "mm"
    assert recipe.world.plant is recipe.plant
    assert recipe.curate == Recipe().curate


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[curate]\ntarget_row = 5", "[curate] target_row: unknown key (did you mean `target_rows`?)"),
        ("[curate]\nxyzzy = 5", "[curate] xyzzy: unknown key."),
        ("[control.pid]\nKp = 5", "[control.pid] Kp: unknown key (did you mean `kp`?)"),
        ("[traning]\nseeds = 5", "[traning]: unknown table (did you mean `training`?)"),
        ("nam = 'x'", "nam: unknown key (did you mean `name`?)"),
        ("[curate]\ntarget_rows = 'many'", "[curate] target_rows: input should be a valid integer"),
        ("[curate]\ntarget_rows = 0", "greater than or equal to 1 (given: 0)"),
        ("[plant]\nmass_kg = nan", "[plant] mass_kg: input should be a finite number (given: nan)"),
        ("[plant]\nmass_kg = inf", "[plant] mass_kg: input should be a finite number (given: inf)"),
        ("[mdp]\nstart_gap_m = [0.01, 'x']", "[mdp] start_gap_m[1]: "),
        ("[mdp]\ncontrol_period_ms = 2.5", "[mdp]: control_period_ms = 2.5 must be a whole multiple of"),
        ("[plant]\nset_point_m = 1", "[plant]: set_point_m = 1 must lie between the stops"),
        ("[plant]\ncoil_turns = 450", "[plant]: coil_turns and pole_area_m2 go together"),
        ("mdp = 3", "mdp: must be a table (given: 3)"),
        ("logs = [1]", "logs[0]: input should be a valid string (given: 1)"),
        ("[training]\nalgorithms = ['sac']", "[training] algorithms[0]: input should be 'ddpg' or 'td3'"),
        (SIGNALS.replace('gap = { field = "gap", unit = "mm" }', ""), "[signals] gap: is needed and not there"),
        (SIGNALS.replace('"mm"', '"kg"'), "[signals]: "),
        (SIGNALS.replace('"mm"', '"furlongs per jiffy"'), "[signals.gap] unit: "),
        (SIGNALS.replace('unit = "mm"', 'units = "mm"'), "[signals.gap] units: unknown key (did you mean `unit`?)"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_with_its_table_and_key(mistakes, text, said):
    assert said in mistakes(text)


def test_a_unit_of_another_kind_names_both_units(mistakes):
    assert "unit 'kg' cannot be turned into 'm'" in mistakes(SIGNALS.replace('"mm"', '"kg"'))


def test_all_mistakes_are_told_at_once(mistakes):
    said = mistakes("[plant]\nmass_kg = -1\n[curate]\nbins_gap = 0\nnonsense = 1")
    assert said.count(";") == 2
    assert all(part in said for part in ("[plant] mass_kg", "[curate] bins_gap", "[curate] nonsense"))


def test_what_is_no_toml_is_told_with_its_line(mistakes):
    assert "no valid TOML" in mistakes("[plant\n")
    assert "line 2" in mistakes("name = 'x'\n= 3")


def test_an_option_is_called_one():
    with pytest.raises(RecipeError, match="Correct the option"):
        parse_recipe({"select": {"start": "yesterday"}}, "--start")


def test_bytes_that_are_no_text_are_told_of(tmp_path):
    (tmp_path / "wrong.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(RecipeError, match="no text file"):
        load_recipe(tmp_path / "wrong.toml")


def test_a_recipe_that_is_not_there_is_told_of(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(RecipeError, match=r"no such recipe\. Give the path of a TOML file"):
            load_recipe(path)


@pytest.mark.parametrize("path", PIPELINES, ids=lambda path: path.stem)
def test_a_workspace_remembers_a_recipe_as_it_was(tmp_path, path):
    recipe = load_recipe(path)
    remember(tmp_path / "workspace", recipe)
    assert recall(tmp_path / "workspace") == recipe
    assert [p.name for p in (tmp_path / "workspace").iterdir()] == ["recipe.json"]


def test_a_new_recipe_takes_the_place_of_the_old(tmp_path):
    remember(tmp_path, Recipe(name="old"))
    remember(tmp_path, Recipe(name="new"))
    assert recall(tmp_path).name == "new"


def test_a_workspace_without_a_recipe_remembers_none(tmp_path):
    assert recall(tmp_path) is None


@pytest.mark.parametrize("text", ["{", "[]", '{"colour": 1}'])
def test_a_damaged_memory_is_told_of(tmp_path, text):
    (tmp_path / "recipe.json").write_text(text)
    with pytest.raises(RecipeError) as caught:
        recall(tmp_path)
    assert caught.value.where == str(tmp_path / "recipe.json")


def test_a_coil_gives_the_inductance(tmp_path):
    path = tmp_path / "coil.toml"
    path.write_text("[plant]\ncoil_turns = 400\npole_area_m2 = 0.02\n")
    assert load_recipe(path).plant.inductance_slope_h_m == pytest.approx(MU_0 * 400**2 * 0.02 / 2)


@pytest.mark.parametrize("text", ["a = " + "[" * 5000, "a = " + "9" * 5000])
def test_toml_that_no_one_writes_by_hand_is_refused_in_words(tmp_path, text):
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(RecipeError, match="no valid TOML"):
        load_recipe(tmp_path / "r.toml")
