"""The recipe: every number that a run depends on, in one TOML file whose tables belong to the stages."""

import difflib
import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, Field, ValidationError, model_validator

from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.control.settings import ControlSettings
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import RecipeError
from maglev_offline.filesystems import write_whole
from maglev_offline.identify.settings import IdentifySettings
from maglev_offline.ingest.check_settings import CheckSettings
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.select import Selection
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.signals import SignalMap
from maglev_offline.logs.surrogate_settings import SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.report.settings import ReportSettings
from maglev_offline.settings import Settings
from maglev_offline.transfer.settings import TransferSettings

if TYPE_CHECKING:
    from maglev_offline.agents.stage import World
    from maglev_offline.transfer.arm_rows import Sources


class Recipe(Settings):
    """One table for each stage; a table that is not given takes the defaults of the stage.

    `logs`: what `maglev-offline run` ingests, as paths or patterns relative to the recipe's own folder. `signals`:
    where it is not given, signals are found by the names and units that surrogate logs use.
    """

    name: str = "defaults"
    description: str = ""
    logs: tuple[str, ...] = ()
    plant: Plant = Field(default_factory=Plant)
    mdp: Mdp = Field(default_factory=Mdp)
    signals: SignalMap | None = None
    ingest: IngestSettings = Field(default_factory=IngestSettings)
    checks: CheckSettings = Field(default_factory=CheckSettings)
    select: Selection = Field(default_factory=Selection)
    identify: IdentifySettings = Field(default_factory=IdentifySettings)
    curate: CurateSettings = Field(default_factory=CurateSettings)
    prefill: PrefillSettings = Field(default_factory=PrefillSettings)
    training: TrainingSettings = Field(default_factory=TrainingSettings)
    evaluation: EvaluationSettings = Field(default_factory=EvaluationSettings)
    transfer: TransferSettings = Field(default_factory=TransferSettings)
    control: ControlSettings = Field(default_factory=ControlSettings)
    surrogate: SurrogateSettings = Field(default_factory=SurrogateSettings)
    report: ReportSettings = Field(default_factory=ReportSettings)

    @model_validator(mode="after")
    def _arms_and_periods_can_be(self) -> "Recipe":
        from maglev_offline.transfer.arms import plan_of

        for name in self.transfer.known_arms:
            plan_of(name, self.transfer, self.curate, self.training)
        for period_ms in self.transfer.control_periods_ms:
            try:
                Mdp.model_validate(self.mdp.model_dump() | {"control_period_ms": period_ms})
            except ValidationError as error:
                raise ValueError(f"[transfer] control_periods_ms: {error.errors()[0]['msg']}") from None
        return self

    @property
    def world(self) -> "World":
        """The tables that training depends on."""
        from maglev_offline.agents.stage import World  # it brings pandas, and most commands do not train

        return World(self.plant, self.mdp, self.training, self.evaluation)

    @property
    def sources(self) -> "Sources":
        """The tables that the rows of a study's arms depend on, beside the world."""
        from maglev_offline.transfer.arm_rows import Sources

        return Sources(self.curate, self.prefill, self.control)

    @property
    def request(self) -> Request:
        """The tables that samples depend on."""
        return Request(self.signals, self.ingest, self.plant, self.checks, self.select)

    def plain(self) -> dict[str, Any]:
        """The resolved recipe as JSON-able tables, defaults filled in."""
        return self.model_dump(mode="json", exclude_none=True)


def load_recipe(path: Path) -> Recipe:
    """Read a recipe.

    Raises
    ------
    RecipeError: there is no such file, it is no TOML, or a table holds an unknown key or a value that cannot be. All
        mistakes are listed at once, each with its table and key.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, IsADirectoryError):
        raise RecipeError("there is no such recipe.", where=str(path), todo="Give the path of a TOML file.") from None
    except UnicodeDecodeError:
        raise RecipeError("this is no text file.", where=str(path), todo="Give the path of a TOML file.") from None
    except (ValueError, RecursionError) as error:  # beside what is no TOML: a number of 5,000 digits, 1,000 brackets
        raise RecipeError(f"this is no valid TOML: {error}.", where=str(path), todo="Correct the line.") from None
    return parse_recipe(data, str(path))


def parse_recipe(data: dict[str, Any], where: str) -> Recipe:
    """Turn the tables of a recipe into a `Recipe`; `where` names the file in errors."""
    try:
        return Recipe.model_validate(data)
    except ValidationError as error:
        mistakes = [_mistake(detail) for detail in error.errors()]
        what = "option" if where.startswith("--") else "recipe"
        todo = f"Correct the {what}; nothing was run."
        raise RecipeError("; ".join(mistakes) + ".", where=where, todo=todo) from None


def _mistake(detail: Any) -> str:
    """Say one validation error in the recipe's own words: `[table] key: what is wrong`, or `[table]: ...`."""
    path = [str(part) for part in detail["loc"]]
    kind, given = detail["type"], detail["input"]
    place = _place(detail["loc"], whole_table=kind != "missing" and isinstance(given, dict))
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(path[-1], _keys_of(path[:-1]), n=1, cutoff=0.5)
        what = "unknown table" if isinstance(given, dict) else "unknown key"
        return f"{place}: {what}" + (f" (did you mean `{near[0]}`?)" if near else "")
    if kind == "missing":
        return f"{place}: is needed and not there"
    if kind in ("model_type", "dict_type"):
        return f"{place}: must be a table (given: {given!r})"
    text = str(detail["msg"]).removeprefix("Value error, ")
    if isinstance(given, str | int | float | bool) and repr(given) not in text:
        text = f"{text} (given: {given!r})"
    return f"{place}: {text[0].lower() + text[1:]}"


def _place(loc: Sequence[str | int], *, whole_table: bool) -> str:
    """Where in the recipe: `[table.table]`, `[table] key`, `[table] key[2]`, or a key above all tables."""
    names = [str(part) for part in loc]
    at = next((n for n, part in enumerate(loc) if isinstance(part, int)), len(loc))
    element = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc[at:])
    names = names[:at]
    if not names:
        return "the recipe"
    if whole_table and not element:
        return f"[{'.'.join(names)}]"
    table = f"[{'.'.join(names[:-1])}] " if names[1:] else ""
    return f"{table}{names[-1]}{element}"


def _keys_of(path: list[str]) -> list[str]:
    """The keys that the table at `path` knows."""
    table: Any = Recipe
    for part in path:
        if part.isdigit():  # a place in a list of tables: the list's own fields were taken already
            continue
        fields = table.model_fields if isinstance(table, type) and issubclass(table, BaseModel) else {}
        if part not in fields:
            return []
        kinds = [fields[part].annotation, *getattr(fields[part].annotation, "__args__", ())]
        table = next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)
    return list(table.model_fields) if table is not None else []


def remember(root: Path, recipe: Recipe) -> None:
    """Keep the recipe in the workspace, so that the commands that follow need not be told again."""
    root.mkdir(parents=True, exist_ok=True)
    text = json.dumps(recipe.plain(), indent=2, sort_keys=True) + "\n"
    write_whole(root / "recipe.json", text.encode())


def recall(root: Path) -> Recipe | None:
    """The recipe that the workspace was last given, if any."""
    path = root / "recipe.json"
    if not path.is_file():
        return None
    todo = "The workspace remembers a recipe that this version cannot use. Give --recipe once more."
    try:
        return parse_recipe(json.loads(path.read_text(encoding="utf-8")), str(path))
    except RecipeError as error:
        raise RecipeError(error.what, where=str(path), todo=todo) from None
    except (ValueError, RecursionError):
        raise RecipeError("it cannot be read.", where=str(path), todo=todo) from None
