import pickle

import pytest

from maglev_offline import errors
from maglev_offline.errors import MaglevOfflineError

KINDS = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, MaglevOfflineError)]


@pytest.mark.parametrize(
    ("where", "todo", "paragraph"),
    [
        ("a.mcap", "Copy it again.", "a.mcap: it is cut. Copy it again."),
        ("", "Copy it again.", "it is cut. Copy it again."),
        ("a.mcap", "", "a.mcap: it is cut."),
        ("", "", "it is cut."),
    ],
)
def test_an_error_is_one_paragraph_of_where_what_and_what_to_do(where, todo, paragraph):
    error = MaglevOfflineError("it is cut.", where=where, todo=todo)
    assert error.paragraph() == str(error) == paragraph


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_survives_the_way_back_from_a_worker(kind):
    back = pickle.loads(pickle.dumps(kind("what.", where="where", todo="todo.")))
    assert type(back) is kind
    assert (back.what, back.where, back.todo) == ("what.", "where", "todo.")


def test_bad_input_ends_with_2_and_a_failure_of_ours_with_1():
    assert {kind.__name__: kind.exit_code for kind in KINDS} == {
        "MaglevOfflineError": 1,
        "WorkspaceLocked": 1,
        "InputError": 2,
        "RecipeError": 2,
        "LogError": 2,
        "ArtefactError": 2,
    }
