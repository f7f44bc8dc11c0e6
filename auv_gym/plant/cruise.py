"""Steady straight and level flight of a vehicle with fins and a drive, and the gains of the fins that keep it there.

The environments scale observations by the cruise speed, start their episodes in cruise, and use these gains for the
fins that the agent does not move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auv_gym.plant import Plant, without_effects

_DEPTH = 1e3  # m; depth at which the cruise is computed, far below any wave
_DEPTH_ERROR = 1.0  # in lengths: the error for which the regulators use a fin's full travel
_ANGLE_ERROR = 0.3  # rad, the same for angles
_ROLES = {"yaw": "a part that steers in yaw", "pitch": "one that steers in pitch", "surge": "one that drives it"}
_VELOCITIES = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")


@dataclass(frozen=True, eq=False)
class Cruise:
    """Steady straight and level flight without effects, at the propulsion command of the design speed.

    speed: m/s, forward.  state: the family's states, position zero, heading north.  commands: the family's inputs.
    rudder_gains: rudder, rad, per sway velocity, yaw rate and heading error (true minus wanted), subtracted from the
    cruise command.  plane_gains: stern plane per heave velocity, pitch rate, pitch and depth error.
    """

    speed: float
    state: np.ndarray
    commands: np.ndarray
    rudder_gains: np.ndarray
    plane_gains: np.ndarray


@dataclass(frozen=True)
class Helm:
    """Indices of the inputs that steer a vehicle in yaw and pitch and drive it; design: command of the drive."""

    rudder: int
    plane: int
    drive: int
    design: float


def find_helm(plant: Plant) -> Helm:
    """The helm of a plant, the first input of each role; raises if no part has one of the roles."""
    body = plant.family.body
    if body is None:
        raise ValueError(
            f"Level flight needs a vehicle in six degrees of freedom, got {plant.name!r} ({_family(plant)})."
        )
    roles = body.by_role()
    for role, wanted in _ROLES.items():
        if role not in roles:
            raise ValueError(
                f"Level flight needs {wanted}, which {plant.name!r} has not: its inputs are "
                f"{', '.join(plant.inputs) or 'none'}."
            )
    at = {role: plant.inputs.index(roles[role][0]) for role in _ROLES}
    part, _, command = body.commands[at["surge"]]
    own = getattr(plant.parameters.parts, part.name)
    return Helm(at["yaw"], at["pitch"], at["surge"], getattr(own, command.design) if command.design else 0.0)


def _family(plant: Plant) -> str:
    return f"family {plant.family.name!r}"


def find_cruise(plant: Plant) -> Cruise:
    """The cruise of a plant; raises if its fins cannot hold it level at the design propulsion."""
    clean, helm = without_effects(plant), find_helm(plant)
    fins, actuators = [helm.rudder, helm.plane], len(clean.family.actuators)
    ranges = command_ranges(clean)
    names = clean.family.states
    velocities = [names.index(name) for name in _VELOCITIES]
    u, depth = velocities[0], names.index("depth_m")
    free = [*velocities[:3], names.index("roll_rad"), names.index("pitch_rad")]

    def flight(unknown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States and commands for three velocities, roll, pitch, rudder and stern plane."""
        x, commands = np.zeros(len(names)), resting_commands(clean)
        x[depth], x[free] = _DEPTH, unknown[:5]
        commands[fins], commands[helm.drive] = unknown[5:], helm.design
        return x, commands

    def change(x: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """The change of the family's states in a sample, with the actuators at their commands throughout."""
        start = np.zeros(len(clean.states))
        start[: x.size] = x
        for at in (x.size, x.size + actuators, start.size - actuators):  # positions, play, last command
            start[at : at + actuators] = commands[:actuators]
        return clean.step(start, commands)[: x.size] - x

    def residual(unknown: np.ndarray) -> np.ndarray:
        return change(*flight(unknown))[[*velocities, depth]] / clean.dt

    low, high = 1e-3, 20.0  # the speed at which the vehicle starts to slow down is a first guess
    for _ in range(40):
        middle = 0.5 * (low + high)
        faster = residual(np.array([middle, *np.zeros(6)]))[0] > 0.0
        low, high = (middle, high) if faster else (low, middle)
    unknown = np.array([low, *np.zeros(6)])
    for _ in range(30):
        # least squares, because roll is undetermined in a hull without roll stiffness
        move = np.linalg.lstsq(jacobian(residual, unknown), residual(unknown), rcond=1e-10)[0]
        unknown = unknown - move * min(1.0, 0.2 * abs(unknown[0]) / max(np.abs(move).max(), 1e-12))
        if not np.isfinite(unknown).all() or np.abs(move).max() < 1e-10:
            break
    x, commands = flight(unknown)
    limits = command_limits(clean)
    found = np.isfinite(unknown).all() and np.abs(residual(unknown)).max() < 1e-6 and x[u] > 0.0
    moved = commands[:actuators]
    if not found or (moved < ranges[:, 0]).any() or (moved > ranges[:, 2]).any() or not limits[fins].all():
        raise ValueError(
            f"The environments start from level flight, which {plant.name!r} cannot hold with its fins at "
            f"{clean.inputs[helm.drive]} = {helm.design:g}: check the design command, the fins' moments and limits, "
            "and the buoyancy."
        )

    def regulator(channels: tuple[str, ...], fin: int, weights: list[float]) -> np.ndarray:
        """Gains of a fin, rad per unit of the channels, that keep these channels at their cruise values."""
        at = [names.index(name) for name in channels]

        def motion(deviation: np.ndarray) -> np.ndarray:
            moved, fins = x.copy(), commands.copy()
            moved[at] += deviation[:-1]
            fins[fin] += limits[fin] * deviation[-1]
            return deviation[:-1] + change(moved, fins)[at]

        both = jacobian(motion, np.zeros(len(at) + 1))
        return limits[fin] * _linear_quadratic_gains(both[:, :-1], both[:, -1], np.array(weights))

    depth_weight = 1.0 / (_DEPTH_ERROR * clean.hull.length)
    state = x.copy()
    state[depth] = 0.0
    return Cruise(
        speed=float(x[u]),
        state=state,
        commands=commands,
        rudder_gains=regulator(("v_mps", "r_radps", "heading_rad"), helm.rudder, [0.0, 0.0, 1.0 / _ANGLE_ERROR]),
        plane_gains=regulator(
            ("w_mps", "q_radps", "pitch_rad", "depth_m"),
            helm.plane,
            [0.0, 0.0, 1.0 / _ANGLE_ERROR, depth_weight],
        ),
    )


def command_ranges(plant: Plant) -> np.ndarray:
    """The lowest, resting and highest command of each actuator of a body, in its channel's unit, (n, 3)."""
    return plant.family.body.ranges(plant.parameters)


def command_limits(plant: Plant) -> np.ndarray:
    """Half the range of each body actuator's commands, in its channel's unit, (n,); a fin's largest angle."""
    low, _, high = command_ranges(plant).T
    return 0.5 * (high - low)


def command_middles(plant: Plant) -> np.ndarray:
    """The middle of the range of each actuator's commands of a body, in its channel's unit, (n,)."""
    low, _, high = command_ranges(plant).T
    return 0.5 * (low + high)


def resting_commands(plant: Plant) -> np.ndarray:
    """The inputs of a body at which its parts rest, with constants for inputs that no part moves, (n_inputs,)."""
    shared = [plant.constants[name] for name in plant.inputs[len(plant.family.actuators) :]]
    return np.concatenate([command_ranges(plant)[:, 1], shared])


def jacobian(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """The Jacobian of f at x by central differences."""
    steps = 1e-5 * np.eye(x.size)
    return np.array([(f(x + step) - f(x - step)) / 2e-5 for step in steps]).T


def _linear_quadratic_gains(a: np.ndarray, b: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Gains k of u = -k x that minimise the sum of |weights x|^2 + u^2 for the next x = a x + b u.

    The Riccati equation is solved by doubling.  Source: Anderson and Moore 1979, Optimal Filtering, sec. 6.7.
    """
    closed, reach, cost = a, np.outer(b, b), np.diag(weights**2)
    for _ in range(60):
        closed, reach, cost, more = _doubled(closed, reach, cost)
        if np.abs(more).max() < 1e-12 * np.abs(cost).max():
            break
    return b @ cost @ a / (1.0 + b @ cost @ b)


def _doubled(closed: np.ndarray, reach: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, ...]:
    """Closed loop, reach of the command and cost over twice as many steps, and the increase of the cost."""
    inverse = np.linalg.inv(np.eye(len(reach)) + reach @ cost)
    more = closed.T @ cost @ inverse @ closed
    reach = reach + closed @ inverse @ reach @ closed.T
    return closed @ inverse @ closed, reach, cost + more, more
