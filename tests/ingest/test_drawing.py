"""Draws of samples: pieces of segments, the same for the same seed, like the whole, and no row twice."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.drawing import PIECE, drawn_samples
from maglev_offline.ingest.points import PointSamples
from maglev_offline.ingest.samples import SAMPLES, load_samples, open_samples, table

PLACE = ["log_id", "point", "segment", "step"]


def samples_of(point, segments):
    """A point whose segments have so many samples; the gap counts them."""
    rows = sum(segments)
    count = np.arange(rows, dtype=np.float64)
    names = ("gap_m", "gap_velocity_m_s", "current_a", "voltage_v")
    return PointSamples(
        point=point,
        t_ns=np.arange(rows) * 100_000_000,
        segment=np.repeat(np.arange(len(segments)), segments).astype(np.int32),
        step=np.concatenate([np.arange(n) for n in segments] or [[]]).astype(np.int32),
        values=dict.fromkeys((*names, "set_point_m"), count),
        origins=dict.fromkeys(names, np.zeros(rows, dtype=np.int8)),
        contact=np.zeros(rows, dtype=bool),
        grid_rows=rows,
        entries=[],
        within={},
        used={},
    )


def written(home, logs):
    """An artefact of samples for each log: a mapping from its points to the lengths of their segments."""
    folders = []
    for log, points in logs.items():
        folder = home / log
        folder.mkdir(exist_ok=True)
        with open_samples(folder / SAMPLES, ()) as sink:
            for point, segments in points.items():
                sink.write(table(log, samples_of(point, segments), tuple(points), ()))
        folders.append(folder)
    return folders


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    home = tmp_path_factory.mktemp("samples")
    return written(home, {"a": {"P1": [3000, 50, 1300], "P2": [2000]}, "b": {"P1": [], "P3": [5000]}, "c": {"P1": []}})


ALL = 3000 + 50 + 1300 + 2000 + 5000


def test_what_fits_is_taken_whole(folders):
    drawn = drawn_samples(folders, ALL, seed=0)
    pd.testing.assert_frame_equal(drawn.samples, load_samples(folders))
    assert (drawn.there, drawn.left) == (ALL, 0)


@settings(max_examples=10, deadline=None)
@given(most=st.integers(PIECE, ALL - 1), seed=st.integers(0, 99))
def test_a_draw_is_of_whole_pieces_and_of_no_row_twice(folders, most, seed):
    drawn = drawn_samples(folders, most, seed)
    assert most - PIECE < len(drawn.samples) <= most
    assert drawn.left == ALL - len(drawn.samples)
    assert not drawn.samples.duplicated(PLACE).any()
    whole = load_samples(folders).set_index(PLACE)
    found = drawn.samples.set_index(PLACE)
    pd.testing.assert_frame_equal(found, whole.loc[found.index])
    pieces = drawn.samples.assign(piece=drawn.samples["step"] // PIECE).groupby([*PLACE[:3], "piece"]).size()
    there = whole.reset_index().assign(piece=lambda rows: rows["step"] // PIECE).groupby([*PLACE[:3], "piece"]).size()
    assert (pieces == there.loc[pieces.index]).all()


def test_a_draw_depends_on_the_seed_alone(folders):
    one, again, other = (drawn_samples(folders, 4000, seed).samples for seed in (3, 3, 4))
    pd.testing.assert_frame_equal(one, again)
    assert not one[PLACE].equals(other[PLACE])


@pytest.mark.parametrize("short", [[2 * PIECE], [100] * 12], ids=["as long pieces", "many short ones"])
def test_every_piece_has_the_same_chance(tmp_path, short):
    """Of two logs, one ten times as long, the draws of many seeds hold ten rows of it to one of the other."""
    folders = written(tmp_path, {"long": {"P": [20 * PIECE]}, "short": {"P": short}})
    share = [(drawn_samples(folders, 6 * PIECE, seed).samples["log_id"] == "long").mean() for seed in range(60)]
    assert np.mean(share) == pytest.approx(10 / 11, abs=0.05)


def test_a_file_that_is_no_table_is_told(folders, tmp_path):
    (tmp_path / SAMPLES).write_bytes(b"no table")
    with pytest.raises(ArtefactError, match="the samples cannot be read"):
        drawn_samples([*folders, tmp_path], 1000, seed=0)
