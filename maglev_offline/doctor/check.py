"""What one look tells: its state, what was seen, and what to do."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

State = Literal["ok", "note", "problem"]
"""`note`: something optional is not there, or may be wanted otherwise. `problem`: the whole road stops at it."""

STATES: tuple[State, ...] = ("ok", "note", "problem")


@dataclass(frozen=True)
class Check:
    """`code` is stable; `about` names what was looked at; `facts`: the same keys for each check of one code."""

    code: str
    about: str
    state: State
    what: str
    todo: str = ""
    facts: dict[str, Any] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """For scripts."""
        return asdict(self)


def worst(checks: Sequence[Check]) -> State:
    """The worst state of all; `ok` where there are none."""
    return max((check.state for check in checks), key=STATES.index, default="ok")


def exit_code(checks: Sequence[Check]) -> int:
    """2 where one is a problem, else 0."""
    return 2 if worst(checks) == "problem" else 0


def plain(checks: Sequence[Check]) -> dict[str, Any]:
    """All of it for scripts."""
    return {
        "status": "done",
        "worst": worst(checks),
        "counts": {state: sum(check.state == state for check in checks) for state in STATES},
        "checks": [check.plain() for check in checks],
    }


def lines(checks: Sequence[Check], *, quiet: bool = False) -> list[str]:
    """All of it for people: a line for each, what to do below it; dependencies that are well in one line.

    `quiet`: without those that are ok.
    """
    well = [check for check in checks if check.code == "dependency" and check.state == "ok"]
    told = []
    for check in checks:
        if check.state == "ok" and quiet:
            continue
        if check in well:
            if check is well[0]:
                told.append(_line("ok", "dependencies", ", ".join(f"{one.about} {one.what}" for one in well)))
            continue
        told.append(_line(check.state, check.about, check.what))
        if check.todo:
            told.append(f"{'':9}{check.todo}")
    problems = sum(check.state == "problem" for check in checks)
    verb = "stands" if problems == 1 else "stand"
    what = f"{problems} problem{'' if problems == 1 else 's'}" if problems else "Nothing"
    return [*told, f"{what} {verb if problems else 'stands'} in the way of the whole road."]


def _line(state: State, about: str, what: str) -> str:
    return f"{state:<9}{about}: {what}"
