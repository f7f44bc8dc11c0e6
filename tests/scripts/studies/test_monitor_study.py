"""The study of the monitor: thresholds and intervals, faults that begin in a log, and tables from made-up results."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at
from scripts.blind.kinds import known, log_of
from scripts.blind.logs import Conditions
from scripts.studies import monitor
from scripts.studies.harness import Found
from scripts.studies.monitor import STUDY, VEHICLES, attempt, bar_of, monitor_of, poisson, vehicle_of

FAULT = {
    "path": "effects.rudder.offset", "size": 0.0512, "moves": 0.61, "interval": 4.0, "informed": 100.0,
    "monitor": 150.0, "seen": [True, True],
}  # fmt: skip


def test_what_cannot_be_run_is_refused_in_words(capsys):
    with pytest.raises(SystemExit):
        STUDY.main(["--fitted", "perhaps"])
    assert "invalid choice: 'perhaps'" in capsys.readouterr().err
    assert STUDY.main(["--case", "clean: mermaid"]) == 1
    assert "No case is called 'clean: mermaid'; there are: clean: slocum; " in capsys.readouterr().err
    assert {vehicle_of(case) for case in STUDY.cases} == set(VEHICLES)


def test_a_count_of_alarms_has_its_exact_interval():
    """Garwood 1936, table: 9 events have the limits 4.115 and 17.085; without an event, the upper one is 3.689."""
    assert poisson(9, 20.0) == f"9 in 20.0 h ({4.115 / 20.0:.2f} to {17.085 / 20.0:.2f} an hour)"
    assert poisson(0, 2.0) == f"0 in 2.0 h (0.00 to {3.689 / 2.0:.2f} an hour)"


def test_a_cusum_raises_false_alarms_at_the_stated_rate():
    """Siegmund's formula, by simulation: 200 times between false alarms, whose mean is known to 7 %."""
    rng, moves, rate = np.random.default_rng(0), 0.5, 1.0 / 300.0
    bar, times = bar_of(moves, rate), []
    for _ in range(200):
        level, count = 0.0, 0
        while level <= bar:
            level, count = max(level + moves * rng.standard_normal() - 0.5 * moves**2, 0.0), count + 1
        times.append(count)
    assert np.mean(times) == pytest.approx(1.0 / rate, rel=0.25)


@pytest.fixture
def short(monkeypatch):
    """Logs of a few minutes instead of hours."""
    monkeypatch.setattr(monitor, "VEHICLES", {"slocum": (1200.0, 2400.0)})
    monitor_of.cache_clear()
    yield
    monitor_of.cache_clear()


def test_faults_begin_in_the_middle_and_clean_logs_have_few_alarms(short):
    found = attempt("clean: slocum", 1, "no")
    assert found["hours"] == pytest.approx(2400.0 / 3600.0, rel=0.01)
    assert found["alarms"] <= 1
    assert found["rate"] > 0.0
    own = monitor_of("clean: slocum", False)
    plant = known("slocum")
    bent = replace_at(plant, "effects.rudder.offset", 0.05)
    record = log_of(plant, Conditions(1.0, 1.0, 1200.0), 2)
    onset = len(record) // 2
    faulty, same = monitor._logs(own, record, bent, onset, np.random.default_rng(0))
    assert np.array_equal(faulty["rudder_rad"], record["rudder_rad"])
    differs = faulty["heading_rad"] != same["heading_rad"]
    assert not differs[: onset + 1].any()  # the fault acts from there on
    assert differs[onset + 2 :].mean() > 0.9
    moved = monitor._innovations(own, faulty) - monitor._innovations(own, same)
    assert not moved[:onset].any()
    assert np.sqrt(np.mean((moved[onset:] ** 2).sum(axis=1))) > 0.2


def test_tables_have_rates_ratios_and_each_fault(capsys):
    runs = {
        "clean: slocum": {1: {"alarms": 4, "hours": 10.0, "rate": 1e4}, 2: {"alarms": 5, "hours": 10.0, "rate": 2e4}},
        "delay: slocum": {1: FAULT, 2: FAULT | {"monitor": 450.0, "seen": [True, False]}},
        "delay: npsauv": {1: FAULT | {"informed": 1.0, "monitor": 8.0}},
    }
    rates, delays, faults = STUDY.sheets(Found(runs, {}))
    assert rates.rows == [["clean: slocum", "0.2", "9 in 20.0 h (0.21 to 0.85 an hour)", "20000"]]
    assert delays.rows[0] == ["delay: slocum", "1 of 2", "100.0", "300.0", "3.00", "3.00", "1 of 2"]
    assert delays.rows[1][4:] == ["8.00", "2.00", "1 of 1"]  # no delay counts as shorter than a sample
    assert faults.rows[1] == ["delay: slocum", "2", "effects.rudder.offset", "0.0512", "0.61", "100.0", "450.0"]
    for sheet in (rates, delays, faults):
        assert all(len(row) == len(sheet.heads) for row in sheet.rows)


def test_finished_runs_are_kept(tmp_path, capsys):
    begun = []

    def tried(case, seed, fitted):
        begun.append((case, seed, fitted))
        return FAULT

    study = replace(STUDY, attempt=tried)
    given = ["--case", "delay: slocum", "--out", str(tmp_path), "--seeds"]
    assert study.main([*given, "1"]) == 0
    assert study.main([*given, "2"]) == 0
    assert begun == [("delay: slocum", 9700, "no"), ("delay: slocum", 9701, "no")]
    assert "Delays" in capsys.readouterr().out
    assert (tmp_path / "faults.csv").read_text().count("effects.rudder.offset") == 2
    assert study.main([*given, "2", "--fitted", "yes"]) == 1
    assert "other settings (see study.json there)" in capsys.readouterr().err
