"""Comparison of models with a vehicle in its environment, in closed loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any, cast

import gymnasium
import numpy as np

from auv_gym.channels import channel, set_point_of
from auv_gym.model import Diverged, Model, check_model, in_short
from auv_gym.models.spliced import Spliced, splice
from auv_gym.param import list_paths, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from controllers.controller import Controller
from identification.experiments.driving import Run, Steps, drive


@dataclass(frozen=True)
class Deviation:
    """The deviation of a model's run in an environment from the vehicle's.

    rmse: in the channel's unit.  percent: of the requested step, or of the vehicle's range if there was no step.
    """

    rmse: float
    percent: float


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Runs of the vehicle and of models in its place, with the same controller, seed and targets.

    scales: by channel, the value of 100 %.  failed: by model, why it has no run.
    """

    vehicle: Run
    runs: dict[str, Run]
    scales: dict[str, float]
    failed: dict[str, str]

    @property
    def deviations(self) -> dict[str, dict[str, Deviation]]:
        """The deviation by model and channel, as far as both runs go."""
        return {name: {c: self._deviation(name, c) for c in self.scales} for name in self.runs}

    def difference(self, name: str, channel_name: str) -> tuple[np.ndarray, np.ndarray]:
        """Times, s, and the model's reading minus the vehicle's, as far as both runs go."""
        true, model = self.vehicle.record, self.runs[name].record
        time = true.time[true.time <= model.time[-1] + 1e-9]
        return time, np.interp(time, model.time, model[channel_name]) - true[channel_name][: time.size]

    def _deviation(self, name: str, channel_name: str) -> Deviation:
        rmse = float(np.sqrt(np.mean(self.difference(name, channel_name)[1] ** 2)))
        return Deviation(rmse, 100.0 * rmse / self.scales[channel_name])


def compare_closed(
    make_env: Callable[[Model | None], gymnasium.Env],
    controller: Controller,
    models: Mapping[str, Model],
    *,
    seed: int,
    targets: Steps | None = None,
    start: Mapping[str, float] | None = None,
) -> ClosedLoop:
    """Compare the vehicle in its environment with each model in the vehicle's place, under the same controller.

    make_env: returns the environment with a model in the vehicle's place, or with the vehicle itself for None.  A model
    without some of the vehicle's outputs is spliced into the vehicle, and drives those that it has.  seed, targets,
    start: see `drive`.
    A model that diverges, or that cannot take the vehicle's place, is listed in `failed`.  Raises ValueError if
    make_env plainly ignores the model that it is given.

    Example:

        >>> import gymnasium
        >>> from auv_gym import load_vehicle, replace_at
        >>> from controllers import heading_pid
        >>> from identification import compare_closed
        >>> glider = load_vehicle("slocum")
        >>> def make(model):
        ...     return gymnasium.make("auv_gym/GliderHeading-v0", vehicle="slocum", model=model, duration=120.0)
        >>> bent = replace_at(glider, "effects.rudder.offset", 0.03)
        >>> found = compare_closed(make, heading_pid(glider), {"bent": bent}, seed=0)
        >>> round(found.deviations["bent"]["heading_rad"].rmse, 3)
        0.014
    """
    for name, model in models.items():
        check_model(f"A comparison with {name!r}", model)
    with closing(make_env(None)) as env:
        vehicle = drive(env, controller, seed=seed, targets=targets, start=start)
        inner: Any = env.unwrapped
        plant = inner.plant
    runs, failed = {}, {}
    for name, model in models.items():
        try:
            placed = stand_in(plant, model)
            other = make_env(placed)
        except (ValueError, Diverged) as error:
            failed[name] = str(error)
            continue
        with closing(other):
            check_in_place(other, placed)
            try:
                runs[name] = drive(other, controller, seed=seed, targets=targets, start=start)
            except (ValueError, Diverged) as error:
                failed[name] = str(error)
    return ClosedLoop(vehicle, runs, step_scales(vehicle.record), failed)


def check_in_place(env: gymnasium.Env, model: Model) -> None:
    """Raise if an environment plainly runs something else than the model that it was made with."""
    inner: Any = env.unwrapped
    used = inner.model
    if isinstance(model, Plant) and isinstance(used, Plant) and used.family is model.family:
        # an environment may add noise to what any vehicle measures
        paths = [path for path in list_paths(model) if not path.startswith("effects.sampling.")]
        ignored = any(value_at(used, path) != value_at(model, path) for path in paths)
    else:
        ignored = isinstance(used, Plant) and not isinstance(model, Plant)
    if ignored:
        raise ValueError(
            f"make_env needs to put the model that it is given into the environment, got {in_short(used)} instead: "
            "pass it on, as gymnasium.make(..., model=model)."
        )


def stand_in(plant: Plant, model: Model) -> Model:
    """The model if it has all outputs of the plant; otherwise the plant, with the model driving those that it has.

    For a vehicle without a horizontal position, such as a float, there is nothing to add: the model is used alone.
    """
    alone = isinstance(model, Plant | Spliced) or "north_m" not in plant.states
    if alone or set(plant.outputs) <= set(model.outputs):
        return model
    return cast(Model, splice(plant, model))


def step_scales(record: Record) -> dict[str, float]:
    """The value of 100 %, by channel that moves: the largest step of its set point from its start, or its range."""
    scales = {}
    for name in record.names:
        if channel(name).kind != "motion" or not np.ptp(record[name]) > 0.0:
            continue
        scales[name] = float(np.ptp(record[name]))
        if record.has(set_point_of(name)):
            asked = np.r_[record[name][0], record[set_point_of(name)]]
            largest = float(np.max(np.abs(np.diff(asked[np.isfinite(asked)])), initial=0.0))
            scales[name] = largest or scales[name]
    return scales
