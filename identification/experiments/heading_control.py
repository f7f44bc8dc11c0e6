"""Simulated experiments of a glider under heading control, recorded with sensor noise."""

from __future__ import annotations

from math import floor, pi, radians

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import check_number
from auv_gym.physics.frames import velocity_ned
from auv_gym.plant import Plant, check_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import GliderHull
from controllers.controller import Controller
from controllers.pid import heading_pid
from identification.experiments.excitation import check_generator, prbs, set_point_steps, slow_variation

_PITCH = 0.4  # rad, of a dive or a climb
_TURN = 8.0  # s, time constant of the change from dive to climb
_LEG = (120.0, 300.0)  # s, length of a dive or a climb
_SHALLOWEST = 15.0  # m
_SPEED_VARIATION = 0.3  # of nominal speed
_ROLL_VARIATION = 0.09  # rad
_FASTEST = 4.0  # of nominal speed


def closed_loop(
    plant: Plant,
    controller: Controller | None = None,
    *,
    rng: np.random.Generator,
    duration: float = 600.0,
    compass_noise: float = radians(0.5),
    track_noise: float | None = 1.0,
    gyro_noise: float | None = None,
    speed: float | None = None,
    rudder_excitation: float = 0.3,
    bit_time: float | None = None,
    run_in: float = 30.0,
) -> Record:
    """Simulate a glider that follows steps of its commanded heading, with a PRBS added to the rudder.

    rudder_rad is the command, clipped to the rudder stop, before any effect; the controller (default `heading_pid`)
    acts on the noisy compass. Speed varies slowly by 30 % of nominal (speed: constant, m/s), roll by 0.09 rad; pitch
    and depth follow dives and climbs. All of this is drawn before the run, so a seed gives the same experiment whatever
    the plant's effects. Noises are white, given by standard deviations: compass_noise rad, track_noise m, gyro_noise
    rad/s; None leaves the channels out. rudder_excitation: amplitude of the PRBS relative to the rudder stop; bit_time:
    s, default the larger of 2 samples and 8 s.  run_in: s before the record begins, so that it starts in mid-mission.
    Raises Diverged.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0), duration=300)
        >>> len(log), log.names[:3]
        (76, ('heading_rad', 'rudder_rad', 'heading_cmd_rad'))
    """
    check_vehicle("closed_loop", plant)
    check_generator("closed_loop", rng)
    if not isinstance(plant.hull, GliderHull):
        raise ValueError(
            f"closed_loop needs a vehicle of family 'glider', got {plant.name!r} ({plant.family.name!r}): step "
            "this one in an environment, such as gymnasium.make('auv_gym/Heading-v0', vehicle=...)."
        )
    check_number("duration", duration, "s", above=0.0)
    check_number("run_in", run_in, "s", at_least=0.0)
    check_number("compass_noise", compass_noise, "rad", at_least=0.0)
    for name, noise, unit in (("track_noise", track_noise, "m"), ("gyro_noise", gyro_noise, "rad/s")):
        if noise is not None:
            check_number(name, noise, unit, at_least=0.0)
    if speed is not None:
        check_number("speed", speed, "m/s", above=0.0, at_most=_FASTEST * plant.hull.speed)
    check_number("rudder_excitation", rudder_excitation, "1", at_least=0.0)
    if bit_time is not None:
        check_number("bit_time", bit_time, "s", above=0.0)
    skipped = round(run_in / plant.dt)
    n = floor(duration / plant.dt + 1e-9) + 1 + skipped
    if n < 2 + skipped:
        raise ValueError(f"duration must be at least one sample ({plant.dt:g} s), got {duration:g} s.")
    controller = heading_pid(plant) if controller is None else controller
    time = plant.dt * np.arange(n)
    limit = plant.hull.rudder_limit

    heading = float(rng.uniform(-pi, pi))
    wanted = set_point_steps(time, rng, start=heading)
    hold = max(round((max(2.0 * plant.dt, 8.0) if bit_time is None else bit_time) / plant.dt), 1)
    added = prbs(n, hold, rudder_excitation * limit, rng)
    varying = plant.hull.speed * (1.0 + slow_variation(time, rng, amplitude=_SPEED_VARIATION))
    forward = varying if speed is None else np.full(n, float(speed))
    roll = float(rng.uniform(-0.03, 0.03)) + slow_variation(time, rng, amplitude=_ROLL_VARIATION)
    pitch = _dives(time, rng)
    depth = _depth(time, forward, pitch)
    compass = compass_noise * rng.standard_normal(n)
    track = rng.standard_normal((2, n))
    gyro = rng.standard_normal(n)

    inputs = np.zeros((n, len(plant.inputs)))
    column = {name: index for index, name in enumerate(plant.inputs)}
    for name, values in (("u_mps", forward), ("roll_rad", roll), ("pitch_rad", pitch)):
        inputs[:, column[name]] = values
    outputs = np.empty((n, len(plant.outputs)))
    psi = plant.outputs.index("heading_rad")
    x = plant.initial(np.array([heading if name == "heading_rad" else 0.0 for name in plant.outputs]))
    memory = controller.start()
    for k in range(n):
        outputs[k] = plant.output(x)
        if not np.isfinite(outputs[k]).all():
            bad = plant.outputs[int(np.argmin(np.isfinite(outputs[k])))]
            raise Diverged(float(time[k]), bad, dict(zip(plant.outputs, outputs[max(k - 1, 0)].tolist(), strict=True)))
        reading = {"heading_rad": float(outputs[k, psi] + compass[k]), "dt_s": plant.dt}
        command, memory = controller.act(memory, reading, {"heading_rad": float(wanted[k])})
        inputs[k, 0] = min(max(command["rudder_rad"] + added[k], -limit), limit)
        x = plant.step(x, inputs[k])

    measured = dict(zip(plant.outputs, outputs.T, strict=True))
    channels = {
        "heading_rad": measured["heading_rad"] + compass,
        "rudder_rad": inputs[:, 0],
        "heading_cmd_rad": wanted,
        "u_mps": forward,
        "roll_rad": roll,
        "pitch_rad": pitch,
        "depth_m": depth,
    }
    attrs: dict[str, str | float] = {"source": "simulated", "vehicle": plant.name, "compass_noise_rad": compass_noise}
    if track_noise is not None:
        channels["north_m"] = measured["north_m"] + track_noise * track[0]
        channels["east_m"] = measured["east_m"] + track_noise * track[1]
        attrs["track_noise_m"] = track_noise
    if gyro_noise is not None:
        channels["r_radps"] = measured["r_radps"] + gyro_noise * gyro
        attrs["gyro_noise_radps"] = gyro_noise
    recorded = {name: values[skipped:] for name, values in channels.items()}
    return Record.from_arrays(time[: n - skipped], recorded, attrs=attrs)


def _dives(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pitch of dives (bow down, negative) and climbs of drawn lengths, rad, shape (n,)."""
    wanted = np.full(time.size, -_PITCH)
    change, side = time[0] + rng.uniform(*_LEG), 1.0
    while change <= time[-1]:
        wanted[time >= change] = side * _PITCH
        change, side = change + rng.uniform(*_LEG), -side
    pitch = wanted.copy()
    for k in range(1, time.size):
        share = 1.0 - np.exp(-(time[k] - time[k - 1]) / _TURN)
        pitch[k] = pitch[k - 1] + share * (wanted[k] - pitch[k - 1])
    return pitch


def _depth(time: np.ndarray, forward: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """Depth of a glider that moves along its axis, constant speed over a sample, m, shape (n,); at least 15 m."""
    _, _, sinking = velocity_ned(forward, 0.0, 0.0, 0.0, pitch, 0.0)
    depth = np.concatenate([[0.0], np.cumsum(sinking[:-1] * np.diff(time))])
    return depth - depth.min() + _SHALLOWEST
