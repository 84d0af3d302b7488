import pytest
from pydantic import ValidationError

from maglev_offline.curate.settings import CurateSettings


def test_rows_are_the_papers_and_all_of_them_are_kept_unless_the_recipe_says_otherwise():
    assert CurateSettings().construction == "raw"
    assert CurateSettings().consistent_fraction is None
    assert CurateSettings().balance == "cells"
    assert CurateSettings().include == CurateSettings().exclude == ()


@pytest.mark.parametrize("fraction", [0.0, -0.1, 1.01])
def test_a_fraction_is_above_0_and_at_most_1(fraction):
    with pytest.raises(ValidationError, match="consistent_fraction"):
        CurateSettings(consistent_fraction=fraction)


def test_a_filter_that_could_find_nothing_is_refused():
    with pytest.raises(ValidationError, match="all agree with it"):
        CurateSettings(construction="simulated_next", consistent_fraction=0.5)
