"""All checks, in the order in which one would mend things."""

from collections.abc import Callable
from pathlib import Path

from maglev_offline.doctor.check import Check
from maglev_offline.doctor.engines import engines
from maglev_offline.doctor.installation import declared, installation
from maglev_offline.doctor.place import known_recipe, place
from maglev_offline.doctor.resources import machine, needs
from maglev_offline.doctor.trial import Found, try_engines
from maglev_offline.machine import usable_cores


def examine(workspace: str, recipe: Path | None, trial: Callable[[str], Found] = try_engines) -> list[Check]:
    """Look at everything that a run with this recipe in this workspace needs; nothing is left behind.

    `workspace`: a path or an address; `recipe`: the one given, else the workspace's, else the defaults.
    """
    of, about_recipe = known_recipe(recipe, workspace)
    choice = of.training.engine if of is not None else "auto"
    needed = needs(of, usable_cores())
    return [
        *installation(declared()),
        *engines(trial(choice), choice),
        *machine(needed),
        about_recipe,
        *place(workspace, needed),
    ]
