"""Tables that a document keeps between markers."""

import pytest

from maglev_offline.errors import InputError
from maglev_offline.markdown import table_of, with_block


def test_a_bar_in_a_cell_ends_no_cell():
    assert table_of(["a", "b"], [["x|y", "2"]]) == "| a | b |\n| --- | --- |\n| x\\|y | 2 |"


def test_a_block_takes_the_place_of_the_one_before():
    text = "# Title\n<!-- a: begin -->\n\nold\n\n<!-- a: end -->\nrest\n"
    once = with_block(text, "a", "new")
    assert once == "# Title\n<!-- a: begin -->\n\nnew\n\n<!-- a: end -->\nrest\n"
    assert with_block(once, "a", "new") == once


@pytest.mark.parametrize(
    "text", ["nothing", "<!-- a: end --> <!-- a: begin -->", "<!-- a: begin --><!-- a: begin --><!-- a: end -->"]
)
def test_a_document_without_its_markers_is_refused(text):
    with pytest.raises(InputError, match="once each"):
        with_block(text, "a", "new", "doc.md")
