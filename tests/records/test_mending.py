"""What is said of samples that are dropped."""

import numpy as np
import pytest

from auv_gym.records.mending import on_dropped


@pytest.mark.parametrize(
    "lost, words", [(1, "1 of 50 samples (2 %) was dropped, "), (2, "2 of 50 samples (4 %) were ")]
)
def test_one_sample_was_dropped_and_several_were(lost, words):
    missing = np.arange(50) < lost
    heading = np.where(missing, np.nan, 0.1)
    (line,) = on_dropped({"heading_rad": (("time_s",), heading, {})}, missing)
    assert line.startswith(words)


@pytest.mark.parametrize(
    "lost, ends",
    [
        ([0], "no value, at the beginning or end of the record."),
        ([48, 49], "no value, at the beginning or end of the record."),
        ([0, 20], "no value; the record is cut there."),
    ],
)
def test_a_record_is_cut_only_where_samples_inside_it_are_dropped(lost, ends):
    missing = np.isin(np.arange(50), lost)
    heading = np.where(missing, np.nan, 0.1)
    (line,) = on_dropped({"heading_rad": (("time_s",), heading, {})}, missing)
    assert line.endswith(ends)
