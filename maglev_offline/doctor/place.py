"""The workspace: whether it can be written, locked and renamed in, who holds it, and which recipe it remembers."""

import fcntl
import json
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_offline.doctor.check import Check
from maglev_offline.doctor.resources import Needs, disk
from maglev_offline.errors import InputError, RecipeError
from maglev_offline.filesystems import is_address, shown

if TYPE_CHECKING:
    from maglev_offline.recipe import Recipe

PROBE = ".doctor-"
"""How names of what is tried begin: nothing reads, lists or mirrors names with a dot."""

_ELSEWHERE = "Give another --workspace, on a local disk."


def known_recipe(given: Path | None, where: str) -> tuple["Recipe | None", Check]:
    """The recipe that a command would use, and whether it can be used; None where it cannot."""
    try:
        from maglev_offline.recipe import Recipe, load_recipe, parse_recipe, recall

        if given is not None:
            found, origin = load_recipe(given), str(given)
        elif is_address(where):
            from maglev_offline.store import Store

            kept = Store.open(where).read("recipe.json")
            found = Recipe() if kept is None else parse_recipe(json.loads(kept), shown(where))
            origin = "remembered by the workspace"
        else:
            found, origin = recall(Path(where)) or Recipe(), "remembered by the workspace"
    except RecipeError as error:
        return None, Check("recipe", "recipe", "problem", _said(error), error.todo, {"name": None})
    except InputError:  # of the store, which the check of the workspace tells
        what = "not known, since the workspace cannot be read"
        return None, Check("recipe", "recipe", "note", what, "Mend what is below.", {"name": None})
    except (ImportError, OSError, ValueError) as error:
        todo = "Mend what is above, or give --recipe."
        return None, Check("recipe", "recipe", "problem", f"it cannot be read: {error}", todo, {"name": None})
    what = "none, so the defaults" if found.name == "defaults" else f"{found.name} ({origin})"
    return found, Check("recipe", "recipe", "ok", what, "", {"name": found.name})


def place(where: str, needed: Needs) -> list[Check]:
    """All checks of the workspace at a path or an address. What is written to try it is removed again."""
    try:
        return _address(where, needed) if is_address(where) else _folder(Path(where), needed)
    except ImportError as error:
        todo = "Mend what is above."
        return [Check("workspace", "workspace", "problem", f"it cannot be tried: {error}", todo, _facts(where))]


def _facts(where: str) -> dict[str, str]:
    return {"where": shown(where)}


def _folder(root: Path, needed: Needs) -> list[Check]:
    nearest = root.absolute()
    while not nearest.exists():
        nearest = nearest.parent
    if not nearest.is_dir():
        what = f"{nearest} is a file, and a workspace is a folder"
        return [Check("workspace", "workspace", "problem", what, "Give another --workspace.", _facts(str(root)))]
    return [*_tried(root, nearest), _held(root), disk(nearest, needed)]


def _tried(root: Path, nearest: Path) -> list[Check]:
    """Write, rename and lock in the workspace, or in the folder in which it will be made."""
    there = f"{root}" if root.exists() else f"{root}, which will be made"
    facts = _facts(str(root))
    try:
        with tempfile.TemporaryDirectory(prefix=PROBE, dir=nearest) as folder:
            draft, made = Path(folder) / "draft", Path(folder) / "made"
            draft.mkdir()
            (draft / "file").write_bytes(b"tried")
            draft.rename(made)
            writable = Check("workspace", "workspace", "ok", there, "", facts)
            return [writable, _locking(made / "file")]
    except OSError as error:
        what = f"{there}: it cannot be written ({error.strerror})"
        todo = f"Make {nearest} writable for you, or give another --workspace."
        return [Check("workspace", "workspace", "problem", what, todo, facts)]


def _locking(path: Path) -> Check:
    try:
        with path.open("a+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        what = f"the file system cannot lock ({os.strerror(error.errno or 0)})"
        return Check("locking", "locking", "problem", what, _ELSEWHERE)
    return Check("locking", "locking", "ok", "the file system can lock")


def _held(root: Path) -> Check:
    from maglev_offline.workspace import Workspace

    try:
        holder = Workspace(root).holder()
    except OSError as error:
        what = f"who holds it cannot be told ({error.strerror})"
        return Check("lock", "lock", "problem", what, f"Look at {root / '.lock'}.", {"holder": None})
    if holder is None:
        return Check("lock", "lock", "ok", "no command is at work in the workspace", "", {"holder": None})
    todo = "Wait for it to end, or give another --workspace."
    return Check("lock", "lock", "problem", f"the workspace is in use by {holder}", todo, {"holder": holder})


def _address(where: str, needed: Needs) -> list[Check]:
    """Read and write in a store; its mirror is what needs room here."""
    from maglev_offline.remote import mirror_of
    from maglev_offline.store import Store

    try:
        store = Store.open(where)
        holder = store.holder()
        store.put(f"{PROBE}{os.getpid()}", b"tried")
        store.remove(f"{PROBE}{os.getpid()}")
    except InputError as error:
        return [Check("workspace", "workspace", "problem", _said(error), error.todo, _facts(where))]
    found = [Check("workspace", "workspace", "ok", f"{shown(where)} can be read and written", "", _facts(where))]
    if holder is None:
        found.append(Check("lock", "lock", "ok", "no command is at work in the workspace", "", {"holder": None}))
    else:
        found.append(Check("lock", "lock", "problem", holder.what, holder.todo, {"holder": holder.what}))
    mirror = mirror_of(where)
    return [*found, disk(next(folder for folder in mirror.parents if folder.is_dir()), needed)]


def _said(error: InputError) -> str:
    return f"{error.where}: {error.what}" if error.where else error.what
