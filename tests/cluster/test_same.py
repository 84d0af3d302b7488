import copy
import re

import pytest

from maglev_offline.cluster.same import check
from maglev_offline.errors import InputError


class Heard:
    def __init__(self):
        self.warnings = []

    def warn(self, text):
        self.warnings.append(text)


@pytest.fixture
def heard():
    return Heard()


@pytest.fixture
def asked(tmp_path, heard):
    """Check a cluster of two workers, one of which answers what `change` makes of the truth."""
    log = tmp_path / "logs/a.mcap"
    log.parent.mkdir()
    log.write_bytes(b"abc")

    def run(change):
        def ask(look):
            assert re.fullmatch(r"\.seen\.[0-9a-f]{8}\.draft", look.word_file.name), "a name that is swept away"
            good = look()
            other = copy.deepcopy(good)
            return {"one": good, "other": change(other) or other}

        check(ask, tmp_path, (log,), heard)
        return heard.warnings

    return run


def test_workers_that_see_the_same_with_the_same_code_are_taken_and_nothing_is_left_behind(asked, tmp_path):
    assert asked(lambda found: None) == []
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


def test_a_worker_that_does_not_see_the_workspace_is_refused(asked, tmp_path):
    with pytest.raises(InputError, match=rf"worker other: it does not see the workspace {tmp_path}\..*CACHE"):
        asked(lambda found: found.update(word=""))


@pytest.mark.parametrize("size", [-1, 4])
def test_a_worker_that_does_not_see_a_log_or_sees_another_is_refused(asked, tmp_path, size):
    with pytest.raises(InputError, match=r"does not see the log .*a\.mcap"):
        asked(lambda found: found.update(logs={str(tmp_path / "logs/a.mcap"): size}))


def test_another_maglev_offline_is_refused(asked):
    with pytest.raises(InputError, match=r"it has maglev-offline 0\.0\.1 and Python .*Install the same versions"):
        asked(lambda found: found["versions"].update({"maglev-offline": "0.0.1"}))


def test_another_python_is_refused(asked):
    with pytest.raises(InputError, match=r"and Python 3\.1, and this machine"):
        asked(lambda found: found.update(python="3.1.4"))


def test_a_worker_that_cannot_look_has_no_maglev_offline(asked):
    with pytest.raises(InputError, match=r"ModuleNotFoundError: No module named 'maglev_offline'\).*Install"):
        asked(lambda found: ModuleNotFoundError("No module named 'maglev_offline'"))


def test_other_packages_and_instructions_are_warned_of(asked):
    def other(found):
        found["versions"]["numpy"] = "1.0"
        found["computes"] = "avx1024"

    (warning,) = asked(other)
    assert "worker other has numpy 1.0 instead of" in warning
    assert "another native engine (avx1024)" in warning
    assert "may differ in the last bits" in warning


def test_a_cluster_without_workers_is_refused(tmp_path, heard):
    with pytest.raises(InputError, match="no workers"):
        check(lambda look: {}, tmp_path, (), heard)
