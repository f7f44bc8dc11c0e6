"""The plan of an environment's episodes, made of its options; every option is checked here, or on the way."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from math import ceil, floor, nan
from typing import Any

import numpy as np

from auv_gym.envs import tasks
from auv_gym.envs.episodes import Episodes
from auv_gym.envs.kernel.layout import (
    CHANGE_DRAWS,
    MOST_OBSERVATIONS,
    NOISE_ROWS,
    SAMPLING,
    START_DRAWS,
    plan_type,
    row_type,
    size,
)
from auv_gym.envs.kernel.programs import bind_kernel
from auv_gym.envs.kind import EnvKind, ScaledTask
from auv_gym.envs.kinds import KINDS
from auv_gym.envs.options import check_model_dt, check_model_inputs, check_number, model_of, resolve_plant
from auv_gym.envs.tasks import Observed, Task
from auv_gym.model import Model
from auv_gym.param import check_value, did_you_mean, list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant, load_vehicle

_OPTIONS = ("vehicle", "effects", "randomise", "model", "dt", "duration", "target", "render_mode")


def make_episodes(
    task: str | Task,
    vehicle: str | os.PathLike | Plant | None,
    *,
    effects: Mapping[str, float] | None = None,
    randomise: Mapping[str, tuple[float, float]] | None = None,
    model: Model | str | os.PathLike | None = None,
    dt: float | None = None,
    duration: float | None = None,
    target: float | Mapping[str, float] | None = None,
    **own: Any,
) -> Episodes:
    """The episodes that an environment's options describe; raises on what does not fit together.

    own: options of the vehicle's kind, see `EnvKind.options`; None is as if not given.
    """
    if isinstance(task, str):
        if task not in tasks.TASKS:
            raise ValueError(f"No task {task!r}. {did_you_mean(task, tasks.TASKS)}Tasks: {', '.join(tasks.TASKS)}.")
        task = tasks.TASKS[task]
    plant = resolve_plant(task.vehicle if vehicle is None else vehicle, dt)
    task, kind = _task_for(task, plant)
    plant = kind.prepare(plant, dt)
    own = {name: value for name, value in own.items() if value is not None}
    for name in own:
        if name not in kind.options:
            raise ValueError(
                f"{task.name} takes the options of all environments and {' and '.join(kind.options)}, got {name!r}. "
                f"{did_you_mean(name, (*_OPTIONS, *kind.options))}Leave it out."
            )
    if target is not None and task.channel:
        check_number("target", target, "the channel's unit", at_least=task.least)
    scaled = kind.scale(task, plant, duration=duration, target=target, **own)
    for given, where in ((effects, "effects="), (randomise, "randomise=")):
        for path in scaled.effects.keys() & (given or {}).keys():
            raise ValueError(
                f"{task.name} needs one value of {path}, got one by {where} and one by an option of its "
                "own: leave one out."
            )
    effects = {**scaled.effects, **(effects or {})}
    units = {"": 1.0, **scaled.units}
    driver, owner, ranges = _driven(plant, model, effects, randomise, scaled.randomise)
    compiled = driver is owner
    if not compiled:
        if scaled.least_dt < plant.dt:
            raise ValueError(
                f"Steps of two lengths (near=) are nothing that {type(driver).__name__} was made for: leave near= out, "
                "or give a plant as model=."
            )
        _check_model(driver, plant, scaled)

    def source_of(observed: Observed) -> str:
        return scaled.stands_for.get(observed.source, observed.source)

    # what an agent might move, but not with this vehicle, it does not see
    observed = [o for o in task.observed if o.source not in task.actions or source_of(o) in scaled.actions]
    observed += scaled.observed
    if len(observed) > MOST_OBSERVATIONS:
        raise ValueError(
            f"{task.name} observes at most {MOST_OBSERVATIONS} numbers, got {len(observed)} with the "
            f"{len(scaled.actions)} actions of {plant.name!r}: name fewer as actions=."
        )
    family, record = plant.family, np.zeros(1, plan_type(plant.family, kind.layout))
    layout = kind.layout
    sensors = layout.sensors
    plan: Any = record[0]
    tables: list[np.ndarray] = []

    def table(values: Any) -> int:
        at = size(plan_type(family, layout)) + sum(t.size for t in tables)
        tables.append(np.asarray(values, dtype=np.float64).ravel())
        return at

    longest = {
        p: limits[1] for p, limits in ranges.items() if p.endswith((".dead_time", ".clock.delay", ".clock.rate"))
    }
    sized = replace(replace_at(owner, longest) if longest else owner, dt=scaled.least_dt)
    state_names = sized.states
    plan["derived_size"] = owner.derived.size
    plan["dt"], plan["longest_step"] = plant.dt, owner.longest_step
    plan["by_model"] = not compiled
    plan["actions"], plan["observations"] = len(scaled.actions), len(observed)
    plan["history"] = sized.history
    sources = {name: i for i, name in enumerate((*family.outputs, *layout.geometry, *family.inputs))}
    plan["observed_at"] = table(
        [(sources[source_of(o)], o.offset * units[o.unit], o.scale * units[o.unit]) for o in observed]
    )
    where = {path: index for index, path in enumerate(list_paths(owner))}
    plan["randomised"] = len(ranges)
    plan["randomised_at"] = table([(where[path], low, high) for path, (low, high) in ranges.items()])

    def most(effect: str, sensor: str) -> float:
        path = f"effects.sampling.{sensor}.{effect}"
        return max(value_at(owner, path), ranges.get(path, (0.0, 0.0))[1])

    sampling = [f"effects.sampling.{sensor}.{effect}" for sensor in sensors for effect in SAMPLING]
    plan["sampling_from"] = where[sampling[0]]
    assert [where[path] for path in sampling] == list(range(where[sampling[0]], where[sampling[0]] + len(sampling)))
    plan["sampled"] = any(most(effect, sensor) > 0.0 for sensor in sensors for effect in SAMPLING)
    drawn = any(most(effect, sensor) > 0.0 for sensor in sensors for effect in ("noise", "dropout"))
    plan["sensor_of"] = [next((i for i, c in enumerate(sensors.values()) if o in c), -1) for o in family.outputs]
    plan["delayed"] = floor(max(most("delay", sensor) for sensor in sensors) / plant.dt + 0.5) + 1
    plan["noise_rows"] = NOISE_ROWS if drawn else 0

    if task.channel:
        plan["true_index"] = family.states.index(task.channel)
        plan["read_index"] = family.outputs.index(task.channel)
        plan["is_angle"] = task.channel == "heading_rad"
    plan["error_scale"] = task.scale * units[task.unit]
    plan["weight"][: len(task.weights)] = list(task.weights.values())
    plan["target_step"] = [k * units[task.unit] for k in task.step]
    plan["target_hold"] = [k / units["rate"] for k in task.hold]
    plan["target_band"] = [k * units[task.unit] for k in task.band]
    plan["fixed_target"] = target if target is not None and task.channel else nan
    plan["steps"] = max(round(scaled.duration / plant.dt), 1)
    for field, value in scaled.plan.items():
        plan[field] = value
    constants = [(family.inputs.index(name), where[path]) for name, path in family.constants.items()]
    for field, rows in {"constants": constants, **scaled.tables}.items():
        plan[field], plan[f"{field}_at"] = len(rows), table(rows)

    plan["changes"] = ceil(scaled.duration / scaled.shortest) + 2
    plan["full_state"] = len(state_names)
    plan["state_at"] = at = size(row_type(family, layout))
    plan["previous_at"] = at = at + len(state_names)
    at += len(state_names)
    if scaled.own_ages:
        plan["ages_at"], at = at, at + sized.ages.size
    else:
        plan["ages_at"] = table(sized.ages)
    plan["delayed_at"] = at
    plan["noise_at"] = at = at + int(plan["sampled"]) * int(plan["delayed"]) * len(family.outputs)
    plan["draws_at"] = at = at + int(plan["noise_rows"]) * (len(family.outputs) + len(sensors))
    plan["row_size"] = at + START_DRAWS + len(ranges) + CHANGE_DRAWS * int(plan["changes"])
    plan["plan_size"] = size(plan_type(family, layout)) + sum(t.size for t in tables)
    return Episodes(
        task=task,
        kind=kind,
        plant=plant,
        driver=driver,
        kernel=bind_kernel(family, kind),
        actions=scaled.actions,
        middles=scaled.middles,
        limits=scaled.limits,
        observations=tuple(o.name for o in observed),
        start_options=scaled.start,
        randomise=ranges,
        state_names=state_names,
        vector=owner.vector.copy(),
        derived=owner.derived.copy(),
        plan=np.concatenate([record.view(np.float64), *tables]),
    )


def _task_for(task: Task, plant: Plant) -> tuple[Task, EnvKind]:
    """The task in the form for the vehicle's kind, and this kind; raises unless the task is for it."""
    kind = KINDS.of(plant.family)
    for form in (task, *task.forms):
        if kind is _kind_of(form.vehicle):
            return form, kind
    needed = " or ".join(f"{_kind_of(form.vehicle).title}, such as {form.vehicle!r}" for form in (task, *task.forms))
    raise ValueError(
        f"{task.name} needs {needed}, got {plant.name!r} of family {plant.family.name!r}: give another vehicle=, or "
        f"take an environment for {kind.title}."
    )


@lru_cache
def _kind_of(preset: str) -> EnvKind:
    return KINDS.of(load_vehicle(preset).family)


def _driven(
    plant: Plant,
    model: Model | str | os.PathLike | None,
    effects: Mapping[str, float] | None,
    randomise: Mapping[str, tuple[float, float]] | None,
    unless_told: Mapping[str, tuple[float, float]],
) -> tuple[Model, Plant, dict[str, tuple[float, float]]]:
    """What is simulated, the plant whose parameters compiled code takes (the same, if that can step it), and ranges.

    unless_told: ranges that are drawn from where none are given and a vehicle is simulated.
    """
    effects = dict(effects or {})
    if model is not None and any(not path.startswith("effects.sampling.") for path in (*effects, *(randomise or {}))):
        raise ValueError(
            "effects= and randomise= change the vehicle, which model= replaces: give one of them, or paths under "
            "effects.sampling, which act on what any of them measures."
        )
    driver = plant if model is None else _model(model, plant)
    compiled = isinstance(driver, Plant) and driver.family is plant.family
    owner = replace_at(driver if isinstance(driver, Plant) and compiled else plant, effects)
    if randomise is None:
        randomise = {p: r for p, r in unless_told.items() if p not in effects} if model is None else {}
    ranges = {path: _range(owner, path, limits) for path, limits in randomise.items()}
    for corner in (0, 1):
        problem = owner.family.problem(
            replace_at(owner, {p: limits[corner] for p, limits in ranges.items()}).parameters
        )
        if problem:
            raise ValueError(f"randomise= reaches an impossible vehicle: {problem}.")
    return owner if compiled else driver, owner, ranges


def _range(plant: Plant, path: str, limits: Any) -> tuple[float, float]:
    spec = spec_at(plant, path)
    if not isinstance(limits, tuple | list) or len(limits) != 2:
        raise ValueError(f"randomise= needs a pair (low, high) in {spec.unit} for {path}, got {limits!r}.")
    low, high = (check_value(path, value, spec) for value in limits)
    if low > high:
        raise ValueError(f"randomise= needs low <= high for {path}, got ({low:g}, {high:g}).")
    return low, high


def _model(model: Model | str | os.PathLike, plant: Plant) -> Model:
    driver = model_of(model, plant)
    check_model_dt(driver, plant)
    return driver


def _check_model(model: Model, plant: Plant, scaled: ScaledTask) -> None:
    """Raises if a model cannot drive the environment, with the channel that lacks."""
    name = type(model).__name__
    needed = [*scaled.read, *(c for fin, read in scaled.read_for.items() if fin in model.inputs for c in read)]
    for channels, what, has in ((needed, "outputs", model.outputs), (scaled.driven, "inputs", model.inputs)):
        for channel in dict.fromkeys(channels):
            if channel not in has:
                raise ValueError(
                    f"model= needs {channel} among its {what}, got {name} with {', '.join(has) or 'none'}: "
                    f"fit it to a record that has {channel}, or splice it into the plant."
                )
    check_model_inputs(model, plant)
