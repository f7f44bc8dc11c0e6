"""Conversion of vehicle files of the former torpedo families to a hull and its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Propeller commands of the former families.
COMMANDS = {"torpedo": "shaft_speed", "torpedo_voltage": "voltage", "torpedo_speed": "speed"}
_FINS = {"rudder": "yaw", "stern_plane": "pitch", "bow_plane": "pitch"}
_STERN_IN_WAKE = {
    "x_uq_stern": "drag_rate",
    "x_uw_stern": "drag_slip",
    "x_uu_stern": "drag",
    "z_uu_stern": "lift",
    "m_uu_stern": "moment",
}


def convert_former_vehicle(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a former family's file converted to family "body"; other contents are unchanged.

    Raises ValueError if both forms are mixed.
    """
    family = content.get("family")
    if not isinstance(family, str) or family not in COMMANDS or not isinstance(content.get("hull", {}), Mapping):
        return dict(content)
    if "parts" in content:
        raise ValueError(
            f'family = "{family}" has no parts: write family = "body", and the fins and propeller as parts'
        )
    hull = dict(content.get("hull", {}))
    parts: dict[str, Any] = {}
    for name, axis in _FINS.items():
        table = hull.pop(name, {})
        if name != "bow_plane" or _moves(table):
            parts[name] = {"kind": "surface", "axis": axis, **table}
    parts["propeller"] = {"kind": "propeller", "command": COMMANDS[family], **hull.pop("propulsion", {})}
    wake = hull.pop("slipstream", {})
    for key, entry in wake.items():
        owner, name = ("stern_plane", _STERN_IN_WAKE[key]) if key in _STERN_IN_WAKE else ("propeller", key)
        parts[owner].setdefault("wake", {})[name] = entry
    converted = {**content, "family": "body", "hull": hull, "parts": parts}
    if isinstance(content.get("effects"), Mapping):
        converted["effects"] = _effects(content["effects"], parts)
    return converted


def current_torpedo_path(path: str) -> str:
    """The present path of a former torpedo's parameter; other paths are unchanged."""
    head, _, name = path.rpartition(".")
    if head == "hull.slipstream":
        return (
            f"parts.stern_plane.wake.{_STERN_IN_WAKE[name]}"
            if name in _STERN_IN_WAKE
            else f"parts.propeller.wake.{name}"
        )
    for fin in _FINS:
        if head == f"hull.{fin}":
            return f"parts.{fin}.{name}"
        if head == f"effects.{fin}_fin":
            return f"effects.{fin}.{name}"
    if head == "hull.propulsion" or head.startswith("hull.propulsion."):
        return f"parts.propeller{head.removeprefix('hull.propulsion')}.{name}"
    return "effects.propeller.lost" if path == "effects.propeller.thrust_loss" else path


def _effects(given: Mapping[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    effects = {name: dict(group) if isinstance(group, Mapping) else group for name, group in given.items()}
    for name in _FINS:
        damage = effects.pop(f"{name}_fin", {})
        if name not in parts:
            effects.pop(name, None)
        elif damage:
            effects[name] = {**effects.get(name, {}), **damage}
    propeller = effects.get("propeller", {})
    if "thrust_loss" in propeller:
        propeller["lost"] = propeller.pop("thrust_loss")
    return effects


def _moves(fin: Mapping[str, Any]) -> bool:
    """Whether a bow plane has any effect."""

    def value(name: str, default: float) -> float:
        entry = fin.get(name, default)
        return entry.get("value", default) if isinstance(entry, Mapping) else entry

    return bool(fin) and value("limit", 0.35) != 0.0 and any(value(n, 0.0) for n in ("lift", "moment", "drag"))
