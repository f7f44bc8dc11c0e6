"""Forces of single parts at random motions, compiled or in plain Python; run as a script, it writes them to a file."""

import sys
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from auv_gym.compiled import bind
from auv_gym.param import pack, replace_at
from auv_gym.physics.frames import rotation_of
from auv_gym.vehicles import Family, Part, compose
from auv_gym.vehicles.body.kinds import Motion

DENSITY, GRAVITY = 1025.0, 9.81
WATER = 1.02  # of the water, over that of the coefficients
PLACE = {"x": -0.7, "y": 0.3, "z": 0.15}
# every kind and form: numbers of the part, and of its effects
KINDS: dict[tuple[str, str], tuple[dict[str, float], dict[str, float]]] = {
    ("surface", "yaw"): (
        {"lift": 9.0, "moment": -6.0, "drag": -4.0, "drag_rate": 1.0, "drag_slip": 2.0, "inflow": 1.0, "station": -0.6},
        {"lost": 0.2},
    ),
    ("surface", "pitch"): ({"lift": -9.0, "moment": -6.0, "drag": -4.0, "stall": 0.3}, {"stuck": 1.0, "stuck_at": 0.1}),
    ("fin", "yaw"): (
        {"area": 0.02, "lift_slope": 4.0, "drag": 0.02, "induced": 0.1, "plate": 1.1, **PLACE},
        {"lost": 0.1},
    ),
    ("fin", "pitch"): ({"area": 0.02, "lift_slope": 4.0, "drag": 0.02, "plate": 1.1, **PLACE}, {}),
    ("wings", ""): (
        {
            "drag_0": 7.0,
            "drag_2": 380.0,
            "lift_0": -0.4,
            "lift_1": 440.0,
            "side": -115.0,
            "roll": -58.0,
            "roll_rate": -20.0,
            "pitch_0": -0.3,
            "pitch": -65.0,
            "pitch_rate": -205.0,
            "yaw": -34.0,
            "yaw_rate": -389.0,
        },
        {"lost": 0.1},
    ),
    ("propeller", "shaft_speed"): ({"t_nn": 0.01, "t_nu": -0.05, "q_nn": -1e-4, "torque_arm": 0.01}, {"lost": 0.2}),
    ("thruster", "share"): (
        {
            **PLACE,
            "to_x": 0.6,
            "to_y": 0.0,
            "to_z": -0.8,
            "torque_arm": 0.02,
            "voltage": 16.0,
            "power": 1.2,
            **{f"curve.{name}": 40.0 * c for name, c in (("m100", -1.0), ("m050", -0.5), ("p050", 0.5), ("p100", 1.0))},
        },
        {"lost": 0.3, "astern": 0.1, "inflow": 4.0, "shift_y": 0.05, "turn_x": 0.3, "turn_z": -0.2},
    ),
    ("buoyancy_engine", ""): ({"low": 0.0, "neutral": 2e-4, "high": 9e-4, **PLACE}, {"offset": 1e-5}),
    ("moving_mass", "slides"): ({"mass": 12.0, "axis_x": 0.6, "axis_z": 0.8, **PLACE}, {}),
    ("moving_mass", "turns"): ({"mass": 12.0, "eccentricity": 0.02, **PLACE}, {}),
    ("moving_mass", "both"): (
        {"mass": 12.0, "eccentricity": 0.02, **PLACE},
        {"slide.stuck": 0.5, "slide.stuck_at": 0.01},
    ),
    ("tether", ""): ({"drag": 3.0, "north": 4.0, "east": -2.0, "down": 1.0, **PLACE}, {"lost": 0.1}),
    ("hull_volume", ""): ({"volume": 0.06, "compressibility": 4e-10, "expansion": 7e-5, **PLACE}, {"offset": 1e-5}),
}

view = force = None  # open names of the template
NAME, SHARED, COLUMNS = "", 0, 0


def _forces(derived, motions, actuators, inputs, found):
    p = view(derived)
    for i in range(motions.shape[0]):
        m = motions[i]
        motion = Motion(
            m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9],
            m[10], m[11], m[12], m[13], m[14], m[15], m[16], m[17], m[18], m[19],
        )  # fmt: skip
        part, effects, own = getattr(p.parts, NAME)[0], getattr(p.effects.parts, NAME)[0], getattr(p.derived, NAME)[0]
        a, b, c, d, e, f = force(0, actuators[i], inputs[i], SHARED, motion, part, effects, own)
        found[i, 0], found[i, 1], found[i, 2], found[i, 3], found[i, 4], found[i, 5] = a, b, c, d, e, f


def motions(seed: int, count: int = 40) -> np.ndarray:
    """Rows of `Motion`: any velocity and attitude, at 5 to 500 m, the supply as stated."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, 20))
    rows[:, :6] = rng.normal(size=(count, 6)) * [1.0, 0.4, 0.4, 0.5, 0.5, 0.5]
    rows[:, 6], rows[:, 7], rows[:, 8], rows[:, 9] = WATER, WATER * DENSITY, GRAVITY, rng.uniform(5.0, 500.0, count)
    for row in rows:
        quaternion = rng.normal(size=4)
        row[10:19] = rotation_of(*(quaternion / np.linalg.norm(quaternion)))
    return rows


@cache
def family() -> Family:
    """A family with a part of every kind and form, so that what is derived is compiled once."""
    return compose([Part(f"{kind}_{choice}", kind, choice) for kind, choice in KINDS])


@cache
def program(kind: str, choice: str) -> Any:
    """The compiled forces of one of its parts."""
    part = next(part for part in family().body.parts if part.name == f"{kind}_{choice}")
    shared = next(iter(part.found.shared), "")
    return bind(
        _forces,
        part.name,
        view=family().view,
        force=part.found.force,
        NAME=part.found.slot or part.found.name,
        SHARED=family().inputs.index(shared) if shared else -1,
    )


def part_forces(
    kind: str,
    choice: str,
    values: Mapping[str, float],
    effects: Mapping[str, float],
    rows: np.ndarray,
    actuators: np.ndarray,
    inputs: np.ndarray,
) -> np.ndarray:
    """[X Y Z K M N] of one part, N and N m, (n, 6); actuators: (n, its commands at least), inputs: (n,), all alike."""
    name = f"{kind}_{choice}"
    numbers = {f"parts.{name}.{k}": v for k, v in values.items()} | {
        f"effects.{name}.{k}": v for k, v in effects.items()
    }
    tree = replace_at(family().parameters(), {**numbers, "hull.density": DENSITY, "hull.gravity": GRAVITY})
    derived = np.zeros(family().derived)
    family().hooks.derive(pack(tree), derived)
    found = np.empty((len(rows), 6))
    given = np.repeat(np.asarray(inputs, dtype=float)[:, None], len(family().inputs), axis=1)
    program(kind, choice)(derived, rows, np.ascontiguousarray(actuators), given, found)
    return found


def every_kind() -> dict[str, np.ndarray]:
    """Forces of every kind and form at the same motions."""
    rng, rows, found = np.random.default_rng(7), motions(3), {}
    for (kind, choice), (values, effects) in KINDS.items():
        scale = {"propeller": 300.0, "buoyancy_engine": 5e-4, "moving_mass": 0.05}.get(kind, 0.6)
        actuators = scale * rng.uniform(-1.0, 1.0, (len(rows), 4))
        inputs = np.full(len(rows), 14.0)
        found[f"{kind} {choice}"] = part_forces(kind, choice, values, effects, rows, actuators, inputs)
    return found


if __name__ == "__main__":
    np.savez(sys.argv[1], **every_kind())
