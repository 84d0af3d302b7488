"""The C header is compiled and asked: the arithmetic that leaves the house is that of the policy."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from maglev_offline.policies.c_header import as_c_header
from maglev_offline.policies.policy import Policy, metadata

STRICT = ("-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow")
COMPILERS = {
    "c99": ("cc", "-std=c99", "c"),
    "c++11": ("g++", "-std=c++11", "cpp"),
    "c++17": ("g++", "-std=c++17", "cpp"),
}

PROGRAM = """
#include "policy.h"
#include <stdio.h>
int main(void)
{
    double state[3], voltage_v;
    while (fread(state, sizeof(double), 3, stdin) == 3) {
        voltage_v = maglev_policy_voltage(state[0], state[1], state[2]);
        fwrite(&voltage_v, sizeof(double), 1, stdout);
    }
    return MAGLEV_POLICY_CONTROL_PERIOD_S > 0.0 ? 0 : 1;
}
"""


@pytest.fixture(params=COMPILERS)
def ask(request, tmp_path):
    """Compile the header of a policy, and get its voltages for states."""
    compiler, standard, ending = COMPILERS[request.param]
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no compiler {compiler} here")

    def run(policy, states):
        (tmp_path / "policy.h").write_text(as_c_header(policy))
        source = tmp_path / f"main.{ending}"
        source.write_text(PROGRAM)
        command = [compiler, standard, *STRICT, str(source), "-o", str(tmp_path / "main"), "-lm"]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        assert built.returncode == 0, built.stderr
        given = np.stack(states, axis=1).astype(np.float64).tobytes()
        return np.frombuffer(subprocess.run([tmp_path / "main"], input=given, capture_output=True, check=True).stdout)

    return run


def test_the_compiled_header_gives_the_voltages_of_the_policy(ask, policy, states):
    np.testing.assert_allclose(ask(policy, states), policy.voltage(*states), rtol=1e-12, atol=1e-9)


def test_a_state_that_is_not_finite_gives_the_voltage_of_the_equilibrium(ask, policy, not_finite):
    assert set(ask(policy, not_finite)) == {policy.plant.equilibrium().voltage_v}


def test_an_unused_header_and_one_in_two_files_of_a_program_compile_too(policy, tmp_path):
    if shutil.which("cc") is None:
        pytest.skip("there is no compiler cc here")
    (tmp_path / "policy.h").write_text(as_c_header(policy))
    (tmp_path / "other.c").write_text(
        '#include "policy.h"\n#include "policy.h"\nint other(void);\nint other(void) { return 0; }\n'
    )
    (tmp_path / "main.c").write_text(PROGRAM)
    command = ["cc", "-std=c99", *STRICT, "main.c", "other.c", "-o", "main", "-lm"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr


def test_every_weight_reads_back_exactly(policy):
    text = as_c_header(policy)
    written = [np.float32(number) for number in re.findall(r"(-?\d[\d.e+-]*)f\b", text)]
    expected = np.concatenate([part.ravel() for layer in policy.layers for part in layer])
    assert np.array_equal(np.array(written, dtype=np.float32), expected)
    assert "-ffast-math" in text


def test_the_comment_tells_all_and_cannot_be_ended_by_what_it_tells(policy):
    hostile = Policy(policy.net, policy.plant, policy.mdp, policy.origin._replace(arm="x */ int y; /* z"))
    text = as_c_header(hostile)
    comment = text[: text.index("#ifndef")]
    assert comment.count("*/") == comment.count("/*") == 1
    assert all(f" * {name}: " in comment for name in metadata(policy))
    assert f" * plant: {metadata(policy)['plant']}" in comment
    assert as_c_header(policy) == as_c_header(policy)
