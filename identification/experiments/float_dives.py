"""Simulated dives of profiling floats: depth control by a piston, and missions with an oil bladder, pump and valve."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from math import exp, inf
from typing import Any

import numpy as np

from auv_gym.model import check_finite
from auv_gym.physics.buoyancy import GRAVITY
from auv_gym.plant import Plant, check_vehicle
from auv_gym.plant.rollout import scratch_for
from auv_gym.records.record import Record, concat
from auv_gym.vehicles.profiling_float import steady_speed
from controllers.controller import Controller
from controllers.pid import float_depth_pid
from identification.experiments.excitation import check_generator

Profile = Callable[[float], float]

_LONG_AGO = -1e7  # s, when commands given before the record had already been reached
_STARTS = (4.0, 8.0)  # m, where a dive's record begins, below bubbles and waves
_HEAVY = (90e-6, 150e-6)  # m^3 of missing buoyancy at the start of a dive
_VALVED = (20e-6, 25e-6)  # m^3 let in by one valve action on the way down
_PUMPED = (43e-6, 49e-6)  # m^3 pumped out by one action on the way up, or twice that
_MOST_OIL, _LEAST_OIL = 95e-6, 2e-6  # m^3, most and least oil of one action that parks the float
_SLOW, _FAST = 0.035, 0.12  # m/s; the mission keeps its speed between them if it can
_DEEP_SAMPLE, _SHALLOW_SAMPLES, _SHALLOW = 325.0, (20.0, 60.0), 60.0  # s, s, m
_BETWEEN, _PRESSED = 11, 3  # samples between actions: normally, and if the float hardly moves
_PARKED = (12, 36)  # samples spent parked near the target
_STILL = 0.004  # m/s, below which a parked float takes no action
_MOST_SAMPLES = 1500  # of a dive that never returns
_OIL_CHANNELS = (
    "depth_m", "temperature_C", "oil_volume_m3", "pumped_volume_m3", "valved_volume_m3", "valved_depth_m4",
)  # fmt: skip


def summer_lake(depth: float) -> float:
    """Water temperature, degC, at a depth, m: 28 at the surface of a stratified lake, 10 at the bottom.

    The profile has the usual form of a deep subtropical lake in August, with assumed numbers.
    """
    return 10.0 + 18.0 / (1.0 + exp((depth - 14.0) / 4.0))


def summer_sea(depth: float) -> float:
    """Water temperature, degC, at a depth, m: a warm layer over the deep Mediterranean, with assumed numbers."""
    return 13.2 + 10.5 * exp(-max(depth, 0.0) / 35.0) + 1.6 * exp(-max(depth, 0.0) / 400.0)


def depth_control(
    plant: Plant,
    targets: Sequence[float],
    *,
    rng: np.random.Generator,
    controller: Controller | None = None,
    hold: float | Sequence[float] = 600.0,
    noise: float = 0.02,
    dt: float | None = None,
    near: tuple[float, float] = (0.8, 0.36),
    start: float = 0.0,
    temperature_profile: Profile | None = None,
    under_way: Callable[..., Any] | None = None,
) -> Record:
    """Simulate a float with a piston that holds one target depth after another, each for `hold` s.

    The controller (default `float_depth_pid`) acts on the noisy depth; piston_m is its command, clipped to the piston's
    range, before any effect. The float starts at rest at the depth `start`, with the piston at its first command.
    noise: m, standard deviation of white noise, all drawn before the run.  dt: s between samples, default the
    vehicle's; near: (m, s), a distance to the target and the sample interval within it.  temperature_profile: degC at a
    depth, constant in time, recorded along the track.  under_way: starts and moves the float, default `Swim.start`.
    Raises Diverged.  Source of the rates: Zhong et al. 2024, sec. 4.1.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import depth_control
        >>> depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        Record(852 samples, 1 segment, 399.86 s: depth_m, piston_m, depth_cmd_m)
    """
    check_vehicle("depth_control", plant)
    check_generator("depth_control", rng)
    if "piston_m" not in plant.family.required:
        raise ValueError(
            f"depth_control needs a float with a piston, got {plant.name!r} of family {plant.family.name!r}: take "
            "oil_mission for one with an oil bladder, closed_loop for a glider."
        )
    if not isinstance(targets, Sequence | np.ndarray) or isinstance(targets, str):
        raise ValueError(f"depth_control needs targets as a list of depths in m, got {targets!r}.")
    far = plant.dt if dt is None else dt
    holds = [float(h) for h in hold] if isinstance(hold, Sequence) else [float(hold)] * len(targets)
    if not len(targets) or len(holds) != len(targets) or not all(h > far for h in holds):
        raise ValueError(
            f"A float needs targets and for each a hold (--duration, hold) longer than a sample of {far:g} s (--dt, "
            f"dt), got {len(targets)} targets and {holds} s."
        )
    if not all(0.0 <= target < inf for target in targets):
        raise ValueError(
            f"depth_control needs target depths (--target-depth, target_depths) from 0 m down, got {list(targets)} m."
        )
    if not far > 0.0 or not near[1] > 0.0 or not noise >= 0.0:
        raise ValueError(f"depth_control needs dt > 0, near[1] > 0 s and noise >= 0 m, got {far}, {near[1]}, {noise}.")
    controller = float_depth_pid(plant) if controller is None else controller
    ends = list(accumulate(holds))
    added = noise * rng.standard_normal(int(ends[-1] / min(far, near[1])) + 2)

    memory, now, rows = controller.start(), 0.0, []
    swim = (under_way or Swim.start)(replace(plant, dt=min(far, near[1])), start)
    while now <= ends[-1]:
        target = float(targets[min(int(np.searchsorted(ends, now, side="right")), len(targets) - 1)])
        measured = float(swim.measured + added[len(rows)])
        reading = {"depth_m": measured, "dt_s": now - rows[-1][0] if rows else far}
        command, memory = controller.act(memory, reading, {"depth_m": target})
        inputs = {"piston_m": min(max(command["piston_m"], plant.hull.piston_low), plant.hull.piston_high)}
        if temperature_profile is not None:
            inputs["temperature_C"] = temperature_profile(swim.depth)
        rows.append((now, measured, inputs["piston_m"], target, inputs.get("temperature_C", np.nan)))
        interval = near[1] if abs(measured - target) < near[0] else far
        swim = swim.onward(inputs, interval)
        now += interval
    names = ("depth_m", "piston_m", "depth_cmd_m", "temperature_C")
    attrs: dict[str, str | float] = {"source": "simulated", "vehicle": plant.name, "depth_noise_m": noise}
    return _record(names if temperature_profile is not None else names[:-1], rows, attrs)


def oil_mission(
    plant: Plant,
    depths: Sequence[float] = (400.0, 900.0, 600.0, 1400.0),
    *,
    rng: np.random.Generator,
    noise: float = 0.1,
    resolution: float = 0.01,
    temperature_profile: Profile = summer_sea,
    under_way: Callable[..., Any] | None = None,
) -> Record:
    """Simulate a float with an oil bladder; the record has one segment for each depth that it dives to and parks at.

    A dive begins and ends just below the surface, with a volume of its own that is not recorded. On the way down, the
    float lets in 20 to 25 mL at random depths and whenever it is slow; it parks by pumping oil that balances its drag,
    and pumps 43 to 49 mL, or twice that, to ascend. Samples are 325 s apart, 20 to 60 s near the surface.  noise: m,
    white; resolution: m.  Channels: depth_m, temperature_C, oil_volume_m3 and sums over the actions of pump and valve.
    under_way: starts and moves the float, default `Swim.start`.
    Sizes and times are those of MERMAID floats' logs.  Raises Diverged.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import oil_mission
        >>> log = oil_mission(load_vehicle("mermaid"), [400.0], rng=np.random.default_rng(0))
        >>> round(log["depth_m"].max()), round(log.duration_s / 3600, 1)
        (455, 6.7)
    """
    check_vehicle("oil_mission", plant)
    check_generator("oil_mission", rng)
    if "oil_volume_m3" not in plant.family.required:
        raise ValueError(
            f"oil_mission needs a float with an oil bladder, got {plant.name!r} of family {plant.family.name!r}: take "
            "depth_control for one with a piston, closed_loop for a glider."
        )
    if not depths or not all(50.0 <= depth <= 3000.0 for depth in depths):
        raise ValueError(
            f"The dives of {plant.name!r} need target depths (--target-depth, target_depths) from 50 to 3000 m, one "
            f"for each dive; got {', '.join(f'{depth:g}' for depth in depths) or 'none'}."
        )
    if not noise >= 0.0 or not resolution >= 0.0:
        raise ValueError(f"oil_mission needs noise and resolution >= 0 m, got {noise} and {resolution}.")
    attrs: dict[str, str | float] = {"source": "simulated", "vehicle": plant.name, "depth_noise_m": noise}
    dives = []
    for depth, generator in zip(depths, rng.spawn(len(depths)), strict=True):
        rows = _dive(plant, float(depth), generator, noise, resolution, temperature_profile, under_way or Swim.start)
        dives.append(_record(_OIL_CHANNELS, rows, attrs, f"dive {len(dives) + 1}"))
    return concat(dives)


@dataclass(frozen=True, eq=False)
class Swim:
    """A plant under way with uneven samples: its full state, the time, s, and the times of its last commands."""

    plant: Plant
    x: np.ndarray
    time: float
    given: np.ndarray

    @classmethod
    def start(cls, plant: Plant, depth: float, rate: float = 0.0, volume: float = 0.0) -> Swim:
        """A float at a depth, m, that sinks at a rate, m/s, with an unrecorded volume, m^3; sensors settled at rest."""
        x = plant.initial(np.array([depth, 0.0]))
        x[plant.states.index("depth_rate_mps")] = rate
        x[plant.states.index("volume_m3")] = volume
        return cls(plant, x, 0.0, np.full(plant.history, _LONG_AGO))

    @property
    def depth(self) -> float:
        """The true depth, m."""
        return float(self.x[0])

    @property
    def measured(self) -> float:
        """The depth reading without noise, m."""
        return float(self.plant.output(self.x)[0])

    def onward(self, inputs: Mapping[str, float], duration: float) -> Swim:
        """The float `duration` s later under these inputs; the first inputs count as held for a long time."""
        known = {**self.plant.constants, "elapsed_s": self.time, **inputs}
        u = np.array([known[name] for name in self.plant.inputs])
        x = self.x.copy()
        if self.time == 0.0:
            for name in self.plant.family.actuators:
                x[self.plant.states.index(f"{name} play")] = known[name]
            self._step(x, u, self.given, -_LONG_AGO, 0.0)  # moves only the actuators
        given = np.append(self.given[1:], self.time)
        self._step(x, u, given - self.time, duration, self.plant.longest_step)
        return Swim(self.plant, x, self.time + duration, given)

    def _step(self, x: np.ndarray, u: np.ndarray, given: np.ndarray, duration: float, longest_step: float) -> None:
        ages = np.append(given, duration)
        plant = self.plant
        plant.programs.step(x, u, ages, longest_step, plant.derived, np.empty(scratch_for(plant.family).size))


def _dive(
    plant: Plant,
    target: float,
    rng: np.random.Generator,
    noise: float,
    resolution: float,
    profile: Profile,
    under_way: Callable[..., Any],
) -> list[tuple[float, ...]]:
    """The rows of one dive: the time, then `_OIL_CHANNELS`."""
    hull = plant.hull
    begin, volume = rng.uniform(*_STARTS), -rng.uniform(*_HEAVY)
    valved_at = np.sort(rng.uniform(0.1, 0.8, size=3)) * target
    parked_for = int(rng.integers(*_PARKED))
    valve_sizes, pump_sizes = rng.uniform(*_VALVED, _MOST_SAMPLES), rng.uniform(*_PUMPED, _MOST_SAMPLES)
    pump_sizes *= np.where(rng.random(_MOST_SAMPLES) < 0.2, 2.0, 1.0)
    added, intervals = noise * rng.standard_normal(_MOST_SAMPLES), rng.uniform(*_SHALLOW_SAMPLES, _MOST_SAMPLES)

    rate = float(steady_speed(-volume * hull.density * GRAVITY, hull.drag_linear, hull.drag_quadratic))
    swim = under_way(plant, begin, rate, volume)
    pumped = valved = valved_depth = 0.0
    phase, since, parked, rows = "down", 0, 0, []
    for k in range(_MOST_SAMPLES):
        measured = swim.measured + added[k]
        measured = round(measured / resolution) * resolution if resolution > 0.0 else measured
        if rows:
            rate = (measured - rows[-1][1]) / (swim.time - rows[-1][0])
        balance = (hull.drag_linear + hull.drag_quadratic * abs(rate)) * rate / (hull.density * GRAVITY)
        pump = valve = 0.0
        if phase == "down" and measured >= target:
            phase, pump = "parked", float(np.clip(balance, _LEAST_OIL, _MOST_OIL))
        elif phase == "down" and since >= _BETWEEN and rate < _FAST:
            if rate < _SLOW or measured > valved_at[0]:
                valve, valved_at = valve_sizes[k], np.append(valved_at[valved_at >= measured], np.inf)
        elif phase == "down" and since >= _PRESSED and rate < 0.3 * _SLOW:
            valve = valve_sizes[k]
        elif phase == "parked":
            parked += 1
            if parked > parked_for:
                phase, pump = "up", pump_sizes[k]
            elif since >= (_PRESSED if rate > _SLOW else _BETWEEN) and abs(rate) > _STILL:
                oil = float(np.clip(balance, -_MOST_OIL, _MOST_OIL))
                pump, valve = max(oil, 0.0), max(-oil, 0.0)
        elif phase == "up" and measured < begin:
            break
        elif phase == "up" and since >= (_BETWEEN if -rate > _SLOW else _PRESSED) and -rate < _FAST:
            pump = pump_sizes[k]
        since = 0 if pump or valve else since + 1
        pumped, valved, valved_depth = pumped + pump, valved + valve, valved_depth + valve * measured
        temperature = profile(swim.depth)
        row = (swim.time, measured, temperature, pumped - valved, pumped, valved, valved_depth)
        rows.append(row)
        interval = intervals[k] if measured < _SHALLOW else _DEEP_SAMPLE
        swim = swim.onward(dict(zip(_OIL_CHANNELS[1:], row[2:], strict=True)), interval)
    return rows


def _record(names: Sequence[str], rows: Sequence[tuple[float, ...]], attrs: Mapping, label: str = "") -> Record:
    """A record of one segment from rows of time and these channels; raises Diverged."""
    columns = np.array(rows)
    check_finite(("depth_m",), columns[:, 0], columns[:, 1:2])
    channels = dict(zip(names, columns[:, 1:].T, strict=False))
    return Record.from_arrays(columns[:, 0], channels, segment=np.full(len(rows), label), attrs=attrs)
