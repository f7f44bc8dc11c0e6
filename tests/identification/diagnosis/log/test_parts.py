"""Parts of a record that follow from the record alone, and the windows in them."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record, concat
from identification.deciding import MOST_PARTS
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.log.parts import block_numbers, parts_of, windows_of
from identification.experiments.missions import run_mission
from identification.fit.windows import stretches_of
from tests.identification.gliders import QUICK


def rows_of(pieces) -> list[int]:
    return [k for piece in pieces for k in range(piece.start, piece.stop)]


@pytest.fixture(scope="module")
def record() -> Record:
    return run_mission(QUICK, np.random.default_rng(0), duration=1200.0)


def test_parts_share_out_every_row_that_a_filter_goes_through(record):
    parts = parts_of(QUICK, record)
    assert len(parts) == MOST_PARTS
    assert sorted(rows_of(p for part in parts for p in part)) == rows_of(stretches_of(QUICK, record))
    lengths = [len(rows_of(part)) for part in parts]
    assert max(lengths) - min(lengths) <= 1


def test_time_that_nothing_was_logged_in_is_no_ones_part(record):
    gap = concat([record.select(record.time <= 300.0), record.select(record.time > 300.0)])
    assert len(gap.segments) == 2
    parts = parts_of(QUICK, gap)
    lengths = [len(rows_of(part)) for part in parts]
    assert max(lengths) - min(lengths) <= 3
    assert sum(len(part) for part in parts) == MOST_PARTS + 1  # one of them goes over the gap, in two pieces


def test_windows_are_of_one_length_within_their_part_and_short_ones_only_where_there_are_no_others(record):
    (piece,) = parts_of(QUICK, record)[2]
    windows = windows_of(record, (piece,), 120.0)
    lengths = [w.stop - w.start for w in windows]
    assert rows_of(windows) == rows_of([piece])
    assert max(lengths) - min(lengths) <= 1
    assert all(60.0 <= np.ptp(record.time[w]) <= 120.0 for w in windows)
    short = slice(piece.start, piece.start + 12)
    assert windows_of(record, (piece, short), 120.0) == windows
    assert windows_of(record, (short,), 120.0) == (short,)


def test_dives_with_an_unknown_of_their_own_stay_whole():
    plant = load_vehicle("mermaid")
    channels = {"depth_m": np.linspace(20.0, 1200.0, 200)} | {name: np.zeros(200) for name in plant.family.required}
    dives = concat([Record.from_arrays(60.0 * np.arange(200.0), channels)] * 8)
    parts = parts_of(plant, dives)
    assert len(parts) == MOST_PARTS
    whole = [
        {int(np.searchsorted([s.start for s in dives.segments], k, side="right")) for k in rows_of(p)} for p in parts
    ]
    assert [len(own) for own in whole] == [2, 2, 1, 1, 1, 1]
    assert set.union(*whole) == set(range(1, 9))


def test_blocks_are_numbered_by_time_without_what_lies_between_stretches():
    time = np.r_[0.0:10.0, 100.0:110.0]
    record = Record.from_arrays(time, {"heading_rad": np.zeros(20)})
    assert block_numbers(record, [slice(0, 10), slice(10, 20)], 2).tolist() == [0] * 10 + [1] * 10


def test_parts_are_the_same_for_long_windows_and_for_short_ones(record):
    short, long = (check_log(record, QUICK, Asked(window=seconds)) for seconds in (60.0, 150.0))
    assert short.parts == long.parts
    assert len(short.every_window) > len(long.every_window)
    assert [len(own) for own in long.windows] == [2] * MOST_PARTS
