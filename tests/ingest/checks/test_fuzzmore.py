"""Whatever is in a log, the checks come to an end without an exception."""

import numpy as np
import pytest
from hypothesis import Phase, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from maglev_offline.logs.columns import NO_TIME

_N = 40
# What the reader can give: times from 1970 to 2262 or none. A stamp inside the messages may be anything.
times = arrays.arrays(np.int64, _N, elements=st.integers(0, 2**63 - 1) | st.integers(0, 10**10) | st.just(NO_TIME))
stamps = arrays.arrays(np.int64, _N, elements=st.integers(-(2**63), 2**63 - 1) | st.integers(0, 10**10))
numbers = arrays.arrays(np.int64, _N, elements=st.integers(0, 2**32 - 1) | st.integers(0, 50))
values = arrays.arrays(np.float64, _N, elements=st.floats(allow_nan=True) | st.sampled_from([0.0, 0.008, 17.0]))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@hypothesis_settings(deadline=None, max_examples=300, phases=(Phase.generate,))
@given(log=times, publish=times, stamp=stamps, sequence=numbers, gap=values, current=values)
def test_any_topic_can_be_checked(checked, topics, log, publish, stamp, sequence, gap, current):
    columns = topics.columns(_N, log_time_ns=log, publish_time_ns=publish, sequence=sequence, clock_ns=stamp)
    columns.values.update(gap=gap, current=current)
    for findings in checked(columns).values():
        for finding in findings:
            assert finding.plain()["what"]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@hypothesis_settings(deadline=None, max_examples=300, phases=(Phase.generate,))
@given(gap=values, current=values, voltage=values, cut=st.integers(0, _N))
def test_any_point_can_be_checked(samples, point_codes, gap, current, voltage, cut):
    segment = (np.arange(_N) >= cut).astype(int)
    point_codes(samples(gap=gap, current=current, voltage=voltage, velocity=gap, segment=segment))
