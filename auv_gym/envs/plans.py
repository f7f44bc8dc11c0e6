"""The plan of an environment's episodes from its options; every option is checked here or in the functions called."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from auv_gym.envs import tasks
from auv_gym.envs.episodes import Episodes
from auv_gym.envs.kernel.layout import MOST_OBSERVATIONS
from auv_gym.envs.kernel.programs import bind_kernel
from auv_gym.envs.kind import EnvKind, ScaledTask
from auv_gym.envs.kinds import KINDS
from auv_gym.envs.options import (
    check_by_path,
    check_limits,
    check_model_dt,
    check_model_inputs,
    model_of,
    resolve_plant,
)
from auv_gym.envs.plan_numbers import PlanNumbers, source_of
from auv_gym.envs.tasks import Observed, Task
from auv_gym.model import Model
from auv_gym.param import check_number, check_value, did_you_mean, in_unit, replace_at, spec_at
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
    """The episodes that an environment's options describe; raises if the options are inconsistent.

    own: options of the vehicle's kind, see `EnvKind.options`; None counts as not given.
    """
    task, kind, plant = _vehicle_for(task, vehicle, dt)
    scaled = _scaled(task, kind, plant, duration, target, own)
    for given, where in ((effects, "effects="), (randomise, "randomise=")):
        check_by_path(where, given)
        for path in scaled.effects.keys() & (given or {}).keys():
            raise ValueError(
                f"{task.name} needs one value of {path}, got one by {where} and one by an option of its "
                "own: leave one out."
            )
    effects = {**scaled.effects, **(effects or {})}
    driver, owner, ranges = _driven(plant, model, effects, randomise, scaled.randomise)
    if driver is not owner:
        _check_model(driver, plant, scaled)
    observed = _observed(task, scaled, plant)
    numbers = PlanNumbers(kind, owner, scaled, ranges, by_model=driver is not owner)
    return Episodes(
        task=task,
        kind=kind,
        plant=plant,
        driver=driver,
        kernel=bind_kernel(plant.family, kind),
        actions=scaled.actions,
        middles=scaled.middles,
        limits=scaled.limits,
        observations=tuple(o.name for o in observed),
        start_options=scaled.start,
        start_limits=scaled.start_limits,
        target_limits=scaled.target_limits,
        randomise=ranges,
        state_names=numbers.state_names,
        vector=owner.vector.copy(),
        derived=owner.derived.copy(),
        plan=numbers.filled(task, plant, observed, target),
    )


def _vehicle_for(
    task: str | Task, vehicle: str | os.PathLike | Plant | None, dt: float | None
) -> tuple[Task, EnvKind, Plant]:
    """The task in the form for a vehicle's kind, that kind, and the vehicle, with time step dt."""
    if isinstance(task, str):
        if task not in tasks.TASKS:
            raise ValueError(f"No task {task!r}. {did_you_mean(task, tasks.TASKS)}Tasks: {', '.join(tasks.TASKS)}.")
        task = tasks.TASKS[task]
    plant = resolve_plant(task.vehicle if vehicle is None else vehicle, dt)
    task, kind = _task_for(task, plant)
    return task, kind, kind.prepare(plant, dt)


def _scaled(
    task: Task,
    kind: EnvKind,
    plant: Plant,
    duration: float | None,
    target: float | Mapping[str, float] | None,
    own: Mapping[str, Any],
) -> ScaledTask:
    """The task in the units, commands and limits of a vehicle; own: see `make_episodes`."""
    own = {name: value for name, value in own.items() if value is not None}
    for name in own:
        if name not in kind.options:
            known = (*_OPTIONS, *kind.options)
            raise ValueError(
                f"{task.name} has no option {name!r} for {plant.name}. {did_you_mean(name, known)}It has "
                f"{', '.join(known)}."
            )
    if target is not None and task.channel:
        check_number("target", target, "the channel's unit")
    scaled = kind.scale(task, plant, duration=duration, target=target, **own)
    if target is not None:
        given = target if isinstance(target, Mapping) else {task.channel: target}
        check_limits("target", given, scaled.target_limits)
    return scaled


def _observed(task: Task, scaled: ScaledTask, plant: Plant) -> list[Observed]:
    """The observations of an agent, without commands that this vehicle does not have."""
    observed = [o for o in task.observed if o.source not in task.actions or source_of(o, scaled) in scaled.actions]
    observed += scaled.observed
    if len(observed) > MOST_OBSERVATIONS:
        raise ValueError(
            f"{task.name} observes at most {MOST_OBSERVATIONS} numbers, got {len(observed)} with the "
            f"{len(scaled.actions)} actions of {plant.name!r}: name fewer as actions=."
        )
    return observed


def _task_for(task: Task, plant: Plant) -> tuple[Task, EnvKind]:
    """The task in the form for the vehicle's kind, and this kind; raises unless the task supports it."""
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
    """What is simulated, the plant whose parameters compiled code uses (the same, if it can be stepped), and ranges.

    unless_told: default ranges, used if none are given and a vehicle is simulated.
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
        raise ValueError(f"randomise= needs a pair (low, high){in_unit(spec.unit)} for {path}, got {limits!r}.")
    low, high = (check_value(path, value, spec) for value in limits)
    if low > high:
        raise ValueError(f"randomise= needs low <= high for {path}, got ({low:g}, {high:g}).")
    return low, high


def _model(model: Model | str | os.PathLike, plant: Plant) -> Model:
    driver = model_of(model, plant)
    check_model_dt(driver, plant)
    return driver


def _check_model(model: Model, plant: Plant, scaled: ScaledTask) -> None:
    """Raise, naming the missing channel, if a model cannot drive the environment."""
    name = type(model).__name__
    if scaled.least_dt < plant.dt:
        raise ValueError(
            f"Steps of two lengths (near=) are nothing that {name} was made for: leave near= out, or give a plant as "
            "model=."
        )
    needed = [*scaled.read, *(c for fin, read in scaled.read_for.items() if fin in model.inputs for c in read)]
    for channels, what, has in ((needed, "outputs", model.outputs), (scaled.driven, "inputs", model.inputs)):
        for channel in dict.fromkeys(channels):
            if channel not in has:
                raise ValueError(
                    f"model= needs {channel} among its {what}, got {name} with {', '.join(has) or 'none'}: "
                    f"fit it to a record that has {channel}, or splice it into the plant."
                )
    check_model_inputs(model, plant)
