"""Simulated experiments with vehicles that hover by thrusters, excited by random telegraph signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians
from typing import Any

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.model import Diverged
from auv_gym.param import check_number, did_you_mean
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_ranges
from auv_gym.records.record import Record
from controllers.allocation import AXES
from controllers.autopilots import autopilot
from controllers.composed.allocated import Allocated
from controllers.composed.excited import Excited
from controllers.controller import Controller
from controllers.hovering.dynamics import POSE
from controllers.hovering.law import HoverPid
from controllers.trials.trial import at_rest
from identification.experiments.excitation import make_signal, set_point_steps
from identification.experiments.manoeuvres import NOISE

LOOPS = ("closed", "open")
_ATTITUDE = ("roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps")
MEASURED = {  # outputs that the controller and the record have; None: all
    "all": None,
    "depth": (*_ATTITUDE, "depth_m"),
    "attitude": _ATTITUDE,
}
_POSITION_NOISE = 0.02  # m, of acoustic positioning at close range
_DEPTH = 10.0  # m, where an experiment begins
_HOLD = (10.0, 25.0)  # s between changes of a set point
_STEPS = {"north_m": (0.5, 2.0), "east_m": (0.5, 2.0), "depth_m": (0.5, 1.5), "heading_rad": (0.5, 1.5)}
# how far a lasting excitation may push a vehicle against its control loop or righting moment: beyond that, the
# vehicle's axes tilt, and the responses along different axes would mix
_PUSHED = {**dict.fromkeys(AXES[:3], 0.3), **dict.fromkeys(AXES[3:5], 0.15), "yaw_Nm": 0.5}  # m, rad
_TILTED = 0.3  # rad, RMS, in open loop
_DWELL = 2.0  # times 1 / frequency of the fastest loop


def hover(
    plant: Plant,
    *,
    rng: np.random.Generator,
    duration: float = 300.0,
    loop: str = "closed",
    amplitude: float = 0.15,
    dwell: float | None = None,
    axes: Sequence[str] | None = None,
    measured: str = "all",
    compass_noise: float = radians(0.5),
    depth_noise: float = 0.02,
    noise: float = 1.0,
    under_way: Any = None,
) -> Record:
    """A record of a vehicle with thrusters under random telegraph signals.

    loop: "closed": the PID autopilot follows random steps of position, depth and heading with roll and pitch level, and
    an independent signal is added to the wrench along each axis.  "open": there is no controller, and an independent
    signal moves each thruster about the thrust that carries the vehicle's weight.
    amplitude: relative to the authority along an axis, or of a thruster; reduced if a lasting push would carry the
    vehicle off or tilt it far; 0: none.  dwell: s, mean time between changes of a signal, default twice 1 / frequency
    of the fastest loop.  axes: to excite in closed loop, default all that the thrusters serve and a sensor shows.
    measured: "all", "depth" (attitude, rates and depth) or "attitude" (and rates); only measured channels are
    controlled.  Noises are white, given by standard deviations: compass_noise rad, depth_noise m; all sensors' noises
    are multiplied by `noise`.  under_way: moves in the plant's place.
    Everything is drawn before the run: a seed gives the same experiment whatever the plant's effects.  In addition to
    the commands, the record has the wrench that thrusters without effects would make of them (`surge_N` to `yaw_Nm`),
    the input of a linear model of the motion.  Raises ValueError, Diverged.
    """
    _check(plant, loop, amplitude, measured)
    check_number("duration", duration, "s", above=0.0)
    n = round(duration / plant.dt) + 1
    if n < 3:
        raise ValueError(f"duration must be at least two samples ({2 * plant.dt:g} s), got {duration:g} s.")
    seen = MEASURED[measured]
    outputs = plant.outputs if seen is None else tuple(name for name in plant.outputs if name in seen)
    time = plant.dt * np.arange(n)
    targets = tuple(name for name in _STEPS if name in outputs)
    steered = autopilot(plant, "pid", targets or None)
    assert isinstance(steered, Allocated)
    start = {"depth_m": _DEPTH, "heading_rad": float(rng.uniform(-pi, pi))}
    wanted = {
        name: _bounded(set_point_steps(time, rng, start=start.get(name, 0.0), hold=_HOLD, step=_STEPS[name]), name)
        for name in targets
    }
    seconds = _dwell(steered, plant.dt) if dwell is None else dwell
    settings: dict[str, Any] = {"dwell_s": seconds, "n": n, "dt": plant.dt, "rng": rng}
    if loop == "closed":
        chosen = _excited_axes(steered, outputs, axes)
        signals = {name: _signal(_size(steered, name, amplitude), **settings) for name in chosen}
        controller: Controller = Excited(steered, {k: v for k, v in signals.items() if v.any()}, plant.dt)
    else:
        wanted = {}
        controller = _open_loop(steered, amplitude, settings)
    sizes = _noise(outputs, compass_noise, depth_noise)
    errors = noise * np.array([sizes[name] for name in outputs]) * rng.standard_normal((n, len(outputs)))
    channels = _run(under_way or plant, controller, wanted, time, outputs, errors, start)
    pushes = np.array([steered.thrusters.thrusts(row) for row in np.stack([channels[c] for c in steered.commands]).T])
    channels |= dict(zip(AXES, (pushes @ steered.allocation.matrix.T).T, strict=True))
    attrs: dict[str, Any] = {"source": "simulated", "vehicle": plant.name, "loop": loop, "dwell_s": seconds}
    return Record.from_arrays(time, channels, attrs=attrs)


def _check(plant: Plant, loop: str, amplitude: float, measured: str) -> None:
    body = plant.family.body
    if body is None or not body.thrusters:
        raise ValueError(
            f"hover needs a vehicle with thrusters, got {plant.name!r} of family {plant.family.name!r}: take one such "
            "as 'bluerov2_heavy'."
        )
    for name, given, known in (("loop", loop, LOOPS), ("measured", measured, tuple(MEASURED))):
        if given not in known:
            raise ValueError(
                f"hover needs {name} among {', '.join(known)}, got {given!r}. {did_you_mean(given, known)}"
            )
    if not 0.0 <= amplitude <= 1.0:
        raise ValueError(f"hover needs an amplitude from 0 to 1, a share of what thrusters can do, got {amplitude!r}.")


@dataclass(frozen=True, eq=False)
class Unsteered:
    """A controller with constant commands, whatever the readings and targets."""

    constant: dict[str, float]

    @property
    def commands(self) -> tuple[str, ...]:
        return tuple(self.constant)

    def start(self) -> None:
        return None

    def act(self, state: None, reading: Any, target: Any) -> tuple[dict[str, float], None]:
        return dict(self.constant), None


def _open_loop(steered: Allocated, amplitude: float, settings: dict[str, Any]) -> Controller:
    """A controller that switches each thruster between two thrusts around the one that carries the weight."""
    law, allocation, thrusters = steered.controller, steered.allocation, steered.thrusters
    assert isinstance(law, HoverPid)
    trim = allocation.share(law.dynamics.resistance(np.zeros(6), 0.0, 0.0, _DEPTH)).thrusts
    low, high = allocation.limits
    sizes = amplitude * np.minimum(high - trim, trim - low)
    arms, stiffness = allocation.matrix[3:5], law.dynamics.stiffness[3:5]
    for i in range(2):
        moment = float(np.hypot.reduce(arms[i] * sizes))  # RMS of independent signals
        if stiffness[i] > 0.0 and moment > _TILTED * stiffness[i]:
            sizes = np.where(np.abs(arms[i]) > 1e-9, sizes * _TILTED * stiffness[i] / moment, sizes)
    constant, signals = {}, {}
    for i, name in enumerate(thrusters.channels):
        side = _signal(1.0 if sizes[i] > 0.0 else 0.0, **settings)
        pushes = [_one_command(thrusters, trim, i, trim[i] + sign * sizes[i]) for sign in (-1.0, 1.0)]
        constant[name] = 0.5 * (pushes[0] + pushes[1])
        signals[name] = 0.5 * (pushes[1] - pushes[0]) * side
    return Excited(Unsteered(constant), {k: v for k, v in signals.items() if v.any()}, settings["dt"])


def _one_command(thrusters: Any, trim: np.ndarray, index: int, thrust: float) -> float:
    changed = trim.copy()
    changed[index] = thrust
    return float(thrusters.commands(changed)[index])


def _signal(amplitude: float, *, dwell_s: float, n: int, dt: float, rng: np.random.Generator) -> np.ndarray:
    """A telegraph signal; it is drawn even for amplitude zero, so that later draws do not change."""
    drawn = make_signal("telegraph", n, dt, rng, amplitude=1.0, dwell_s=dwell_s)
    return amplitude * drawn


def _dwell(steered: Allocated, dt: float) -> float:
    assert isinstance(steered.controller, HoverPid)
    return max(_DWELL / float(steered.controller.gains.pace.frequency.max()), 2.0 * dt)


def _excited_axes(steered: Allocated, outputs: Sequence[str], axes: Sequence[str] | None) -> tuple[str, ...]:
    """The axes that thrusters serve and a measured channel shows; raises if other axes are requested."""
    placed = all(name in outputs for name in POSE[:2])
    shown = [placed, placed, placed or "depth_m" in outputs, True, True, True]
    served = tuple(name for name, here in zip(AXES, shown) if here and name in steered.allocation.counts)
    chosen = served if axes is None else tuple(axes)
    for name in chosen:
        if name not in served:
            raise ValueError(
                f"hover cannot excite {name!r}: the thrusters serve, and sensors show, {', '.join(served)}. "
                f"{did_you_mean(name, served)}"
            )
    return chosen


def _size(steered: Allocated, axis: str, share: float) -> float:
    """The amplitude of a signal along an axis: a share of its authority, limited by how far it may push the vehicle."""
    law = steered.controller
    assert isinstance(law, HoverPid)
    i = AXES.index(axis)
    held = float(law.gains.proportional[i] + law.dynamics.stiffness[i]) * _PUSHED[axis]
    return min(share * float(law.dynamics.authority[i]), held)


def _bounded(values: np.ndarray, name: str) -> np.ndarray:
    """Depths mirrored to stay between half and twice the first depth; other channels unchanged."""
    if name != "depth_m":
        return values
    low, width = 0.5 * _DEPTH, 1.5 * _DEPTH
    return low + np.abs((values - low + width) % (2.0 * width) - width)


def _noise(outputs: Sequence[str], compass: float, depth: float) -> dict[str, float]:
    """Standard deviations of the sensors by output."""
    of = {
        **dict.fromkeys(("roll_rad", "pitch_rad"), NOISE["inclinometer"]),
        **dict.fromkeys(("p_radps", "q_radps", "r_radps"), NOISE["gyros"]),
        **dict.fromkeys(("u_mps", "v_mps", "w_mps"), NOISE["dvl_water"]),
        **dict.fromkeys(("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), NOISE["dvl_ground"]),
        **dict.fromkeys(("north_m", "east_m"), _POSITION_NOISE),
        "heading_rad": compass,
        "depth_m": depth,
    }
    return {name: of.get(name, 0.0) for name in outputs}


def _run(
    plant: Plant,
    controller: Controller,
    wanted: dict[str, np.ndarray],
    time: np.ndarray,
    outputs: Sequence[str],
    errors: np.ndarray,
    start: dict[str, float],
) -> dict[str, np.ndarray]:
    """The channels of a run: readings, commands as the vehicle gets them, set points and reports."""
    ranges = command_ranges(plant)
    commanded = plant.family.actuators
    x, u = at_rest(plant, start)
    at = [plant.outputs.index(name) for name in outputs]
    clock = [k for k, name in enumerate(plant.inputs) if name == "elapsed_s"]  # effects that grow with time need it
    n, memory = time.size, controller.start()
    readings, inputs = np.empty((n, len(at))), np.empty((n, len(commanded)))
    reports: list[dict[str, float]] = []
    for k in range(n):
        y = plant.output(x)
        if not np.isfinite(y).all():
            bad = plant.outputs[int(np.argmin(np.isfinite(y)))]
            raise Diverged(float(time[k]), bad, dict(zip(outputs, readings[max(k - 1, 0)].tolist(), strict=True)))
        readings[k] = y[at] + errors[k]
        reading = dict(zip(outputs, readings[k].tolist(), strict=True))
        target = {name: float(values[k]) for name, values in wanted.items()}
        command, memory = controller.act(memory, {**reading, "dt_s": plant.dt}, target)
        given = np.array([command[name] for name in commanded])
        u[: len(commanded)] = np.clip(given, ranges[:, 0], ranges[:, 2])
        inputs[k] = u[: len(commanded)]
        u[clock] = time[k]
        reports.append({name: value for name, value in command.items() if name not in commanded})
        x = plant.step(x, u)
    return {
        **dict(zip(outputs, readings.T, strict=True)),
        **dict(zip(commanded, inputs.T, strict=True)),
        **{set_point_of(name): values for name, values in wanted.items()},
        **{name: np.array([row[name] for row in reports]) for name in reports[0]},
    }
