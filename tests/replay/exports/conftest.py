"""A prefill of a hundred rows in a workspace, and its columns."""

import pytest

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.exports.rows import as_rows
from maglev_offline.replay.exports.stage import FORMS
from maglev_offline.replay.prefill import scaled


@pytest.fixture(scope="session")
def columns(transitions):
    """The native columns; rows 24, 49, 74 and 99 are terminated."""
    return scaled(transitions, Mdp())


@pytest.fixture(scope="session")
def semi_markov(transitions):
    """Rows that span ten control periods each."""
    table = transitions.assign(discount=Mdp().discount ** 10 * ~transitions["terminated"])
    return as_rows(scaled(table, Mdp()), "semi_markov", Plant(), Mdp())


@pytest.fixture(scope="session")
def rows(columns):
    return as_rows(columns, "raw", Plant(), Mdp())


@pytest.fixture
def written(rows, tmp_path):
    """Write the rows in a form, and return the folder."""

    def write(name, these=rows):
        folder = tmp_path / name
        folder.mkdir()
        FORMS[name].write(these, folder)
        return folder

    return write
