"""Autopilots of a flying glider: to a depth by engine and pitch, in yos to a place by its masses."""

from __future__ import annotations

from typing import Any

from auv_gym.plant import Plant
from auv_gym.plant.flying import NOMINAL_PITCH, neutral_engine, nominal_flight
from controllers.controller import Controller
from controllers.gains import Gains
from controllers.gliding import GlideToDepth, YoPilot
from controllers.kinds import ControlKind, Ranges

_BAND = 10.0  # m from the target; further away, it flies as fast as it can
_DEEP = 100.0  # m, depth at which it is trimmed
_APOGEE, _SURFACE = 150.0, 1.0  # m, limits of its yos: in the usual 200 m of water, this leaves room for the pump
_LIFT = 0.75  # of the engine's range to either side, used for yos


def _placed(
    plant: Plant,
    targets: tuple[str, ...],
    dt: float | None,
    *,
    band: float = _BAND,
    apogee: float = _APOGEE,
    lift: float = _LIFT,
    pitch: float = NOMINAL_PITCH,
    gains: Gains | None = None,
) -> Controller:
    """The autopilot to a depth or, in yos, to a place; band: m from a depth, beyond which it flies at top speed.

    apogee, lift, pitch: of yos to a place: the depth, m, where climbs begin, the share of the engine, and rad.
    """
    if gains is not None:
        raise ValueError(f"An autopilot of {plant.name!r} is a rule without gains: leave out gains=.")
    masses = "battery_position_m" in plant.inputs
    if not band > 0.0:
        raise ValueError(f"An autopilot of {plant.name!r} needs band > 0 m, got {band!r}.")
    low, high = _ranges(plant)["buoyancy_volume_m3"]
    neutral = min(max(neutral_engine(plant, _DEEP), low), high)
    half = min(neutral - low, high - neutral)
    if targets == KIND.targets:
        return GlideToDepth(neutral, half, 0.6 * plant.hull.pitch_limit, band, plant if masses else None)
    if not masses or set(targets) != set(YoPilot.targets):
        raise ValueError(
            f"An autopilot of {plant.name!r} follows depth_m, or flies yos to north_m, east_m and depth_m together "
            "where masses steer it, see auv_gym.plant.flying.steered: name these targets."
        )
    if not (apogee > _SURFACE and 0.0 < lift <= 1.0 and 0.0 < pitch <= plant.hull.pitch_limit):
        raise ValueError(
            f"Yos need apogee > {_SURFACE:g} m, lift from 0 to 1 and pitch from 0 to {plant.hull.pitch_limit:g} rad, "
            f"got {apogee!r}, {lift!r} and {pitch!r}."
        )
    flight = nominal_flight(plant, 0.5 * apogee, -lift * half, pitch)
    return YoPilot(plant, neutral, lift * half, pitch, apogee, _SURFACE, flight)


def _ranges(plant: Plant) -> Ranges:
    limit, steering = plant.hull.pitch_limit, plant.parameters.steering
    return {
        "buoyancy_volume_m3": (plant.hull.engine_low, plant.hull.engine_high),
        "pitch_rad": (-limit, limit),
        "battery_position_m": (steering.battery_low, steering.battery_high),
        "battery_roll_rad": (-steering.roll_limit, steering.roll_limit),
        "rudder_rad": (-steering.rudder_limit, steering.rudder_limit),
    }


def _on_board(plant: Plant, targets: tuple[str, ...]) -> Controller:
    return _placed(plant, targets, None)


def _logged(plant: Plant) -> tuple[str, ...]:
    """No targets: the on-board control of a logged glider is unknown, as its pitch is measured, not commanded."""
    return ()


KIND = ControlKind(
    targets=("depth_m",),
    asked=("north_m", "east_m"),
    plans=dict[str, Any](),
    placed=_placed,
    on_board=_on_board,
    logged=_logged,
    ranges=_ranges,
)
