"""An effect that begins in mid-episode: fixed policies, compared with one that is replaced after a monitor's alarm.

    python -m scripts.studies.rl.in_flight --out in_flight --seeds 5

A glider holds headings for three hours; after one hour an undeclared effect begins. `switched` begins with the policy
of the believed vehicle, watched by a monitor. After an alarm, a search looks for an effect that has begun; a policy
trained on the vehicle with that effect then takes over. `informed` takes the policy of the true vehicle at the onset,
which is impossible at sea. The others use one policy throughout.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.param import replace_at
from auv_gym.plant import Plant
from auv_gym.rl import Policy, fresh_seeds, train
from auv_gym.rl.settings import make_env
from controllers.piloting import pilot_for
from identification.changes.timed_forms import FROM
from identification.experiments.missions import run_mission
from identification.monitor.monitor import Monitor
from identification.monitor.wrapper import Monitored
from scripts.studies.harness import Found, Option, Sheet, Study
from scripts.studies.rl.scenarios import (
    BELIEVED,
    RANDOMISED,
    RECURRENT,
    SCENARIOS,
    STACKED,
    TRUE,
    WORDS,
    Scenario,
    policy_folder,
)
from scripts.studies.rl.statistics import iqm
from scripts.studies.rl.study import training_of

SWITCHED, INFORMED = "switched", "informed"
NAMES: Mapping[str, str] = {
    INFORMED: "that of the true vehicle from the onset on",
    SWITCHED: "that of the vehicle that the monitor's search names",
    BELIEVED: "that of the believed vehicle throughout",
    RANDOMISED: WORDS[RANDOMISED],
    STACKED: WORDS[STACKED],
    RECURRENT: WORDS[RECURRENT],
    "pid": "PID, no policy",
    "gpc": "GPC of the believed vehicle, no policy",
}
HOUR = 3600.0
CLEAN, FLIGHT = 10.0, 3.0  # hours, of the log that the monitor learns from and of an episode; onset after one hour
FALSE_ALARMS = 0.1  # an hour
WAIT = 3.0  # windows of the vehicle from an alarm to the search
PERIODS = ("before", "first hour after", "second hour after")


@dataclass(frozen=True, eq=False)
class Becomes:
    """A plant that becomes another one of its family at a time, as a model; the last state is the time, s."""

    before: Plant
    after: Plant
    onset: float

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.before.inputs

    @property
    def states(self) -> tuple[str, ...]:
        return (*self.before.states, "elapsed_s")

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.before.outputs

    @property
    def dt(self) -> float:
        return self.before.dt

    @property
    def constants(self) -> Mapping[str, float]:
        return self.before.constants

    def now(self, x: np.ndarray) -> Plant:
        return self.after if x[-1] >= self.onset else self.before

    def initial(self, y0: np.ndarray) -> np.ndarray:
        return np.r_[self.before.initial(y0), 0.0]

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.r_[self.now(x).step(x[:-1], u), x[-1] + self.dt]

    def output(self, x: np.ndarray) -> np.ndarray:
        return self.now(x).output(x[:-1])

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.r_[self.now(x).correct(x[:-1], y), x[-1]]


@dataclass(frozen=True, eq=False)
class Flight:
    """Rewards of an episode, step by step; named: time and effects of each search after an alarm."""

    time: np.ndarray
    rewards: np.ndarray
    named: tuple[tuple[float, Mapping[str, float]], ...]


def attempt(case: str, seed: int, steps: int, episodes: int, out: Path) -> dict[str, Any]:
    """Costs per step of an agent in each period, episode by episode, and the names of searches."""
    scenario = SCENARIOS["glider"]
    flights = [flown(scenario, case, seed, own, steps, out) for own in fresh_seeds(seed, episodes)]
    return {
        "costs": [costs_of(flight) for flight in flights],
        "named": [[[time, dict(found)] for time, found in flight.named] for flight in flights],
    }


def costs_of(flight: Flight) -> list[float]:
    """The mean cost of a step in each period."""
    hour = np.minimum((flight.time - 1e-6) // HOUR, len(PERIODS) - 1)
    return [float(-flight.rewards[hour == k].mean()) for k in range(len(PERIODS))]


def flown(scenario: Scenario, case: str, seed: int, episode: int, steps: int, out: Path) -> Flight:
    """One episode of an agent."""
    vehicle = Becomes(scenario.believed, scenario.truth, HOUR)
    options = {"vehicle": scenario.vehicle, "dt": scenario.dt, "duration": FLIGHT * HOUR, **scenario.options}
    env = make_env(scenario.env, vehicle, **options)

    def policy(row: str) -> Callable[..., np.ndarray]:
        folder = policy_folder(scenario.name, row, seed, out)
        train(training_of(scenario.name, row, seed, out, steps), folder)
        return Policy.load(folder).begin(env)

    first = BELIEVED if case in (SWITCHED, INFORMED) else case
    act = pilot_for(env, case).begin(env) if case in scenario.controllers else policy(first)
    watched = case == SWITCHED
    if watched:
        env = Monitored(env, fresh(monitor_of(scenario.name, seed)))
    observation, info = env.reset(seed=episode)
    due, ended, rows, named = np.inf, False, [], []
    while not ended:
        if case == INFORMED and info["time_s"] >= HOUR and due == np.inf:
            act, due = policy(TRUE), 0.0
        observation, reward, terminated, truncated, info = env.step(act(observation, info))
        rows.append((info["time_s"], float(reward)))
        ended = terminated or truncated
        if not watched or ended:
            continue
        if info["alarm"] is not None and due == np.inf:
            due = info["time_s"] + WAIT * scenario.believed.window
        if info["time_s"] >= due:
            due, found = np.inf, begun(env.monitor)
            named.append((info["time_s"], found))
            if found:
                act = taught(scenario, found, seed, episode, steps, out).begin(env)
                watched = False  # a monitor of the new vehicle would need a clean log of it
    time, rewards = np.array(rows).T
    return Flight(time, rewards, tuple(named))


def begun(monitor: Monitor) -> dict[str, float]:
    """Effects that begin in the monitor's stretch, according to a search, with their sizes; none if it fails."""
    try:
        found = monitor.explain().found
    except ValueError:  # hardly any rudder motion, or readings that look mislabelled
        return {}
    return {one.path: one.size.value for one in found if one.form == FROM and one.path.startswith("effects.")}


def taught(scenario: Scenario, found: Mapping[str, float], seed: int, episode: int, steps: int, out: Path) -> Policy:
    """A policy trained on the believed vehicle with some effects."""
    plant = replace_at(scenario.believed, dict(found))
    training = replace(training_of(scenario.name, BELIEVED, seed, out, steps), on=plant)
    folder = out / scenario.name / SWITCHED / f"seed_{seed}_{episode}"
    train(training, folder)
    return Policy.load(folder)


@cache
def monitor_of(name: str, seed: int) -> Monitor:
    """The monitor of the believed vehicle, from a clean log of its own."""
    scenario = SCENARIOS[name]
    clean = run_mission(scenario.believed, np.random.default_rng([seed, 8]), duration=CLEAN * HOUR)
    return Monitor.learn(clean, scenario.believed, false_alarms_per_hour=FALSE_ALARMS)


def fresh(monitor: Monitor) -> Monitor:
    """A monitor with the same training that has seen no data yet."""
    return Monitor(monitor.learned, monitor.false_alarms_per_hour)


def sheets(found: Found) -> list[Sheet]:
    """Costs by agent and period, and the names of searches."""
    rows, said = [], []
    for case, name in NAMES.items():
        runs = found.of(case)
        if runs:
            costs = [np.array([np.mean(run["costs"], axis=0)[k] for run in runs]) for k in range(len(PERIODS))]
            shown = [iqm([one], np.random.default_rng(0)) for one in costs]
            rows.append([name, f"{len(runs)}", *(f"{e.value:.4f} ({e.low:.4f} to {e.high:.4f})" for e in shown)])
    for seed, run in found.runs.get(SWITCHED, {}).items():
        for number, searches in enumerate(run["named"]):
            words = "; ".join(f"{t / 60.0:.0f} min: {_said(effects)}" for t, effects in searches)
            said.append([f"{seed}", f"{number + 1}", words or "no alarm"])
    heads = ("policy", "seeds>", *(f"cost a step, {period}, IQM (95 %)>" for period in PERIODS))
    tables = [Sheet("costs", f"{SCENARIOS['glider'].title}, after one hour", heads, rows)]
    if said:
        tables.append(
            Sheet("named", "What the searches after alarms named, and when", ("seed>", "episode>", "named"), said)
        )
    return tables


def _said(effects: Mapping[str, float]) -> str:
    return ", ".join(f"`{path}` {value:.3g}" for path, value in effects.items()) or "nothing"


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(NAMES),
    sheets,
    seeds=5,
    options={
        "steps": Option(0, "of each training; 0: the scenario's", least=0),
        "episodes": Option(3, "of each seed, three hours each", least=1),
    },
    keeps=True,
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
