"""Environment: hold and change the heading of an underwater glider with its rudder."""

from __future__ import annotations

import os
from collections.abc import Mapping
from math import cos, isfinite, pi, radians, sin
from typing import Any

import gymnasium
import numpy as np

from auv_gym.envs.options import check_model_dt, check_model_inputs, check_number, model_of, vehicle_of
from auv_gym.model import Model
from auv_gym.param import replace_at
from auv_gym.plant import Plant, without_effects

_STEP = (radians(20.0), radians(70.0))  # size of a drawn change of the target, rad; the sign is drawn too
_HOLD = (60.0, 180.0)  # time between drawn changes, s; the slowest preset turns 45 deg in 72 s
HEADING_LIMIT = 1e6  # rad; beyond it a heading no longer resolves an angle well, and the run counts as diverged
RUDDER_TRAVEL_WEIGHT = 0.05
OBSERVATIONS = ("error_sin", "error_cos", "turn_rate", "rudder", "speed")


class GliderHeading(gymnasium.Env):
    """The heading task; times in s, angles in rad, one step of the environment is `dt`.

    Action, one number in [-1, 1]: rudder command over the rudder stop.  Observation, all in [-1, 1] and clipped:
    0, 1 sine, cosine of heading error: target minus measured heading.
    2 change of the measured heading over the last sample, over twice the steady turn at full rudder.
    3 last command over the rudder stop.
    4 speed through the water over nominal speed, minus 1.
    Reward, in [-1.05, 0] a step: -|true heading error| / pi - 0.05 |change of action| / 2, by term in
    `info["reward_terms"]`; a run that diverges terminates and pays -1.05 for each step that was left.
    info: time_s, target_rad, reading_rad, heading_rad (true), rudder_rad (command), speed_mps, state by name, reason;
    target, reading and command once more by channel, as in the other environments.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        vehicle: str | os.PathLike | Plant = "slocum",
        *,
        effects: Mapping[str, float] | None = None,
        model: Model | str | os.PathLike | None = None,
        dt: float | None = None,
        duration: float = 600.0,
        compass_noise: float = 0.0,
        target: float | None = None,
        speed: float | tuple[float, float] | None = None,
        render_mode: str | None = None,
    ):
        """An environment of a preset, a vehicle file or a plant; raises on what does not fit together.

        effects: values by parameter path, such as {"effects.rudder.offset": 0.05}.  model: drives the environment in
        place of the plant, a Model or its file.  dt: s, default the vehicle's.  compass_noise: standard deviation, rad.
        target: fixed heading, rad; by default it changes in steps drawn from the generator.
        speed: m/s, or a range from which each episode draws one; default the vehicle's nominal speed.
        """
        plant = vehicle_of(vehicle, dt)
        if plant.family.name != "glider":
            raise ValueError(
                f"GliderHeading needs a vehicle of family 'glider', got {plant.name!r} of family {plant.family.name!r}."
            )
        if effects and model is not None:
            raise ValueError("effects= change the vehicle, which model= replaces: give one of the two.")
        if effects:
            plant = replace_at(plant, dict(effects))
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"GliderHeading has render_mode None or 'rgb_array', got {render_mode!r}.")
        check_number("duration", duration, "s", above=0.0)
        check_number("compass_noise", compass_noise, "rad", at_least=0.0)
        if target is not None:
            check_number("target", target, "rad")
        self.plant = plant
        self.model = plant if model is None else _checked(model_of(model, plant), plant)
        self.duration, self.compass_noise, self.target = float(duration), float(compass_noise), target
        self.speed_range = _speed_range(speed, plant.hull.speed)
        self.render_mode = render_mode
        self.rudder_limit = plant.hull.rudder_limit
        self.turn_rate_scale = 2.0 * _steady_turn_rate(plant)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (len(OBSERVATIONS),), np.float32)
        self.steps = max(round(self.duration / plant.dt), 1)
        self.heading_at = self.model.outputs.index("heading_rad")
        self.rudder_at = self.model.inputs.index("rudder_rad")
        self.speed_at = self.model.inputs.index("u_mps") if "u_mps" in self.model.inputs else None
        constants = {**plant.constants, **getattr(self.model, "constants", {})}
        self.inputs = np.array([constants.get(name, 0.0) for name in self.model.inputs])
        states = list(self.model.states)
        self.true_heading_at = states.index("heading_rad") if "heading_rad" in states else None
        self._position = [states.index(name) for name in ("north_m", "east_m") if name in states]
        self._terminated = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """The first observation and info of an episode with a heading drawn from the whole circle.

        options: `heading` (as the compass gives it) and `target`, rad, take the place of the drawn first ones.
        """
        super().reset(seed=seed)
        options = options or {}
        check_reset_options(options)
        drawn = float(self.np_random.uniform(-pi, pi))
        heading = float(options.get("heading", drawn))
        low, high = self.speed_range
        self._speed = float(self.np_random.uniform(low, high))
        self._target = heading if self.target is None else self.target
        self._change_at = 0.0
        self._time, self._count, self._action = 0.0, 0, 0.0
        u = self.inputs.copy()
        if self.speed_at is not None:
            u[self.speed_at] = self._speed
        self._u = u
        start = np.where(np.arange(len(self.model.outputs)) == self.heading_at, heading, 0.0)
        self._x = np.asarray(self.model.initial(start), dtype=float)
        self._advance_target()
        if "target" in options:
            self._target = float(options["target"])
        self._reading = self._read()
        self._rate = 0.0
        self._terminated = False
        self._track = (0.0, 0.0)
        self._trail = [self._track]
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info one sample later; actions beyond [-1, 1] are clipped."""
        if self._terminated:
            raise gymnasium.error.ResetNeeded("The episode has ended or not begun: call reset() before step().")
        value = float(np.asarray(action, dtype=float).reshape(-1)[0]) if np.size(action) == 1 else float("nan")
        if not isfinite(value):
            raise ValueError(f"An action needs one finite number in [-1, 1], got {action!r}.")
        value = min(max(value, -1.0), 1.0)
        change, self._action = abs(value - self._action), value
        self._u[self.rudder_at] = value * self.rudder_limit
        x = np.asarray(self.model.step(self._x, self._u), dtype=float)
        self._count += 1
        self._time = self._count * self.model.dt
        reason = self.fault(x, self._time)
        if reason:
            self._terminated = True
            left = self.steps - self._count + 1
            terms = {"heading": -1.0 * left, "rudder_travel": -RUDDER_TRAVEL_WEIGHT * left}
            return self._observation(), sum(terms.values()), True, False, self._info(terms, reason)
        self._x = x
        reading = self._read()
        self._rate = wrapped(reading - self._reading) / self.model.dt
        self._reading = reading
        # The target is the one that the action was chosen for; a new one counts from the next step.
        terms = {
            "heading": -abs(wrapped(self._target - self._heading_now())) / pi,
            "rudder_travel": -RUDDER_TRAVEL_WEIGHT * 0.5 * change,
        }
        self._advance_target()
        self._move()
        truncated = self._count >= self.steps
        self._terminated = truncated
        return self._observation(), sum(terms.values()), False, truncated, self._info(terms)

    def action_for(self, command: Mapping[str, float]) -> np.ndarray:
        """The action that gives a command of `rudder_rad`, shape (1,)."""
        return np.array([command["rudder_rad"] / self.rudder_limit])

    def render(self) -> np.ndarray | None:
        """A plan view as an RGB image, shape (height, width, 3), uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        from auv_gym.rendering.glider_view import draw_plan_view  # needs the extra `render`

        return draw_plan_view(
            np.array(self._trail),
            heading=self._heading_now(),
            target=self._target,
            rudder=self._action * self.rudder_limit,
            rudder_limit=self.rudder_limit,
            caption=f"{self.plant.name}   t = {self._time:.0f} s   {self._speed:.2f} m/s",
        )

    def _read(self) -> float:
        reading = float(self.model.output(self._x)[self.heading_at])
        return reading + self.compass_noise * float(self.np_random.standard_normal())

    def _heading_now(self) -> float:
        if self.true_heading_at is None:
            return float(self.model.output(self._x)[self.heading_at])
        return float(self._x[self.true_heading_at])

    def fault(self, x: np.ndarray, time: float) -> str:
        """Why a state at a time, s, ends the run, or nothing."""
        if not np.isfinite(x).all():
            return f"diverged at {time:g} s: {self.model.states[int(np.argmin(np.isfinite(x)))]} is not finite"
        heading = float(self.model.output(x)[self.heading_at])
        if not abs(heading) < HEADING_LIMIT:
            return f"diverged at {time:g} s: heading_rad is {heading:.3g}"
        return ""

    def _advance_target(self) -> None:
        if self.target is None and self._time >= self._change_at - 1e-9:
            self._target, self._change_at = draw_change(self.np_random, self._target, self._time)

    def _move(self) -> None:
        if self.render_mode is None:
            return
        if len(self._position) == 2:
            self._track = (float(self._x[self._position[0]]), float(self._x[self._position[1]]))
        else:  # dead reckoning, for a model of heading alone
            run, heading = self._speed * self.model.dt, self._heading_now()
            self._track = (self._track[0] + run * cos(heading), self._track[1] + run * sin(heading))
        self._trail.append(self._track)

    def _observation(self) -> np.ndarray:
        error = self._target - self._reading
        values = (
            sin(error),
            cos(error),
            self._rate / self.turn_rate_scale,
            self._action,
            self._speed / self.plant.hull.speed - 1.0,
        )
        return np.array([min(max(value, -1.0), 1.0) for value in values], dtype=np.float32)

    def _info(self, terms: Mapping[str, float] | None = None, reason: str = "") -> dict[str, Any]:
        rudder = self._action * self.rudder_limit
        return {
            "time_s": self._time,
            "target_rad": self._target,
            "reading_rad": self._reading,
            "heading_rad": self._heading_now(),
            "rudder_rad": rudder,
            "speed_mps": self._speed,
            "target": {"heading_rad": self._target},
            "reading": {"heading_rad": self._reading, "u_mps": self._speed},
            "command": {"rudder_rad": rudder},
            "state": dict(zip(self.model.states, self._x.tolist(), strict=True)),
            "reward_terms": dict(terms or {"heading": 0.0, "rudder_travel": 0.0}),
            "reason": reason,
        }


def _checked(model: Model, plant: Plant) -> Model:
    """The model, if it can drive the environment; raises with the call that would help."""
    name = type(model).__name__
    if "heading_rad" not in model.outputs:
        raise ValueError(
            f"model= needs heading_rad among its outputs, got {name} with {', '.join(model.outputs) or 'none'}: "
            "fit it to a record that has heading_rad."
        )
    if "rudder_rad" not in model.inputs:
        raise ValueError(
            f"model= needs rudder_rad among its inputs, got {name} with {', '.join(model.inputs) or 'none'}: "
            "fit it to a record that has rudder_rad."
        )
    check_model_inputs(model, plant)
    check_model_dt(model, plant)
    return model


def _steady_turn_rate(plant: Plant) -> float:
    """Yaw rate after ten minutes of full rudder without effects, rad/s: so that no effect changes the observations."""
    clean = without_effects(plant)
    u = np.array([clean.constants.get(name, 0.0) for name in clean.inputs])
    u[clean.inputs.index("rudder_rad")] = clean.hull.rudder_limit
    turned = clean.step_over(clean.initial(np.zeros(len(clean.outputs))), u, 600.0)
    rate = abs(float(clean.output(turned)[clean.outputs.index("r_radps")]))
    if not rate > 1e-9 or not isfinite(rate):
        raise ValueError(f"The rudder of {plant.name!r} does not turn the vehicle: check hull.n_delta and hull.n_r.")
    return rate


def _speed_range(speed: float | tuple[float, float] | None, nominal: float) -> tuple[float, float]:
    low, high = (nominal, nominal) if speed is None else speed if isinstance(speed, tuple | list) else (speed, speed)
    check_number("speed", low, "m/s", above=0.0)
    check_number("speed", high, "m/s", at_least=low)
    return float(low), float(high)


def check_reset_options(options: Mapping[str, Any]) -> None:
    """Raises unless these are options that `reset` has."""
    for name, value in options.items():
        if name not in ("heading", "target"):
            raise ValueError(f"reset has the options 'heading' and 'target', got {name!r}.")
        check_number(f"reset option {name!r}", value, "rad")


def draw_change(generator: np.random.Generator, target: float, time: float) -> tuple[float, float]:
    """The target after this one, rad, and when the one after it comes, s."""
    size = generator.uniform(*_STEP) * (1.0 if generator.random() < 0.5 else -1.0)
    return float(wrapped(target + size)), time + float(generator.uniform(*_HOLD))


def wrapped(angle: Any) -> Any:
    """An angle, or angles, from -pi to pi."""
    return (angle + pi) % (2.0 * pi) - pi
