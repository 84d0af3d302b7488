import numpy as np
import pandas as pd
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.split import split_of

logs = st.lists(st.sampled_from("abcdefgh"), min_size=1, max_size=60).map(pd.Series)


@given(logs, st.floats(0, 0.999), st.integers(0, 50))
@settings(max_examples=25)
def test_no_log_is_in_both_and_the_nearest_whole_number_of_them_is_held_out(log_id, share, seed):
    split = split_of(log_id, share, seed)
    train, validation = (set(log_id[split == name]) for name in ("train", "validation"))
    assert not train & validation
    assert train | validation == set(log_id)
    assert len(validation) == min(round(share * log_id.nunique()), log_id.nunique() - 1)


@given(logs, st.integers(0, 50))
@settings(max_examples=10)
def test_the_order_of_the_rows_does_not_matter(log_id, seed):
    shuffled = log_id.sample(frac=1, random_state=0)
    split = split_of(shuffled, 0.5, seed)
    np.testing.assert_array_equal(split_of(log_id, 0.5, seed), split.sort_index())


@given(logs, st.sampled_from("abcdefgh"), st.integers(0, 50))
@settings(max_examples=25)
def test_a_log_that_a_rule_took_changes_nothing_for_the_others(log_id, gone, seed):
    every = [*log_id.unique(), gone]
    left = log_id[log_id != gone].reset_index(drop=True)
    whole = split_of(pd.concat([log_id, pd.Series([gone])], ignore_index=True), 0.5, seed)[: len(log_id)]
    expected = whole[log_id != gone].reset_index(drop=True)
    found = split_of(left, 0.5, seed, every)
    if len(left) and (expected == "validation").all():  # nothing else is left: then it is for training
        assert (found == "train").all()
    else:
        assert found.tolist() == expected.tolist()
