"""The right-hand side of a vehicle as a CasADi function, for optimal control and estimation.

It is the vehicle's own source, run on symbols (`symbols`): there is no second set of equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.exports.symbols import Numbers, Symbol, ca, on_symbols
from auv_gym.param import list_paths, value_at
from auv_gym.plant import Plant
from auv_gym.plant.cruise import resting_commands
from auv_gym.writing import write_json

_POSITION = " position"  # suffix of an actuator's name: its state, if it has a lag


@dataclass(frozen=True, eq=False)
class CasadiModel:
    """A vehicle's right-hand side: `rhs(x, u)` is dx/dt.

    states: of x, those of the family in SI units and radians, then the position of each actuator that has a lag.
    inputs: of u, in the units of their channels.
    defaults: of each input, in the order of u: a command at rest, or the value used if a log does not have the input.
    """

    rhs: ca.Function
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    defaults: Mapping[str, float]

    @property
    def units(self) -> dict[str, str]:
        """The unit of each state and input; 1 for a share."""
        return {name: channel(name.removesuffix(_POSITION)).unit for name in (*self.states, *self.inputs)}

    def save(self, file: Path) -> None:
        """Write the function, for `casadi.Function.load`, and beside it a JSON file that describes x and u."""
        self.rhs.save(str(file))
        told = {"states": self.states, "inputs": self.inputs, "units": self.units, "defaults": dict(self.defaults)}
        write_json(file.with_name(f"{file.name}.json"), told)


def casadi_model(plant: Plant) -> CasadiModel:
    """A vehicle's continuous-time equations of motion, with its effects, as a CasADi function of states and inputs.

    Commands are limited as the vehicle limits them.  Sensors are not included.  Raises ValueError for effects without
    such a right-hand side: dead times, backlash, stiction, a rate limit without a lag, moving masses.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from auv_gym.exports import casadi_model
        >>> model = casadi_model(load_vehicle("slocum"))
        >>> model.states, model.rhs.size1_out(0)
        (('heading_rad', 'r_radps', 'north_m', 'east_m'), 4)
        >>> model.defaults["u_mps"], model.units["u_mps"]
        (0.35, 'm/s')
    """
    _check(plant)
    family, hooks = plant.family, plant.family.hooks
    p: Any = Numbers(getattr(family.view, "py_func", family.view)(plant.derived))
    x, u = ca.SX.sym("x", len(family.states)), ca.SX.sym("u", len(family.inputs))
    inputs = _symbols(u)
    shaped = _zeros(len(family.actuators))
    on_symbols(hooks.shape)(inputs, _zeros(len(family.actuators)), p, shaped)
    positions, lagged, rates = [], [], []
    for index, name in enumerate(family.actuators):
        _, lag, slowness = on_symbols(hooks.actuator_times)(index, p)
        if lag <= 0.0:
            if slowness > 0.0:
                raise ValueError(
                    f"{plant.name} has a rate limit of {name} and no lag, which no right-hand side can hold: give it a "
                    "lag, or set its slowness to 0 and limit the rate in the optimisation."
                )
            positions.append(shaped[index])
            continue
        position = ca.SX.sym(name)
        rate = (_expression(shaped[index]) - position) / lag
        if slowness > 0.0:
            rate = ca.fmin(ca.fmax(rate, -1.0 / slowness), 1.0 / slowness)
        positions.append(Symbol(position))
        lagged.append((f"{name}{_POSITION}", position))
        rates.append(rate)
    # from the states to the integrated ones, their slopes, and back by the chain rule
    integrated, slopes, kept = _zeros(family.integrated), _zeros(family.integrated), _symbols(x)
    on_symbols(hooks.enter)(kept, integrated)
    z = ca.SX.sym("z", family.integrated)
    actuators, scratch = np.array(positions, dtype=object), _zeros(max(family.scratch, 1))
    try:
        on_symbols(hooks.derivative)(_symbols(z), actuators, inputs, p, slopes, scratch)
    except ValueError as error:
        raise ValueError(
            f"No CasADi function can be made of {plant.name}: {error}. Use its linear model (`auv-gym export --to "
            "control`), or step the vehicle itself (`Plant.step`) with an optimiser that needs no derivatives."
        ) from None
    on_symbols(hooks.leave)(_symbols(z), kept)
    moved = ca.jtimes(_column(kept), z, _column(slopes))
    at_x = ca.substitute(moved, z, _column(integrated))
    state = ca.vertcat(x, *(symbol for _, symbol in lagged))
    rhs = ca.Function(plant.name, [state, u], [ca.vertcat(at_x, *rates)], ["x", "u"], ["dx"])
    states = (*family.states, *(name for name, _ in lagged))
    return CasadiModel(rhs, states, family.inputs, _defaults(plant))


def _defaults(plant: Plant) -> dict[str, float]:
    if plant.family.body is not None:
        return dict(zip(plant.inputs, resting_commands(plant).tolist(), strict=True))
    return {name: float(plant.constants.get(name, 0.0)) for name in plant.inputs}


def _check(plant: Plant) -> None:
    gaps = [p for p in list_paths(plant) if p.endswith((".backlash", ".stiction")) and value_at(plant, p) != 0.0]
    reasons = {
        "a mass that moves in it, whose start and stop are jumps of its velocity": plant.family.moves,
        "a dead time or a delay of its commands": plant.history > 1,
        "a log's clock that runs fast or slow": plant.effects.clock.rate != 0.0,
        f"backlash or stiction ({', '.join(gaps)})": bool(gaps),
        "a learned hull": plant.learned is not None,
    }
    for reason, holds in reasons.items():
        if holds:
            raise ValueError(
                f"No CasADi function can be made of {plant.name}: it has {reason}. Export a vehicle without it."
            )


def _symbols(vector: Any) -> np.ndarray:
    return np.array([Symbol(vector[i]) for i in range(vector.shape[0])], dtype=object)


def _zeros(size: int) -> np.ndarray:
    return np.array([0.0] * size, dtype=object)


def _expression(number: Any) -> Any:
    return number.value if isinstance(number, Symbol) else ca.SX(float(number))


def _column(numbers: np.ndarray) -> Any:
    return ca.vertcat(*map(_expression, numbers))
