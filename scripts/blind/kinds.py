"""The experiments for blind logs of each kind of vehicle, and the effects that none of them can show."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from auv_gym.param import list_paths, spec_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from scripts.blind.changing import At, Changing, ChangingFlight, ChangingSwim, ChangingTorpedo
from scripts.blind.logs import (
    Conditions,
    dive_settings,
    glider_log,
    hover_log,
    lake_log,
    lake_settings,
    sea_log,
    torpedo_log,
    yo_log,
)
from scripts.blind.outside import (
    glider_outside,
    hover_outside,
    lake_outside,
    sea_outside,
    slipped_clock,
    torpedo_outside,
    yo_outside,
)
from scripts.blind.sampling import recorded, simulated

_NO_PISTON = "a float with an oil bladder has no piston"
_NO_OIL = "a float with a piston logs no oil"
_OWN_VOLUME = "each dive has an unknown volume, which does the same"
_NO_WAVE = "without the wave its period says nothing"
_NO_GROWTH = "without the expansion its lag says nothing"
_HEAVE = ("heave_sin", "heave_cos")
_NO_SURFACE = "the initial depth of each free run does the same, and none is at the surface"


@dataclass(frozen=True)
class Kind:
    """A kind of vehicle, by the name of its family or, for a hull and its parts, by its kind.

    log: makes one of the standard experiment, evenly sampled.  outside: makes one of a vehicle without effects and
    with one of `causes`, except "clock", whose errors are about `clock_spacing` s apart.  changing: replaces a vehicle
    whose parameters vary with time.  settings: of the standard experiment in the study of single effects.  hidden:
    effects that no log of the kind can show, and why.
    """

    family: str
    log: Callable[..., Record]
    outside: Callable[..., Record]
    causes: tuple[str, ...]
    clock_spacing: float
    changing: Callable[[Plant, At], Any]
    settings: Callable[[np.random.Generator], dict[str, Any]] = lambda rng: {}
    hidden: Mapping[str, str] = field(default_factory=dict)


_ONE_COMMAND = "with one command, its dead time does the same"
_HIDDEN_IN_A_LAKE = {
    "effects.clock.delay": _ONE_COMMAND,
    "effects.depth.bias": _NO_SURFACE,
    "effects.oil.pump_gain": _NO_OIL,
    "effects.oil.valve_gain": _NO_OIL,
    "effects.oil.valve_with_depth": _NO_OIL,
    "effects.water.heave_period": _NO_WAVE,
    "effects.volume.expansion_lag": _NO_GROWTH,
}
_HIDDEN_AT_SEA = {
    "effects.clock.delay": "what is logged of the oil is no command",
    "effects.clock.rate": "without inertia it acts as the drag coefficients do, which are refitted",
    **{f"effects.piston.{name}": _NO_PISTON for name in ("gain", "backlash", "dead_time", "lag", "slowness")},
    "effects.piston.offset": f"{_NO_PISTON}, and {_OWN_VOLUME}",
    "effects.volume.offset": _OWN_VOLUME,
    "effects.tether.pull": _OWN_VOLUME,
    "effects.water.heave_sin": "the wave's phase is not known from one dive to the next",
    "effects.water.heave_cos": "the wave's phase is not known from one dive to the next",
    "effects.water.heave_period": _NO_WAVE,
    "effects.volume.expansion_lag": _NO_GROWTH,
    "effects.depth.bias": _NO_SURFACE,
    "effects.depth.scale": "without inertia it acts as the drag coefficients do, which are refitted",
    "effects.depth.lag": "in a steady dive the initial depth does the same; three probes are about the noise",
}
_PUMPED = "samples in which the engine moves are left out"
_NO_TRACK = "a dive has no track"
_HIDDEN_IN_FLIGHT = {
    "effects.clock.delay": _PUMPED,
    "effects.clock.rate": "it acts as the drag coefficient does, which is refitted",
    **{f"effects.engine.{name}": _PUMPED for name in ("dead_time", "lag", "slowness")},
    **{f"effects.compass.{name}": _NO_TRACK for name in ("bias", "deviation_sin", "deviation_cos")},
    **{f"effects.current.{name}": _NO_TRACK for name in ("north", "east")},
    **{f"effects.water.{name}": "the wave's phase is not known from one dive to the next" for name in _HEAVE},
    "effects.water.gradient": "the density is measured",
    "effects.water.heave_period": _NO_WAVE,
    "effects.depth.bias": _NO_SURFACE,
    "effects.depth.scale": "it acts as the drag coefficient does, which is refitted",
    "effects.depth.lag": "in steady flight the start of each run does the same",
}
_KINDS = (
    Kind(
        "glider",
        glider_log,
        glider_outside,
        ("drag", "side", "fin", "clock"),
        60.0,
        hidden={"effects.clock.delay": _ONE_COMMAND},
        changing=Changing.glider,
    ),
    Kind(
        "float_piston",
        lake_log,
        lake_outside,
        ("drag", "side", "tether", "fin", "clock"),
        200.0,
        ChangingSwim.starting,
        lake_settings,
        _HIDDEN_IN_A_LAKE,
    ),
    Kind(
        "float_oil",
        sea_log,
        sea_outside,
        ("drag", "tether", "clock"),
        2e4,
        ChangingSwim.starting,
        dive_settings,
        _HIDDEN_AT_SEA,
    ),
    Kind("glide", yo_log, yo_outside, ("layer", "clock"), 1800.0, hidden=_HIDDEN_IN_FLIGHT, changing=ChangingFlight.of),
    Kind(
        "body", torpedo_log, torpedo_outside, ("drag", "side", "tether", "fin", "clock"), 25.0, changing=ChangingTorpedo
    ),
    Kind("hover", hover_log, hover_outside, ("clock",), 15.0, changing=Changing),
)
KINDS = {kind.family: kind for kind in _KINDS}


def kind_of(plant: Plant) -> Kind:
    """The kind of a vehicle; raises if there are no blind logs for it."""
    family = plant.family
    name = family.name if family.body is None else family.kind
    if name not in KINDS:
        raise ValueError(f"Blind logs are made of vehicles of {', '.join(KINDS)}, got {plant.name!r}, a {name}.")
    return KINDS[name]


def known(vehicle: str) -> Plant:
    """The preset with coefficients known to the diagnosis's usual doubt.

    If a preset states wide deviations, as one with guessed coefficients does, no log could show an effect that acts
    like such a coefficient.
    """
    return replace(load_vehicle(vehicle), deviations={})


def effects_of(vehicle: str) -> list[str]:
    """Every effect of a vehicle that can be probed and that a log of it can show."""
    plant = load_vehicle(vehicle)
    probed = [p for p in list_paths(plant) if p.startswith("effects.") and spec_at(plant, p).probe > 0.0]
    return [path for path in probed if path not in kind_of(plant).hidden]


def log_of(plant: Plant, conditions: Conditions, seed: int) -> Record:
    """The log of a vehicle's standard experiment; the same manoeuvres for the same seed.

    Raises ValueError or Diverged if the vehicle cannot be controlled.
    """
    run = kind_of(plant).log(plant, simulated(conditions), np.random.default_rng(seed))
    return recorded(plant, run, conditions, seed)


def outside_log(plant: Plant, cause: str, size: float, conditions: Conditions, seed: int) -> Record:
    """The log of a plant without effects and with a cause, "" for none; size: 1 is small.

    Raises ValueError if the vehicle cannot be controlled.
    """
    kind, rng = kind_of(plant), np.random.default_rng([seed, 1])
    run = kind.outside(plant, cause, size, simulated(conditions), np.random.default_rng(seed), rng)
    run = slipped_clock(run, size, kind.clock_spacing, rng) if cause == "clock" else run
    return recorded(plant, run, conditions, seed)
