"""Tests of the parts of a record, which depend on the record alone, and of their windows."""

from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record, concat
from identification.deciding import MOST_PARTS
from identification.diagnosis import diagnose
from identification.diagnosis.log import checking
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.log.parts import block_numbers, excerpts, in_equal_times, parts_of, windows_of
from identification.experiments.missions import run_mission
from identification.fit.windows import LEAST_SAMPLES, stretches_of
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
    assert sum(len(part) for part in parts) == MOST_PARTS + 1  # one of them spans the gap, in two pieces


def test_no_part_gets_a_piece_of_a_few_samples():
    """A stretch of one sample has no second one by which a fit could see whether its start still matters."""
    record = Record.from_arrays(np.arange(200.0), {"heading_rad": np.zeros(200)})
    for gap in range(1, 100):
        stretches = [slice(0, gap + LEAST_SAMPLES), slice(gap + 2 * LEAST_SAMPLES, 200)]
        parts = in_equal_times(record, stretches, MOST_PARTS)
        pieces = [piece for part in parts for piece in part]
        assert min(piece.stop - piece.start for piece in pieces) >= LEAST_SAMPLES
        assert sorted(rows_of(pieces)) == rows_of(stretches)
        lengths = [len(rows_of(part)) for part in parts]
        assert max(lengths) - min(lengths) <= 2 * LEAST_SAMPLES


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


def test_of_a_long_log_the_stretch_of_each_part_counts_in_which_the_commands_move_most(record):
    rudder = 0.01 * np.ones(len(record))
    parts = parts_of(QUICK, record)
    moved = [part[0].start + 25 for part in parts]
    for k in moved:
        rudder[k : k + 4] = 0.2
    found = excerpts(record.with_channels({"rudder_rad": rudder}), parts, ("rudder_rad", "u_mps"), 20)
    for (piece,), (whole,), k in zip(found, parts, moved, strict=True):
        assert piece.start <= k < piece.stop
        assert piece.stop - piece.start <= 20
        assert whole.start <= piece.start < piece.stop <= whole.stop


def test_of_several_long_logs_a_stretch_of_each_counts(record):
    both = concat([record.with_labels([name] * len(record.segments)) for name in "ab"])
    half = len(record)
    part = (slice(10, half - 10), slice(half + 10, 2 * half - 10))
    ((first, second),) = excerpts(both, [part], ("rudder_rad",), 40)
    assert part[0].start <= first.start < first.stop <= part[0].stop
    assert part[1].start <= second.start < second.stop <= part[1].stop
    assert first.stop - first.start == second.stop - second.start == 20


def test_fits_count_a_share_of_a_long_log_and_free_runs_all_of_it(record, monkeypatch):
    log = check_log(record, QUICK, Asked())
    assert log.in_brief() is log
    states, rows = len(QUICK.family.states), len(rows_of(p for part in log.parts for p in part))
    monkeypatch.setattr(checking, "MOST_FOLLOWED", states * rows // 2)
    brief = log.in_brief()
    counted = rows_of(p for part in brief.parts for p in part)
    assert 0.4 * rows < len(counted) <= 0.5 * rows
    assert len(brief.parts) == len(log.parts)
    assert brief.windows == log.windows
    assert "the fits count" in brief.record.notes[-1]


@pytest.mark.parametrize("found", [True, False])
def test_what_a_share_of_a_long_log_does_not_show_is_sought_in_all_of_it(record, monkeypatch, found):
    steps = import_module("identification.diagnosis.diagnose")
    whole, counted = check_log(record, QUICK, Asked()), []
    monkeypatch.setattr(checking, "MOST_FOLLOWED", 100 * len(QUICK.family.states))
    monkeypatch.setattr(steps, "fit_known", lambda log, progress: counted.append(log.parts))
    state = object()
    searched = SimpleNamespace(nominal=state, state=object() if found else state)
    monkeypatch.setattr(steps, "search_effects", lambda log, known, progress: searched)
    judged = []

    def judge(log, searched, source, progress):
        judged.append(log.parts)
        raise StopIteration

    monkeypatch.setattr(steps, "judge", judge)
    with pytest.raises(StopIteration):
        diagnose(record, QUICK)
    lengths = [len(rows_of(p for part in parts for p in part)) for parts in counted]
    assert lengths[0] <= 100
    assert judged == [counted[-1]]
    assert len(counted) == (1 if found else 2)
    assert found or counted[-1] == whole.parts
