"""What the benchmark of training hands to those whom it times."""

import numpy as np
import training_peers

from maglev_offline.replay.prefill import load_prefill, packed
from maglev_offline.workspace import Workspace


def test_the_made_up_prefill_is_one_that_training_takes(tmp_path):
    home = training_peers._made_up_prefill(Workspace(tmp_path), "td3", 40)
    np.testing.assert_array_equal(packed(load_prefill(home)), training_peers.packed_rows(40))
