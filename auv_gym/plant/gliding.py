"""Steady glides of a vehicle in six degrees of freedom that is moved only by its volume and its masses.

The environments scale observations by these glides and start their episodes in one; autopilots take their gains from
them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import asin, atan2, cos, sin

import numpy as np

from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import command_ranges, jacobian, resting_commands

PITCH = 0.4  # rad, its usual pitch: bow up in a climb, bow down in a dive, as of gliders that fly by a polar
DEPTH = 30.0  # m, its usual depth
_MOMENT = 1e-3  # s, over which accelerations are computed: in steady motion they are zero over any time
_FASTEST = 20.0  # m/s, above every glide
_MOVE = 0.2  # m/s, rad or m, the largest change of a guess in one step
_STEADY = 1e-7  # m/s^2 and rad/s^2, tolerance for the residual
_WANTED = {"volume": "that changes its volume", "slide": "that slides in it", "turn": "that turns in it"}


@dataclass(frozen=True)
class Masses:
    """Indices of the inputs that change a vehicle's volume, slide a mass and turn a mass."""

    volume: int
    slide: int
    turn: int


@dataclass(frozen=True, eq=False)
class Glide:
    """A steady glide or spiral without effects.

    state: the family's states, north and east zero, heading north.  commands: the family's inputs.  pitch: rad.
    turn: rate of turn of the heading, rad/s.
    """

    state: np.ndarray
    commands: np.ndarray
    pitch: float
    turn: float

    @property
    def speed(self) -> float:
        """Speed through the water, m/s."""
        return float(np.linalg.norm(self.state[:3]))

    @property
    def path(self) -> float:
        """Angle of the path through the water, rad, positive up."""
        u, v, w, roll, pitch = (float(self.state[k]) for k in (0, 1, 2, 9, 10))
        return asin((u * sin(pitch) - (v * sin(roll) + w * cos(roll)) * cos(pitch)) / self.speed)

    @property
    def attack(self) -> float:
        """Angle of attack, rad."""
        return atan2(self.state[2], self.state[0])


def find_masses(plant: Plant) -> Masses:
    """The inputs that move a plant's volume and masses, the first of each; raises if no part has one of them."""
    body = plant.family.body
    moved = {} if body is None else body.by_inside()
    for inside, wanted in _WANTED.items():
        if inside not in moved:
            raise ValueError(
                f"A glide needs a part {wanted}, which {plant.name!r} has not: its inputs are "
                f"{', '.join(plant.inputs) or 'none'}."
            )
    return Masses(*(plant.inputs.index(moved[inside][0]) for inside in _WANTED))


def neutral_volume(plant: Plant, depth: float) -> float:
    """The volume, m^3, with which a plant without its effects rests level at a depth, m.

    Raises if the engine cannot reach it.
    """
    clean, masses = without_effects(plant), find_masses(plant)
    names = clean.family.states
    moved, roll = [masses.volume, masses.slide], names.index("roll_rad")
    low, _, high = command_ranges(clean)[masses.volume]

    def residual(unknown: np.ndarray) -> np.ndarray:
        """Accelerations for a share of the engine's range, a position of the sliding mass, and roll."""
        x, commands = _at(clean, depth), resting_commands(clean)
        x[roll], commands[moved] = unknown[2], (low + unknown[0] * (high - low), unknown[1])
        return _accelerations(clean, x, commands)

    share = float(_solved(residual, np.array([0.5, 0.0, 0.0]))[0])
    if not 0.0 < share < 1.0:
        raise ValueError(
            f"The engine of {plant.name!r} cannot take it down and up at {depth:g} m: it goes from {low:g} to {high:g} "
            "m^3, where no volume is neutral: check hull.mass, hull.buoyancy and the masses."
        )
    return float(low + share * (high - low))


def steady_glide(plant: Plant, volume: float, pitch: float, depth: float, turned: float = 0.0) -> Glide:
    """The steady glide of a plant without its effects, with a volume, m^3, at a pitch, rad, and a depth, m.

    turned: angle of the turning mass, rad: 0 gives a straight glide, others a spiral.  Raises if no position of the
    sliding mass gives this pitch.  Solves six equations of motion with zero accelerations by Newton's method.
    """
    clean, masses = without_effects(plant), find_masses(plant)
    roll_at = clean.family.states.index("roll_rad")

    def motion(unknown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State and commands for three velocities, roll, position of the mass and rate of turn."""
        x, commands = _at(clean, depth), resting_commands(clean)
        roll, turn = unknown[3], unknown[5]
        x[:3], x[roll_at : roll_at + 2] = unknown[:3], (roll, pitch)
        x[3:6] = turn * np.array([-sin(pitch), sin(roll) * cos(pitch), cos(roll) * cos(pitch)])
        commands[[masses.volume, masses.slide, masses.turn]] = volume, unknown[4], turned
        return x, commands

    def residual(unknown: np.ndarray) -> np.ndarray:
        return _accelerations(clean, *motion(unknown))

    low, high = 1e-3, _FASTEST  # the speed at which it starts to slow down is a first guess
    for _ in range(40):
        middle = 0.5 * (low + high)
        faster = residual(np.array([middle, *np.zeros(5)]))[0] > 0.0
        low, high = (middle, high) if faster else (low, middle)
    unknown = _solved(residual, np.array([low, *np.zeros(5)]))
    least, _, most = command_ranges(clean)[masses.slide]
    glide = Glide(*motion(unknown), pitch, float(unknown[5]))
    found = np.isfinite(unknown).all() and np.abs(residual(unknown)).max() < _STEADY and unknown[0] > 0.0
    # beyond the end of the mass's travel, no pitch is steady; a stall, sinking bow up, is steady, too
    if not found or glide.path * pitch <= 0.0:
        raise ValueError(
            f"{plant.name!r} has no steady glide at a pitch of {pitch:.3g} rad with a volume of {volume:.4g} m^3: "
            f"{clean.inputs[masses.slide]} goes from {least:g} to {most:g} m. Check its lift, its drag and the masses, "
            "or take another pitch."
        )
    return glide


def usual_glide(plant: Plant, side: float, depth: float = DEPTH) -> Glide:
    """The straight steady dive (side -1) or climb (side 1) at the usual pitch, at the engine's limit, at a depth, m.

    Raises if there is none, as `neutral_volume` and `steady_glide` do.
    """
    neutral = neutral_volume(plant, depth)
    return steady_glide(plant, neutral + side * _half_about(plant, neutral), side * PITCH, depth)


def engine_half(plant: Plant, depth: float) -> float:
    """The volume, m^3, that a plant's engine can move to both sides of neutral at a depth, m."""
    return _half_about(plant, neutral_volume(plant, depth))


def _half_about(plant: Plant, neutral: float) -> float:
    low, _, high = command_ranges(plant)[find_masses(plant).volume]
    return float(min(neutral - low, high - neutral))


def _at(plant: Plant, depth: float) -> np.ndarray:
    """The family's states at rest, level and heading north at a depth, m."""
    x = np.zeros(len(plant.family.states))
    x[plant.family.states.index("depth_m")] = depth
    return x


def _accelerations(plant: Plant, x: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Accelerations in body axes, m/s^2 and rad/s^2, with volume and masses at rest at their positions."""
    start = plant.settled(x, commands)
    return (plant.step_over(start, commands, _MOMENT) - start)[:6] / _MOMENT


def _solved(residual: Callable[[np.ndarray], np.ndarray], unknown: np.ndarray) -> np.ndarray:
    """The zero of the residual, by Newton's method with steps of at most _MOVE."""
    for _ in range(60):
        # least squares: there may be more equations than unknowns, and roll may be undetermined
        move = np.linalg.lstsq(jacobian(residual, unknown), residual(unknown), rcond=1e-10)[0]
        unknown = unknown - move * min(1.0, _MOVE / max(np.abs(move).max(), 1e-12))
        if not np.isfinite(unknown).all() or np.abs(move).max() < 1e-9:
            break
    return unknown
