"""Autopilots of a glider that flies by its polar: engine and pitch together take it to a depth."""

from __future__ import annotations

from typing import Any

from auv_gym.plant import Plant
from auv_gym.plant.flying import neutral_engine
from controllers.controller import Controller
from controllers.gliding import GlideToDepth
from controllers.kinds import ControlKind, Ranges

_BAND = 10.0  # m from the target, beyond which it flies as fast as it can
_DEEP = 100.0  # m, at which it is trimmed


def _placed(plant: Plant, targets: tuple[str, ...], dt: float | None, *, band: float = _BAND) -> Controller:
    """band: m from the target, beyond which the glider flies as fast as it can."""
    if not band > 0.0:
        raise ValueError(f"An autopilot of {plant.name!r} needs band > 0 m, got {band!r}.")
    low, high = _ranges(plant)["buoyancy_volume_m3"]
    neutral = min(max(neutral_engine(plant, _DEEP), low), high)
    return GlideToDepth(neutral, min(neutral - low, high - neutral), 0.6 * plant.hull.pitch_limit, band)


def _ranges(plant: Plant) -> Ranges:
    limit = plant.hull.pitch_limit
    return {
        "buoyancy_volume_m3": (plant.hull.engine_low, plant.hull.engine_high),
        "pitch_rad": (-limit, limit),
    }


def _on_board(plant: Plant, targets: tuple[str, ...]) -> Controller:
    return _placed(plant, targets, None)


def _logged(plant: Plant) -> tuple[str, ...]:
    """What steers a glider on board is not a loop that its log could be run under: pitch is measured, not commanded."""
    return ()


KIND = ControlKind(
    targets=("depth_m",),
    plans=dict[str, Any](),
    placed=_placed,
    on_board=_on_board,
    logged=_logged,
    ranges=_ranges,
)
