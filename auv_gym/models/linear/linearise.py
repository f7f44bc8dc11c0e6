"""Linearisation of a vehicle about steady motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_gym.models.linear.kinds import KINDS
from auv_gym.models.linear.state_space import StateSpace
from auv_gym.param import did_you_mean
from auv_gym.plant import Plant, check_vehicle, without_effects


def linearise(
    plant: Plant,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    *,
    states: Sequence[str] | None = None,
    dt: float | None = None,
    at: tuple[np.ndarray, np.ndarray] | None = None,
) -> StateSpace:
    """The linearisation of a vehicle without its effects, exact over samples of dt for small changes.

    inputs: default a torpedo's planes, a glider's rudder, a float's engine, all thrusters.  states: the family's;
    default those that the inputs move in their plane; all others are held.  outputs: default the states that the
    vehicle measures.  dt: s, default the plant's.  at: the family's states and inputs to linearise about; default a
    torpedo's cruise, a glider straight ahead, a float at rest and deep, a vehicle with thrusters hovering; the drag of
    the last two is that at a tenth of their top speed.
    States are deviations from this point; actuators with a lag add theirs.  Raises for names that the vehicle does not
    have.

    Example:

        >>> from auv_gym import linearise, load_vehicle
        >>> linearise(load_vehicle("slocum"), dt=1.0).poles().round(3)
        array([1.   , 0.951])
    """
    check_vehicle("linearise", plant)
    family, kind = plant.family, KINDS.of(plant.family)
    moves = kind.moves(plant)
    clean = replace(without_effects(plant), dt=plant.dt if dt is None else float(dt))
    chosen = _checked("inputs", inputs, kind.usual(clean), tuple(moves))
    moved = dict.fromkeys(name for channel in chosen for name in moves[channel])
    kept = _checked("states", states, moved, family.states)
    seen = _checked("outputs", outputs, [name for name in kept if name in clean.outputs], clean.outputs)
    point, commands = kind.steady(clean) if at is None else at
    full = clean.settled(point, commands)
    positions = [f"{name} position" for name in chosen if name in family.actuators]
    at_states = [clean.states.index(name) for name in (*kept, *positions)]
    at_inputs = [family.inputs.index(name) for name in chosen]
    at_outputs = [clean.outputs.index(name) for name in seen]
    sizes = kind.steps(clean, (*kept, *positions, *chosen))

    def after(change: np.ndarray) -> np.ndarray:
        """The states one sample later, and the outputs now."""
        x, u = full.copy(), np.array(commands, dtype=float)
        x[at_states] += change[: len(at_states)]
        u[at_inputs] += change[len(at_states) :]
        return np.concatenate([clean.step(x, u)[at_states], clean.output(x)[at_outputs]])

    slopes = np.stack([(after(d) - after(-d)) / (2.0 * size) for d, size in zip(np.diag(sizes), sizes)], axis=1)
    # an actuator without a lag is at its command, and has no memory
    states_kept = [i for i in range(len(at_states)) if i < len(kept) or slopes[:, i].any()]
    steady = after(np.zeros(sizes.size))
    names = (*kept, *positions)
    _check_steady(plant, dict(zip(kept, steady[: len(kept)] - full[at_states[: len(kept)]])), clean.dt)
    rows = slopes[len(at_states) :][:, states_kept]
    for name, row in zip(seen, rows):
        if not row.any():
            raise ValueError(f"linearise needs outputs that its states move, {', '.join(kept)}, got {name}.")
    return StateSpace(
        a=slopes[np.ix_(states_kept, states_kept)],
        b=slopes[states_kept][:, len(at_states) :],
        c=rows,
        inputs=chosen,
        outputs=seen,
        dt=clean.dt,
        input_offset=np.array(commands, dtype=float)[at_inputs],
        output_offset=steady[len(at_states) :],
        states=tuple(f"{names[i]} change" for i in states_kept),
    )


def _check_steady(plant: Plant, drift: dict[str, float], dt: float) -> None:
    for name, change in drift.items():
        if abs(change) > 1e-6 * max(dt, 1.0):
            raise ValueError(
                f"linearise needs steady motion to start from, got {name} of {plant.name!r} changing by {change:.3g} "
                f"in {dt:g} s: choose `at` such that its states rest."
            )


def _checked(label: str, given: Sequence[str] | None, default, known: Sequence[str]) -> tuple[str, ...]:
    names = tuple(default if given is None else given)
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known)
            raise ValueError(f"linearise has no {label[:-1]} {name!r}. {hint}Known: {', '.join(known)}.")
    if not names:
        raise ValueError(f"linearise needs {label}, got none: name some of {', '.join(known)}.")
    return names
