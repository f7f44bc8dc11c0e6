"""Tests of several logs of one vehicle, and of effects in only some of them."""

import json
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym import concat, load_vehicle, replace_at
from auv_gym.param import spec_at, value_at
from auv_gym.records.record import Record
from controllers.tuning.spread import read_uncertain
from identification import closed_loop, diagnose, write_diagnosis
from identification.deciding import BLOCKS
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.log.parts import logs_in
from identification.diagnosis.log.several import in_last_log, last_log, with_own_effects
from identification.diagnosis.result_files import again, as_json
from identification.diagnosis.search.candidates import Candidate, candidates_of
from identification.diagnosis.search.constancy import _sixths, steadiness
from identification.diagnosis.search.explanations import meaning
from identification.diagnosis.search.workbench import Workbench
from identification.fit.changing import change
from identification.planning.next_experiment import rivals_of

OFFSET = "effects.rudder.offset"


def logs_of(*sizes: float, duration: float = 600.0) -> Record:
    """Logs of a glider, each with a rudder offset of its own."""
    plant = load_vehicle("slocum")
    bent = [replace_at(plant, OFFSET, size) for size in sizes]
    own = [closed_loop(one, rng=np.random.default_rng(70 + k), duration=duration) for k, one in enumerate(bent)]
    return concat([one.with_labels([f"log{k}.csv"] * len(one.segments)) for k, one in enumerate(own)])


def test_a_log_is_what_has_one_label_and_else_a_number():
    record = logs_of(0.0, 0.0, duration=100.0)
    gap = np.ones(len(record), bool)
    gap[5] = False
    assert [(one.name, one.rows.stop) for one in logs_in(record.select(gap))] == [
        ("log0.csv", len(record) // 2 - 1),
        ("log1.csv", len(record) - 1),
    ]
    assert logs_in(record.with_labels(["", "b"]))[0].name == "log 1"
    assert [one.name for one in logs_in(record.with_labels(["7", "b"]))] == ["log 7", "b"]  # dives are often numbers


def test_each_part_has_a_share_of_each_log_and_windows_stay_within_it():
    plant = load_vehicle("slocum")
    log = check_log(logs_of(0.0, 0.0, 0.0), plant, Asked(trust=True))
    own = with_own_effects(log, [OFFSET])
    rows = [one.rows for one in logs_in(log.record)]
    for part, windows in zip(own.parts, own.windows, strict=True):
        assert all(any(r.start <= p.start < r.stop for p in part) for r in rows)
        assert all(any(p.start <= w.start and w.stop <= p.stop for p in part) for w in windows)
    assert [c.name for c in own.plant.courses.values()] == [
        "in log0.csv", "in log1.csv", "in log2.csv", "from log1.csv on", "up to log1.csv",
    ]  # fmt: skip
    alone = check_log(logs_of(0.0, duration=300.0), plant, Asked(trust=True))
    assert with_own_effects(alone, [OFFSET]) is None


def test_candidates_are_those_of_all_logs_and_of_some_and_neither_hides_the_other():
    log = check_log(logs_of(0.0, 0.0), load_vehicle("slocum"), Asked(trust=True))
    paths = [OFFSET, "effects.current.north", "effects.current.east"]
    plant = with_own_effects(log, paths).plant
    every = {c.paths: c.title for c in candidates_of(plant, log.record)}
    assert every[(OFFSET,)] == "rudder offset"
    assert every[(change("log2", OFFSET),)] == "rudder offset in log1.csv"
    assert (change("log1", paths[1]), change("log1", paths[2])) in every
    for found in (OFFSET, change("log2", OFFSET)):
        left = {c.paths for c in candidates_of(replace_at(plant, found, 0.05), log.record)}
        assert set(every) - left == {(found,)}


def test_an_effect_of_some_logs_stays_within_the_bounds_of_one_of_all():
    """Nothing changes beyond the bounds, so that a fit would continue for ever."""
    log = check_log(logs_of(0.0, 0.0), load_vehicle("slocum"), Asked(trust=True))
    gain, deadband = "effects.rudder.gain", "effects.rudder.deadband"
    plant = with_own_effects(log, [gain, deadband]).plant
    for path in (gain, deadband):
        low, high = spec_at(plant, path).bounds
        neutral = spec_at(plant, path).neutral
        assert spec_at(plant, change("log1", path)).bounds == (low - neutral, high - neutral)


def test_the_vehicle_that_is_written_is_that_of_the_last_log():
    log = check_log(logs_of(0.0, 0.0), load_vehicle("slocum"), Asked(trust=True))
    plant = replace_at(with_own_effects(log, [OFFSET]).plant, {OFFSET: 0.02, change("log2", OFFSET): 0.03})
    assert value_at(in_last_log(plant, log.record), OFFSET) == pytest.approx(0.05)
    assert value_at(plant.at_row(0), OFFSET) == pytest.approx(0.02)
    assert in_last_log(log.plant, log.record) is log.plant
    record, name = last_log(plant, log.record)
    assert (name, len(record), record.time[0]) == (
        "log1.csv",
        len(log.record) // 2,
        log.record.time[len(log.record) // 2],
    )
    assert last_log(log.plant, log.record) == (log.record, "the log")


@pytest.mark.parametrize("begins, varies", [(0.0, False), (0.5, True)])
def test_an_effect_of_one_log_is_compared_with_itself_within_that_log(begins, varies):
    """The first log has no effect; in the second the effect acts throughout, or begins half-way."""
    plant = load_vehicle("slocum")
    first, last = logs_of(0.0), logs_of(0.06)
    if begins:
        early = closed_loop(plant, rng=np.random.default_rng(77), duration=300.0)
        late = closed_loop(replace_at(plant, OFFSET, 0.06), rng=np.random.default_rng(78), duration=300.0)
        last = concat([early, late])
    last = last.with_labels(["b"] * len(last.segments))
    own = with_own_effects(check_log(concat([first, last]), plant, Asked(trust=True)), [OFFSET])
    path = change("log2", OFFSET)
    bench = Workbench(own.plant, own.record, own.parts, 0.1, own.every_window)
    state = bench.fit(bench.plant, (*plant.coefficients, path))
    assert steadiness(bench, state, [path]).varies == varies


def test_a_log_that_differs_from_three_others_does_not_vanish_among_sixths():
    """Its first log is a quarter of the record, so that the second sixth holds equal parts of the first two logs."""
    plant = load_vehicle("slocum")
    log = check_log(logs_of(0.02, 0.05, 0.05, 0.05), plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    assert steadiness(bench, bench.fit(bench.plant, (*plant.coefficients, OFFSET)), [OFFSET]).varies


def test_two_ways_to_say_the_same_are_one_explanation():
    log = check_log(logs_of(0.0, 0.0), load_vehicle("slocum"), Asked(trust=True))
    plant = with_own_effects(log, [OFFSET, "effects.yaw.moment"]).plant

    def said(*paths: str):
        return meaning(plant, [Candidate(path, (path,)) for path in paths])

    first, second = (change(f"log{k}", OFFSET) for k in (1, 2))
    assert said(OFFSET, first) == said(first, second) == said(second, OFFSET)
    assert len({said(OFFSET), said(first), said(second), said(first, second)}) == 4
    assert said(first, change("log2", "effects.yaw.moment")) != said(first, second)


@pytest.mark.slow
def test_an_effect_of_one_log_is_named_with_that_log(tmp_path):
    record = logs_of(0.0, 0.05)
    found = diagnose(record, load_vehicle("slocum"))
    (only,) = found.effects
    assert (found.verdict, only.path) == ("named", change("log2", OFFSET))
    assert abs(only.value - 0.05) < 0.002
    assert found.after.scores["heading_rad"].rmse < 0.4 * found.before.scores["heading_rad"].rmse
    assert "rudder offset in log1.csv, 2.8" in found.summary()
    assert "vehicle.toml has the vehicle as it was in the last log, log1.csv." in found.summary()
    assert rivals_of(found) == ()
    (loop,) = found.loops
    assert loop.words.startswith("In log1.csv, the controller missed its set point of heading by ")
    assert loop.after < 0.7 * loop.before
    files = write_diagnosis(found, tmp_path)
    assert value_at(load_vehicle(files["vehicle.toml"]), OFFSET) == pytest.approx(only.value)
    assert f'"{change("log2", OFFSET)}"' in files["diagnosis.json"].read_text()
    assert "log1.csv" in files["report.html"].read_text()
    assert again(files["diagnosis.json"], record).summary() == found.summary()
    uncertain = read_uncertain(load_vehicle("slocum"), files["diagnosis.json"])
    assert uncertain.intervals[OFFSET] == pytest.approx(only.ci95)
    assert value_at(uncertain.plant, OFFSET) == pytest.approx(only.value)
    assert not any(
        p.startswith("changes.") for p in json.loads(files["diagnosis.json"].read_text())["vehicle"]["units"]
    )


def test_what_was_found_is_not_lost_where_the_search_in_some_logs_fails(monkeypatch):
    def failing(log, paths):
        raise RuntimeError("no memory left")

    monkeypatch.setattr(import_module("identification.diagnosis.diagnose"), "with_own_effects", failing)
    found = diagnose(logs_of(0.0, 0.05, duration=400.0), load_vehicle("slocum"))
    assert found.verdict == "unexplained"
    (failure,) = found.failures
    assert failure.text.startswith("The search for effects of only some logs could not be made: RuntimeError")


@pytest.mark.slow
def test_an_effect_that_begins_with_a_log_is_named_from_it_on_and_one_of_all_logs_as_such():
    begins = diagnose(logs_of(0.0, 0.05, 0.05), load_vehicle("slocum"))
    assert [(e.path, e.title) for e in begins.effects] == [(change("since2", OFFSET), "rudder offset from log1.csv on")]
    assert [e.path for e in diagnose(logs_of(0.03, 0.03), load_vehicle("slocum")).effects] == [OFFSET]


@pytest.mark.slow
def test_two_sizes_of_one_effect_are_told_apart():
    found = diagnose(logs_of(0.05, 0.02), load_vehicle("slocum"))
    assert found.verdict in ("named", "tied")
    sizes = [value_at(found.after.plant.at_row(log.rows.start), OFFSET) for log in logs_in(found.record)]
    assert sizes == pytest.approx([0.05, 0.02], abs=0.002)
    told = {e["path"]: e.get("in_last_log", e) for e in as_json(found)["effects"]}
    assert told[change("log1", OFFSET)] is None
    assert told[OFFSET]["value"] == pytest.approx(0.02, abs=0.002)


@pytest.mark.parametrize("count, parts", [(1, 6), (2, 6), (4, 8), (6, 6), (9, 6)])
def test_parts_of_up_to_six_logs_begin_where_these_do(count, parts):
    rows, each = np.arange(60 * count), 60
    record = Record.from_arrays(rows.astype(float), {"heading_rad": np.zeros(rows.size)}, segment=rows // each)
    record = record.with_labels([f"dive {k}" for k in range(count)])
    blocks = rows * BLOCKS // rows.size
    bench = SimpleNamespace(record=record, problem=SimpleNamespace(rows=rows), block_of_row=blocks)
    found = _sixths(bench)  # type: ignore[arg-type]
    assert np.unique(found).tolist() == list(range(parts))
    begins = {0, *(np.flatnonzero(np.diff(found)) + 1).tolist()}
    assert (set(range(0, rows.size, each)) <= begins) == (count <= 6)
