"""The doctor as people and scripts call it. What each check says is in tests/doctor."""

import subprocess
import sys

import pytest

from maglev_offline.agents.native_library import availability
from maglev_offline.doctor import examination
from maglev_offline.doctor.trial import Found, Native, Torch, Trained

WELL = Found(
    Native(True, "avx2, gcc", "avx2", "gcc", [("avx2", True)]), Torch("2.13.0", 1, None), Trained("native", "fast", 0.0)
)

CODES = ["cores", "dependency", "disk", "extra", "lock", "locking", "memory", "native", "package", "python", "recipe",
         "system", "torch", "training", "workspace"]  # fmt: skip


@pytest.fixture
def doctor(call, tmp_path, monkeypatch):
    """Run the doctor in an empty folder; the trial of the engines, which takes seconds, finds what it is told."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments, found=WELL):
        monkeypatch.setattr(examination.examine, "__defaults__", (lambda choice: found,))
        return call("doctor", *arguments)

    return run


def test_where_all_is_well_the_exit_code_is_0_and_nothing_is_left_behind(doctor, tmp_path):
    done = doctor()
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines()[-1] == "Nothing stands in the way of the whole road."
    assert list(tmp_path.iterdir()) == []


def test_scripts_get_every_check_by_its_code(doctor):
    found = doctor("--json").json
    assert sorted({check["code"] for check in found["checks"]} - {"versions"}) == CODES
    assert found["worst"] in ("ok", "note")


def test_a_problem_ends_in_exit_code_2_and_says_what_to_do(doctor):
    done = doctor("--quiet", found=WELL._replace(trained="it learned nothing."))
    assert done.code == 2
    assert "problem  a short training: it learned nothing.\n         Mend what is above." in done.out
    assert not any(line.startswith("ok") for line in done.out.splitlines())


def test_a_recipe_that_asks_for_the_missing_kernel_makes_it_a_problem(doctor, tmp_path):
    (tmp_path / "native.toml").write_text('[training]\nengine = "native"\n')
    missing = WELL._replace(native=Native(False, "the kernel is not built", None, None, []))
    assert doctor(found=missing).code == 0
    assert doctor("--recipe", "native.toml", found=missing).code == 2


def test_the_trial_runs_in_a_process_of_its_own(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    checks = {check["code"]: check for check in call("doctor", "--json").json["checks"]}
    assert checks["training"]["state"] == "ok"
    assert checks["training"]["facts"]["engine"] == ("native" if availability()[0] else "torch")


def test_a_package_that_is_missing_is_told_in_words(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "maglev_offline.logs.surrogate", None)
    assert "a failure of maglev-offline itself" in call("surrogate", "logs").err
    monkeypatch.delitem(sys.modules, "maglev_offline.logs.surrogate")
    for name in [name for name in sys.modules if name.startswith("maglev_offline.logs.surrogate")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "numpy", None)
    done = call("surrogate", "logs")
    assert done.code == 2
    assert "the package numpy is not here" in done.err
    assert "`maglev-offline doctor`" in done.err


@pytest.mark.parametrize("package", ["typer", "rich.console"])
def test_without_the_packages_of_the_command_line_itself_there_is_no_traceback(package):
    script = (
        f"import sys; sys.modules[{package!r}] = None; sys.argv = ['maglev-offline', 'doctor', '-w', '/dev/null/x']"
    )
    script += "\nfrom maglev_offline.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: the package {package} is not here.")
    assert "Traceback" not in done.stderr
