"""One episode of an environment driven by a controller, recorded as measurements and true states."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import gymnasium
import numpy as np

from auv_gym import __version__
from auv_gym.channels import CHANNELS, set_point_of
from auv_gym.envs.task_env import TaskEnv
from auv_gym.param import did_you_mean
from auv_gym.records.record import Record
from controllers.composed.excited import added_by
from controllers.composed.loops import targets_of
from controllers.controller import Controller

Steps = Mapping[str, Sequence[tuple[float, float]]]


@dataclass(frozen=True, eq=False)
class Run:
    """The result of a driven episode.

    record: readings, commands, set points (`depth_cmd_m`), and the controller's reports.  truth: the true states at the
    same times.  reason: why the episode was cut short; empty if it ran to its end.
    """

    record: Record
    truth: Record
    reason: str


def drive(
    env: gymnasium.Env,
    controller: Controller,
    *,
    seed: int,
    targets: Steps | None = None,
    start: Mapping[str, float] | None = None,
) -> Run:
    """Run one episode and record it; a row has the reading at its time and the command held until the next row.

    Commands are those that the vehicle received, after clipping, including those of fins that the environment itself
    controls.  If the episode ran to its end, the last row repeats the last command; if it was cut short, the final
    reading is left out.
    seed: of the environment's generator.  targets: (time s, value) by channel, each value from its time on, the first
    from 0 s; channels not named keep the environment's own target.  start: values of the initial state.
    Raises ValueError if controller and environment do not match, or if the episode is cut short within two samples.

    Example:

        >>> import gymnasium
        >>> from auv_gym import load_vehicle
        >>> from controllers import heading_pid
        >>> from identification import drive
        >>> env = gymnasium.make("auv_gym/GliderHeading-v0", vehicle="slocum", duration=120.0)
        >>> run = drive(env, heading_pid(load_vehicle("slocum")), seed=0)
        >>> len(run.record), run.reason
        (31, '')
    """
    steps = {name: checked_steps(name, given) for name, given in (targets or {}).items()}
    actions = commanded(env)
    inner: Any = env.unwrapped
    check_followed(controller, steps)
    _, info = env.reset(seed=seed, options={"start": dict(start)} if start else None)
    memory = controller.start()
    rows: list[tuple[float, dict, dict, dict]] = []  # time, reading, target, state
    commands: list[dict] = []  # the commands that the vehicle received, and reports
    known = [name for name in info["state"] if name in CHANNELS]  # leave out the vehicle's memory of its commands
    before, ended, cut = info["time_s"] - info.get("dt_s", inner.plant.dt), False, False
    while True:
        time = info["time_s"]
        reading, target = (
            dict(info["reading"]),
            dict(info["target"]) | {n: _value_at(s, time) for n, s in steps.items()},
        )
        if not cut:
            rows.append((time, reading, target, {name: info["state"][name] for name in known}))
        if ended:
            break
        try:
            command, memory = controller.act(memory, {**reading, "dt_s": time - before}, target)
        except KeyError as error:
            raise ValueError(
                f"The controller needs {error}, which is not among the readings ({', '.join(reading)}) or targets "
                f"({', '.join(target)}) of this episode: give it as a target, or a controller that does without."
            ) from error
        for name in actions:
            if name not in command:
                raise ValueError(
                    f"The environment waits for {name}, and the controller commands {', '.join(command) or 'nothing'}: "
                    "give actions= that the controller knows, or a controller of this channel too."
                )
        before = time
        _, _, cut, over, info = env.step(inner.action_for(command))
        ended = cut or over
        reports = {name: float(value) for name, value in command.items() if name not in inner.plant.inputs}
        commands.append({**reports, **info["command"]})
    if len(rows) < 2:
        raise ValueError(f"The episode was cut within {len(rows)} samples: {info['reason']}.")
    commands += [commands[-1]] * (len(rows) - len(commands))
    return _run(env, rows, commands, seed, info["reason"])


def commanded(env: gymnasium.Env) -> tuple[str, ...]:
    """The inputs that an environment's action commands; raises for an environment of another package."""
    inner: Any = getattr(env, "unwrapped", env)
    if not isinstance(inner, TaskEnv):
        raise ValueError(
            f"A controller drives environments of auv_gym, such as auv_gym/Depth-v0, got {type(inner).__name__}."
        )
    return inner.episodes.actions


def check_followed(controller: Controller, targets: Iterable[str]) -> None:
    """Raise if a controller that lists its targets follows none of this name."""
    followed = (*targets_of(controller), *added_by(controller))
    for name in targets if followed else ():
        if name not in followed:
            raise ValueError(
                f"The controller does not follow a target of {name!r}. {did_you_mean(name, followed)}It follows "
                f"{', '.join(followed)}: leave the target out, or give a controller of this channel."
            )


def checked_steps(name: str, given: Any) -> tuple[tuple[float, float], ...]:
    """The steps of a target; raises unless they are pairs of time and value with times rising from 0 s."""
    try:
        steps = tuple((float(time), float(value)) for time, value in given)
    except (TypeError, ValueError):
        raise ValueError(f"The target of {name} needs pairs of time in s and value, got {given!r}.") from None
    times = [time for time, _ in steps]
    if not steps or times[0] != 0.0 or min(np.diff(times), default=1.0) <= 0.0 or not np.isfinite(steps).all():
        raise ValueError(
            f"The target of {name} needs finite pairs of time in s and value, the first at 0 s and each later than the "
            f"one before, got {given!r}."
        )
    return steps


def versions_used() -> str:
    """The versions of the packages used for a run, for a record's attributes."""
    found = []
    for package in ("numpy", "numba"):
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} none")
    return ", ".join([f"auv-gym {__version__}", *found, f"Python {platform.python_version()}"])


def _value_at(steps: Sequence[tuple[float, float]], time: float) -> float:
    return next(value for begin, value in reversed(steps) if begin <= time + 1e-9)


def _run(
    env: gymnasium.Env, rows: list[tuple[Any, dict, dict, dict]], commands: list[dict], seed: int, reason: str
) -> Run:
    inner: Any = env.unwrapped
    plant = inner.plant
    time = np.array([row[0] for row in rows])
    readings, targets, states = (_columns([row[k] for row in rows]) for k in (1, 2, 3))
    given = {
        name: values
        for name, values in _columns(commands[: len(rows)]).items()
        # leave out inputs that stay constant: a float's environment has ten of them
        if name not in plant.inputs
        or name in (*plant.family.required, *commanded(env))
        or (values != plant.constants.get(name, 0.0)).any()
    }
    wanted = {set_point_of(name): values for name, values in targets.items()}
    attrs: dict[str, Any] = {
        "source": "simulated",
        "env": env.spec.id if env.spec is not None else type(inner).__name__,
        "vehicle": plant.name,
        "seed": seed,
        "versions": versions_used(),
    }
    if reason:
        attrs["reason"] = reason
    record = Record.from_arrays(time, {**readings, **given, **wanted}, attrs=attrs)
    return Run(record, Record.from_arrays(time, states, attrs=attrs), reason)


def _columns(rows: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: np.array([row.get(name, np.nan) for row in rows], dtype=float) for name in names}
