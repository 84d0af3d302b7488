"""The installation: the package itself, Python, the system, the packages that it needs, and the optional ones."""

import platform
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from maglev_offline import __version__
from maglev_offline.doctor.check import Check, State

NAME = "maglev-offline"
PACKAGE = Path(__file__).parents[1]

EXTRAS = {
    "export": "`policy export --format onnx`",
    "dask": "`--backend dask`",
    "exports": "`prefill --format d3rlpy` and `minari`",
    "ray": "`--backend ray`",
    "tensorboard": "`train --tensorboard`",
}
"""What the optional packages of a user are for."""

SOURCE_EXTRAS = {
    "bench": "benchmarks/ingest.py, in an environment of its own",
    "clusters": "`make clusters`, which makes an environment of its own",
    "dev": "`make check` and `make test` (`make setup` gets them)",
    "foreign": "`make exports`, which makes an environment of its own",
}
"""Those of a contributor, who has the source tree; nobody else is told of them."""


class Declared(NamedTuple):
    """What the package says that it needs: requirements as text, and the versions that it was tested with.

    `tree`: the folder of the source tree, None where there is none.
    """

    python: str
    dependencies: list[str]
    extras: dict[str, list[str]]
    tested: dict[str, str]
    tree: Path | None


def declared(beside: Path = PACKAGE.parent) -> Declared | None:
    """What the source tree says where the package lies in one, since an installation of it may be an old one.

    Else what the installation says; None where there is neither.
    """
    try:
        project: dict[str, Any] = tomllib.loads((beside / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    except (OSError, ValueError, KeyError):
        project = {}
    if project.get("name") == NAME:
        extras = project.get("optional-dependencies", {})
        return Declared(project["requires-python"], project["dependencies"], extras, _tested(beside), beside)
    try:
        found = metadata.metadata(NAME)
        needs = metadata.requires(NAME) or []
    except metadata.PackageNotFoundError:
        return None
    extras = {extra: [text for text in needs if _is_of(text, extra)] for extra in found.get_all("Provides-Extra") or []}
    plain = [text for text in needs if not any(text in listed for listed in extras.values())]
    return Declared(found["Requires-Python"] or "", plain, extras, {}, None)


def _is_of(requirement: str, extra: str) -> bool:
    """Whether metadata name a requirement for this extra; they quote either way."""
    marker = requirement.partition(";")[2].replace('"', "'")
    return f"extra == '{extra}'" in marker


def _tested(beside: Path) -> dict[str, str]:
    try:
        text = (beside / "constraints.txt").read_text(encoding="utf-8")
    except OSError:
        return {}
    pins = (line.partition("#")[0].strip().partition("==") for line in text.splitlines())
    return {_key(name): version for name, _, version in pins if version}


def _key(name: str) -> str:
    return name.lower().replace("_", "-").replace(".", "-")


def installation(said: Declared | None) -> list[Check]:
    """All checks of this module; `said` is what `declared` gives."""
    return [package(said), *python(said), system(), *dependencies(said), *extras(said)]


def package(said: Declared | None) -> Check:
    """The package itself: its version, and where it lies."""
    tree = said is not None and said.tree is not None
    facts = {"version": __version__, "path": str(PACKAGE), "source_tree": tree, "installed": _version(NAME)}
    what = f"{__version__}, {'source tree' if tree else 'installed'} at {PACKAGE.parent if tree else PACKAGE}"
    if facts["installed"] is None:
        return Check("package", NAME, "note", f"{what}, not installed", "pip install -c constraints.txt .", facts)
    if facts["installed"] != __version__:
        what = f"{what}, but version {facts['installed']} is what pip knows of"
        return Check("package", NAME, "note", what, "Install it again.", facts)
    return Check("package", NAME, "ok", what, "", facts)


def python(said: Declared | None) -> list[Check]:
    """The version of Python against the one that is needed; nothing where that is not known."""
    here = platform.python_version()
    needs = said.python if said else ""
    facts = {"version": here, "needs": needs, "executable": sys.executable}
    if not needs or _version("packaging") is None or _fits(here, needs):
        return [Check("python", "Python", "ok", f"{here} ({sys.executable})", "", facts)]
    todo = f"Install it into an environment with Python {needs}."
    return [Check("python", "Python", "problem", f"{here}, and {needs} is needed", todo, facts)]


def system() -> Check:
    """The operating system; the project's own tests run on Linux."""
    kind, facts = platform.system(), {"system": platform.system(), "machine": platform.machine()}
    what = f"{platform.platform()}, {platform.machine()}"
    if kind == "Windows":
        return Check("system", "system", "problem", f"{what}: workspaces cannot be locked here", "Use WSL.", facts)
    if kind != "Linux":
        return Check("system", "system", "note", f"{what}: the project is tested on Linux only", "", facts)
    return Check("system", "system", "ok", what, "", facts)


def dependencies(said: Declared | None) -> list[Check]:
    """Each package that is needed against its requirement, and all of them against the versions that were tested."""
    if said is None:
        what = "what the package needs is not known: it is neither installed nor in its source tree"
        return [Check("dependencies", "dependencies", "note", what, "Install it: pip install -c constraints.txt .")]
    if _version("packaging") is None:
        facts: dict[str, Any] = {"version": None, "needs": "", "tested": said.tested.get("packaging")}
        what = "not here, so nothing can be said of the others"
        return [Check("dependency", "packaging", "problem", what, "pip install packaging", facts)]
    found = [_dependency(text, said.tested) for text in said.dependencies if _applies(text)]
    return [*found, *_as_tested(found)]


def _dependency(text: str, tested: dict[str, str]) -> Check:
    from packaging.requirements import Requirement

    needed = Requirement(text)
    here, needs = _version(needed.name), str(needed.specifier)
    facts = {"version": here, "needs": needs, "tested": tested.get(_key(needed.name))}
    todo = f"pip install '{needed.name}{needs}'"
    if here is None:
        return Check("dependency", needed.name, "problem", f"not here, and {needs or 'it'} is needed", todo, facts)
    if not _fits(here, needs):
        return Check("dependency", needed.name, "problem", f"{here}, and {needs} is needed", todo, facts)
    return Check("dependency", needed.name, "ok", here, "", facts)


def _as_tested(found: list[Check]) -> list[Check]:
    """One note for all packages of other versions than the tested ones; a local version (`+cpu`) is no other one."""
    others = [
        check
        for check in found
        if check.state == "ok" and check.facts["tested"] not in (None, check.facts["version"].partition("+")[0])
    ]
    if not others:
        return []
    listed = ", ".join(f"{check.about} {check.facts['version']} ({check.facts['tested']})" for check in others)
    what = f"others than were tested, which may change the last digits: {listed}"
    return [Check("versions", "versions", "note", what, "For the tested ones: pip install -c constraints.txt .")]


def extras(said: Declared | None) -> list[Check]:
    """Each group of optional packages: what it is for, and how to get what is missing."""
    if said is None or _version("packaging") is None:
        return []
    purposes = EXTRAS | (SOURCE_EXTRAS if said.tree else {})
    return [_extra(name, purposes[name], texts) for name, texts in sorted(said.extras.items()) if name in purposes]


def _extra(name: str, purpose: str, texts: list[str]) -> Check:
    from packaging.requirements import Requirement

    needed = [Requirement(text) for text in texts if _applies(text, name)]
    versions = {one.name: _version(one.name) for one in needed}
    missing = [one.name for one in needed if not _fits(versions[one.name], str(one.specifier))]
    facts = {"versions": versions, "missing": missing}
    if not missing:
        return Check("extra", f"extra {name}", "ok", f"{', '.join(versions)}; for {purpose}", "", facts)
    what = f"{', '.join(missing)} not here, or too old; for {purpose}"
    state: State = "note" if name in EXTRAS else "ok"  # nobody who only runs the tool lacks a contributor's packages
    todo = f"pip install 'maglev-offline[{name}]'" if name in EXTRAS else ""
    return Check("extra", f"extra {name}", state, what, todo, facts)


def _applies(text: str, extra: str = "") -> bool:
    from packaging.requirements import Requirement

    marker = Requirement(text).marker
    return marker is None or marker.evaluate({"extra": extra})


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _fits(version: str | None, needs: str) -> bool:
    from packaging.specifiers import SpecifierSet

    return version is not None and SpecifierSet(needs).contains(version, prereleases=True)
