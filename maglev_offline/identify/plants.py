"""Plants in TOML files: a `[plant]` table, written from what was identified and read by any command."""

import difflib
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from maglev_offline.errors import RecipeError
from maglev_offline.identify.verdict import IDENTIFIED, Parameter
from maglev_offline.physics.parameters import Plant

PLANT_FILE = "plant.toml"

_OF_THE_PLANT = {
    "resistance_ohm": "resistance_ohm",
    "inductance_offset_h": "inductance_offset_h",
    "inductance_slope_h_m": "inductance_slope_h_m",
    "pole_offset_m": "pole_offset_m",
}


def load_plant(path: Path) -> Plant:
    """Read the `[plant]` table of a TOML file; any other table, as those of a whole recipe, is passed over.

    Raises
    ------
    RecipeError: no such file, no TOML, no `[plant]` table, or values that cannot be; all mistakes at once.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        raise RecipeError(
            "there is no such plant file.", where=str(path), todo="Give the path of a TOML file."
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise RecipeError(f"this is no valid TOML: {error}.", where=str(path), todo="Correct the line.") from None
    table = data.get("plant")
    if not isinstance(table, dict):
        raise RecipeError("there is no [plant] table.", where=str(path), todo="Give the file that `identify` wrote.")
    try:
        return Plant.model_validate(table)
    except ValidationError as error:
        mistakes = "; ".join(_mistake(detail) for detail in error.errors())
        raise RecipeError(f"{mistakes}.", where=str(path), todo="Correct the plant; nothing was run.") from None


def _mistake(detail: Any) -> str:
    key = ".".join(str(part) for part in detail["loc"])
    if detail["type"] == "extra_forbidden":
        near = difflib.get_close_matches(key, list(Plant.model_fields), n=1, cutoff=0.5)
        return f"[plant] {key}: unknown key" + (f" (did you mean `{near[0]}`?)" if near else "")
    text = str(detail["msg"]).removeprefix("Value error, ")
    given = detail["input"]
    told = f" (given: {given!r})" if isinstance(given, str | int | float | bool) else ""
    return f"[plant]{f' {key}' if key else ''}: {text[0].lower() + text[1:]}{told}"


def fitted_plant(declared: Plant, parameters: tuple[Parameter, ...]) -> tuple[Plant, dict[str, str]]:
    """The plant with the identified values in place of the declared ones, and where each number comes from.

    The gain c/m makes c = gain x declared mass (a mass is weighed more surely than an inductance is fitted); without
    it c is that of the coil, where identified. A negative inductance or pole offset is no plant: declared is kept.
    """
    values = {
        k: v for k, v in declared.model_dump().items() if v is not None and k not in ("coil_turns", "pole_area_m2")
    }
    source = dict.fromkeys(values, "declared")
    known = {p.name: p for p in parameters}
    for name, key in _OF_THE_PLANT.items():
        one = known[name]  # type: ignore[index]
        if one.verdict != IDENTIFIED or one.estimate is None:
            source[key] = f"declared; {one.verdict}"
        elif one.estimate < 0 or (one.estimate == 0 and key == "resistance_ohm"):
            source[key] = f"declared; the estimate {one.estimate:.3g} is below 0, which no plant has"
        else:
            values[key] = float(one.estimate)
            source[key] = f"identified, standard error {one.error:.2g}; declared was {one.declared:.4g}"
    gain = known["gain_h_m_per_kg"]
    if gain.verdict == IDENTIFIED and gain.estimate is not None:
        values["inductance_slope_h_m"] = gain.estimate * declared.mass_kg
        source["inductance_slope_h_m"] = (
            f"identified, as c/m = {gain.estimate:.4g} H m/kg times the declared mass; "
            f"declared was {declared.inductance_slope_h_m:.4g}"
        )
    return Plant.model_validate(values), source


def plant_text(plant: Plant, source: dict[str, str]) -> str:
    """The TOML file: one `[plant]` table whose comments say where each number comes from."""
    head = "# A plant as `maglev-offline identify` found it; give it to other commands with --plant.\n[plant]\n"
    lines = [
        f"{key} = {float(value)!r} # {source.get(key, 'declared')}\n"
        for key, value in plant.model_dump().items()
        if value is not None and key not in ("coil_turns", "pole_area_m2")
    ]
    return head + "".join(lines)
