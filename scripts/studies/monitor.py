"""The monitor: false alarms in clean logs, delays of alarms compared with a CUSUM that knows the fault, and its speed.

    python -m scripts.studies.monitor --case 'delay*' --seeds 20 --out monitor

A fault begins in the middle of a log with the commands of the standard experiment. Its size is such that it moves the
innovations by 0.2 to 1 of their standard deviations (RMS). The CUSUM knows this movement at each sample, and its
threshold has the same rate of false alarms.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from time import perf_counter
from typing import Any

import numpy as np
from scipy.optimize import root_scalar
from scipy.stats import chi2

from auv_gym.model import inputs_of, outputs_of
from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.deciding import DOUBT
from identification.fit.online import OnlineFilter
from identification.monitor.monitor import Monitor
from scripts.blind.cases import PERIOD_OF
from scripts.blind.kinds import effects_of, known, log_of
from scripts.blind.logs import Conditions
from scripts.studies.harness import Found, Option, Sheet, Study

# s, length of a log with a fault and of a clean one; those of the float are equally long
VEHICLES = {"slocum": (7200.0, 72000.0), "qiandao_float": (2400.0, 2400.0), "npsauv": (600.0, 3600.0)}
CLEAN, DELAY, STEADY = "clean: ", "delay: ", ", steady gains"
_RATES = {"slocum": 0.2, "qiandao_float": 1.0, "npsauv": 1.0}  # an hour
_SIZES = (0.2, 1.0)
_NOT_AT_ONCE = ("dead_time", "clock")  # these determine the length of a vehicle's command history


@cache
def monitor_of(case: str, fitted: bool) -> Monitor:
    """The monitor of a vehicle, from a clean log."""
    vehicle = vehicle_of(case)
    plant = known(vehicle)
    record = log_of(plant, Conditions(1.0, 1.0, 2.0 * VEHICLES[vehicle][0]), 7)
    return Monitor.learn(
        record, plant, false_alarms_per_hour=_RATES[vehicle], steady=STEADY in case, doubt=DOUBT if fitted else 0.0
    )


def vehicle_of(case: str) -> str:
    return case.partition(": ")[2].partition(",")[0]


def attempt(case: str, seed: int, fitted: str) -> dict[str, Any]:
    """Alarms, hours and samples per second of a clean log, or delays of a fault."""
    vehicle, monitor = vehicle_of(case), monitor_of(case, fitted == "yes")
    rng = np.random.default_rng([seed, len(case), *case.encode()])
    duration = VEHICLES[vehicle][case.startswith(CLEAN)]
    record = log_of(known(vehicle), Conditions(1.0, 1.0, duration), int(rng.integers(2**31)))
    if case.startswith(DELAY):
        return _delays(monitor, record, rng)
    begin = perf_counter()
    alarms = monitor.run(record)
    return {"alarms": len(alarms), "hours": record.duration_s / 3600.0, "rate": len(record) / (perf_counter() - begin)}


def _delays(monitor: Monitor, record: Record, rng: np.random.Generator) -> dict[str, Any]:
    """Delays of a fault, drawn until one moves the innovations enough."""
    plant, wanted = monitor.learned.plant, float(rng.uniform(*_SIZES))
    paths = [p for p in effects_of(plant.name) if p not in PERIOD_OF and not any(n in p for n in _NOT_AT_ONCE)]
    onset, rate = len(record) // 2, monitor.learned.interval * monitor.false_alarms_per_hour / 3600.0
    for path in rng.permutation(paths):
        spec = spec_at(plant, path)
        side = rng.choice([-1.0, 1.0]) if spec.bounds[0] < spec.neutral else 1.0
        size, reached = side * 3.0 * spec.probe, 0.0
        for _ in range(4):  # iterates to a size that moves them as wanted
            value = spec.neutral + size
            if not spec.bounds[0] < value < spec.bounds[1]:
                break
            other, quiet = replace_at(plant, path, value), np.random.default_rng(seed_of(rng))
            log, same = _logs(monitor, record, other, onset, quiet)
            innovations, before = _innovations(monitor, log), _innovations(monitor, same)
            moved = innovations - before
            reached = float(np.sqrt(np.mean((moved[onset:] ** 2).sum(axis=1))))
            if 0.7 * wanted < reached < 1.4 * wanted:
                break
            size *= float(np.clip(wanted / max(reached, 1e-3), 0.1, 10.0))
        if 0.7 * wanted < reached < 1.4 * wanted:
            break
    else:
        raise ValueError(f"No effect of {plant.name} moves the innovations by {wanted:.2f}.")
    bar, level, alarm = bar_of(reached, rate), 0.0, len(record)
    for k, gain in enumerate(((innovations - 0.5 * moved) * moved).sum(axis=1)):
        level = max(level + gain, 0.0)
        if level > bar:
            alarm = k
            break
    start = float(log.time[onset])
    late = [a.time - start for a in monitor.run(log) if a.time > start]
    whole = float(log.time[-1]) - start
    return {
        "path": str(path), "size": float(value), "moves": reached, "interval": monitor.learned.interval,
        "informed": float(log.time[min(alarm, len(log) - 1)]) - start, "monitor": late[0] if late else whole,
        "seen": [alarm < len(record), bool(late)],
    }  # fmt: skip


def seed_of(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))


def _logs(
    monitor: Monitor, record: Record, other: Plant, onset: int, rng: np.random.Generator
) -> tuple[Record, Record]:
    """The commands of a log applied to a vehicle that becomes another one at a row, and to one that does not.

    Both have the same white noise, with the monitor's deviations.
    """
    plan = monitor.learned.plan
    plant = plan.plant
    inputs, outputs, time = inputs_of(plant, record), outputs_of(plant, record), record.time
    noise = np.sqrt(plan.variances) * rng.standard_normal((len(time), len(plan.channels)))
    columns, found = [plant.outputs.index(n) for n in plan.channels], []
    for late in (other, plant):
        x = plant.settled(plant.initial(outputs[0])[: len(plant.family.states)], inputs[0])
        y = np.empty_like(outputs)
        for k in range(len(time)):
            now = late if k >= onset else plant
            y[k] = now.output(x)
            if k + 1 < len(time):
                x = now.step_over(x, inputs[k], float(time[k + 1] - time[k]))
        values = {n: record[n] for n in plant.inputs if record.has(n)}
        values |= dict(zip(plan.channels, (y[:, columns] + noise).T, strict=True))
        found.append(Record.from_arrays(time, values, attrs={"source": "simulated", "vehicle": plant.name}))
    return found[0], found[1]


def _innovations(monitor: Monitor, log: Record) -> np.ndarray:
    """The innovations of the monitor's filter with varying gains, by rows, zero while they do not count."""
    plan = replace(monitor.learned.plan, gains=None, whiten=None)
    own, rows = OnlineFilter(plan), np.zeros((len(log), len(plan.channels)))
    inputs, outputs = inputs_of(plan.plant, log), outputs_of(plan.plant, log)
    own.begin(inputs[0], outputs[0])
    for k in range(1, len(log)):
        if own.step(inputs[k - 1], outputs[k], float(log.time[k] - log.time[k - 1])):
            rows[k] = own.innovations
    return rows


def bar_of(moves: float, rate: float) -> float:
    """The bar of a CUSUM for a mean of `moves` deviations with `rate` false alarms a sample.  Source: Siegmund 1985.

    In his eq. 2.57, the mean time between false alarms is 2 (exp(b) - b - 1) / moves^2, where b is moves times the bar
    of the sum of normal numbers, plus 1.166 for the overshoot.
    """
    found = root_scalar(lambda b: 2.0 * (np.expm1(b) - b) / moves**2 - 1.0 / rate, bracket=(1e-6, 60.0))
    return float(found.root - 1.166 * moves)


def poisson(count: int, hours: float) -> str:
    """`9 in 20 h (0.21 to 0.85 an hour)`, with the exact 95 % interval.  Source: Garwood 1936, Biometrika 28."""
    low, high = 0.5 * chi2.ppf(0.025, 2 * count) if count else 0.0, 0.5 * chi2.ppf(0.975, 2 * count + 2)
    return f"{count} in {hours:.1f} h ({low / hours:.2f} to {high / hours:.2f} an hour)"


def sheets(found: Found) -> list[Sheet]:
    """Rates, delays, and a row for each fault."""
    rates, delays, faults = [], [], []
    for case in found.runs:
        runs = found.of(case)
        if case.startswith(CLEAN):
            count, hours = sum(r["alarms"] for r in runs), sum(r["hours"] for r in runs)
            stated = _RATES[vehicle_of(case)]
            speed = max(r["rate"] for r in runs)
            rates.append([case, f"{stated:g}", poisson(count, hours), f"{speed:.0f}"])
            continue
        both, late = ([r[key] for r in runs] for key in ("informed", "monitor"))
        ratios = [b / max(a, r["interval"]) for a, b, r in zip(both, late, runs, strict=True)]
        seen = sum(r["seen"][1] for r in runs)
        delays.append(
            [case, f"{seen} of {len(runs)}", _mean(both), _mean(late), f"{np.mean(late) / np.mean(both):.2f}",
             f"{np.median(ratios):.2f}", f"{sum(q <= 3.0 for q in ratios)} of {len(runs)}"]
        )  # fmt: skip
        faults += [
            [case, str(seed), r["path"], f"{r['size']:.4g}", f"{r['moves']:.2f}", f"{r['informed']:.1f}",
             f"{r['monitor']:.1f}"]
            for seed, r in found.runs[case].items()
        ]  # fmt: skip
    return [
        Sheet("rates", "False alarms", ("case", "stated an hour>", "alarms>", "samples/s>"), rates),
        Sheet(
            "delays", "Delays",
            ("case", "seen>", "CUSUM, s>", "monitor, s>", "ratio of means>", "median ratio>", "at most 3>"), delays,
        ),
        Sheet("faults", "Faults", ("case", "seed>", "effect", "size>", "moves>", "CUSUM, s>", "monitor, s>"), faults),
    ]  # fmt: skip


def _mean(values: Sequence[float]) -> str:
    return f"{np.mean(values):.1f}"


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(f"{what}{v}{gains}" for what in (CLEAN, DELAY) for v in VEHICLES for gains in ("", STEADY)),
    sheets,
    seeds=20,
    first_seed=9700,
    options={"fitted": Option("no", "whether the monitor fits coefficients to its clean log", choices=("yes", "no"))},
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
