"""The tutorial: every block runs as it stands, in order, in one folder, and shows what it says it shows."""

import contextlib
import io
import itertools
import math
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"
NUMBER = r"[-+]?\d(?:[\d,]*\d)?(?:\.\d+)?(?:e[-+]?\d+)?"
LIKENESS = 0.05
"""Other processors and libraries may differ in the last digits, not in what the page says of them."""


def spaced(text: str) -> str:
    return " ".join(text.split())


def alike(shown: str, line: str) -> bool:
    """Whether a line of output is what the page shows: `...` is any text, and numbers may differ a little."""
    parts = [re.split(rf"({NUMBER})", part) for part in spaced(shown).split("...")]
    pattern = ".*".join(
        "".join(f"({NUMBER})" if place % 2 else re.escape(text) for place, text in enumerate(part)) for part in parts
    )
    found = re.fullmatch(pattern, spaced(line))
    numbers = [text for part in parts for text in part[1::2]]
    return found is not None and all(
        math.isclose(float(a.replace(",", "")), float(b.replace(",", "")), rel_tol=LIKENESS)
        for a, b in zip(found.groups(), numbers, strict=True)
    )


def write(table: str) -> None:
    Path(table.splitlines()[0].removeprefix("# ")).write_text(table)


@pytest.fixture(scope="module")
def told(reader):
    """What every block that runs has printed, beside the output that the page shows for it (or none)."""
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.S | re.M)
    names: dict[str, object] = {}
    run = {"bash": reader, "toml": write, "python": lambda code: exec(compile(code, PAGE.name, "exec"), names)}
    found = []
    for (language, text), (after, shown) in itertools.pairwise([*blocks, ("", "")]):
        if language == "text":
            continue
        with contextlib.redirect_stdout(io.StringIO()) as out:
            run[language](text)
        found.append((text, out.getvalue(), shown if after == "text" else ""))
    return found


def test_every_block_runs_and_shows_what_the_page_says(told):
    assert len(told) > 12
    for block, printed, shown in told:
        lines = iter(printed.splitlines())
        for line in filter(lambda line: line.strip() not in ("", "..."), shown.splitlines()):
            assert any(alike(line, other) for other in lines), f"{block}\nshows no: {line}\nbut: {printed}"


@pytest.mark.parametrize(
    ("shown", "line", "same"),
    [
        ("error 1.05 (...)", "error  1.06 (0.95 to 1.21)", True),
        ("error 1.05 (...)", "error 1.5 (0.95 to 1.21)", False),
        ("used 5,991", "used 5,990", True),
        ("verdict fit", "verdict harmful", False),
    ],
)
def test_numbers_may_differ_a_little_and_words_may_not(shown, line, same):
    assert alike(shown, line) is same
