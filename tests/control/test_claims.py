"""The table of claims: computed, judged by its tolerances, and equal to the one in the document."""

from pathlib import Path

import pyarrow as pa
import pytest

from maglev_offline.control import claim as words
from maglev_offline.control import claims as module
from maglev_offline.control import claims_measured as measured
from maglev_offline.control.claim import Claim
from maglev_offline.control.claims import (
    as_markdown,
    claims,
    claims_table,
    claims_to_table,
    main,
    with_table,
)
from maglev_offline.errors import InputError

FINDINGS = Path(__file__).parents[2] / "docs" / "findings.md"
ONE = Claim("II", "a | b", "1", "2", "not reproduced", "here", "10 %")


def documented() -> list[Claim]:
    """The claims as the document states them; that the code states the same is the first test's affair."""
    lines = (
        FINDINGS.read_text(encoding="utf-8")
        .split("<!-- claims: begin -->")[1]
        .split("<!-- claims: end -->")[0]
        .strip()
        .split("\n")[2:]
    )
    return [Claim(*line.strip("| ").split(" | ")) for line in lines]  # type: ignore[arg-type]


@pytest.mark.nightly
def test_document_and_code_agree() -> None:
    """The whole table once more: the one test here that takes seconds."""
    found, text = claims(), FINDINGS.read_text(encoding="utf-8")
    assert found == documented(), "run python -m maglev_offline.control.claims docs/findings.md"
    assert with_table(text, as_markdown(found)) == text
    table = claims_to_table(found)
    assert table.column_names == ["section", "statement", "paper", "measured", "verdict", "setting"]
    assert set(table.schema.types) == {pa.string()}
    assert table.num_rows == len(found)


def test_sections_and_verdicts() -> None:
    found = documented()
    assert {"II", "II-B", "VI-A", "VI-B"} <= {claim.section for claim in found}
    assert {claim.verdict for claim in found} == {"reproduced", "not reproduced", "not testable"}
    for claim in found:
        assert all(vars(claim).values())
        assert (claim.verdict == "not testable") == (claim.paper == "not given") == (claim.tolerance == "-")
        assert "nan" not in claim.measured


@pytest.mark.parametrize(
    ("statement", "setting", "measured", "verdict"),
    [
        ("matrices A and B", "", "2450, -1.16, 2120, -3.14; 2.62", "reproduced"),
        ("unstable without control", "", "18.8, -10.9 +- 17.1j", "reproduced"),
        ("PID Kp 3100", "linear, continuous", "2545 to 3517", "reproduced"),
        ("PID Kp 3100", "Euler", "2545 to 3226", "reproduced"),
        ("phase, delay", "", "phase 2.5 degrees, delay 1.4 ms", "not testable"),
        ("PID settles (2 %) from", "linear, exact", "7.62 s", "not reproduced"),
        ("PID settles (2 %) from", "linear, Euler", "23.8 s", "not reproduced"),
        ("PID settles (2 %) from", "RK4 1 ms", "6.18 s", "not reproduced"),
        ("PID overshoots", "RK4 1 ms", "27.6 %", "not reproduced"),
        ("PID overshoots", "skid", "25.1 %", "reproduced"),
        ("PID settles (2 %) with f", "", "0 of 16", "not reproduced"),
        ("LQI holds the magnet with f", "", "16 of 16 draws hit a stop", "not reproduced"),
        ("LQI settles (2 %) from 15 mm", "no voltage limit", "0.083 s", "reproduced"),
        ("LQI settles (2 %) from 15 mm", "no stop", "0.098 s RK4, 0.123 s Euler", "reproduced"),
        ("control period", "made for 1 ms", "at 1, 5, 9 of", "reproduced"),
    ],
)
def test_known_rows(statement: str, setting: str, measured: str, verdict: str) -> None:
    rows = [claim for claim in documented() if statement in claim.statement and setting in claim.setting]
    assert any(measured in claim.measured and claim.verdict == verdict for claim in rows), rows


@pytest.mark.parametrize(
    ("value", "near"), [(5.0, True), (4.5, True), (5.5, True), (5.51, False), (float("nan"), False)]
)
def test_verdicts_follow_from_the_tolerance(value: float, near: bool) -> None:
    assert measured._near(5.0, 0.1, 5.0, value) is near


def test_numbers_have_three_digits_at_most() -> None:
    assert [words.say(x) for x in (2119.67, -1.15583, 0.08349, -0.0)] == ["2120", "-1.16", "0.0835", "0"]
    assert [words.percent(x) for x in (-1e-9, 0.27614, 2.3641)] == ["0 %", "27.6 %", "236 %"]
    assert words.seconds(float("nan")) == "never"


def test_markdown_and_plain_rows() -> None:
    assert claims_table([ONE])[1] == ["II", "a | b", "1", "2", "not reproduced", "here", "10 %"]
    lines = as_markdown([ONE]).split("\n")
    assert lines[1] == "| --- | --- | --- | --- | --- | --- | --- |"
    assert lines[2] == "| II | a \\| b | 1 | 2 | not reproduced | here | 10 % |"


def test_no_claims() -> None:
    assert claims_to_table([]).num_rows == 0
    assert as_markdown([]).count("\n") == 1


def test_writes_between_the_markers_and_nowhere_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "claims", lambda: [ONE])
    page = tmp_path / "page.md"
    page.write_text("# Träger\n<!-- claims: begin -->\nold\n<!-- claims: end -->\nrest\n", encoding="utf-8")
    for _ in range(2):  # writing it again changes nothing
        assert main([str(page)]) == 0
        assert page.read_text(encoding="utf-8") == (
            f"# Träger\n<!-- claims: begin -->\n\n{as_markdown([ONE])}\n\n<!-- claims: end -->\nrest\n"
        )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<!-- claims: begin -->",
        "<!-- claims: end --> <!-- claims: begin -->",
        2 * "<!-- claims: begin -->\n<!-- claims: end -->",
    ],
)
def test_refuses_a_document_without_the_markers(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    assert main([str(page)]) == 2
    assert "claims: begin" in capsys.readouterr().err
    assert page.read_text(encoding="utf-8") == text
    with pytest.raises(InputError):
        with_table(text, "table")


@pytest.mark.parametrize("arguments", [[], ["a.md", "b.md"], ["absent.md"]])
def test_refuses_wrong_arguments(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err
