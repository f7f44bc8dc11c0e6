"""The constants of a Seaglider by its operators' names: as its file states them, and as a diagnosis refits them."""

from __future__ import annotations

from math import radians
from typing import Any

from auv_gym.param import value_at
from identification.diagnosis import Diagnosis

_CONSTANTS = (  # name and unit of the operators, our path, and their unit in ours
    ("hd_a, 1/deg", "hull.lift_1", radians(1.0)),
    ("hd_b", "hull.drag_0", 1.0),
    ("hd_c, 1/deg²", "hull.drag_2", radians(1.0) ** 2),
    ("volmax - vbdbias, cm³", "hull.volume", 1e6),
    ("abs_compress, 1/dbar", "hull.compressibility", 1e4),
    ("therm_expan, 1/K", "hull.expansion", 1.0),
)
_OFFSET = "effects.volume.offset"


def constants_of(found: Diagnosis) -> list[dict[str, Any]]:
    """Each constant of the operators' flight model: given, whether its file states it, and refitted with its interval.

    The refitted value and the interval are None for a constant that the fit has not freed.
    """
    plant = found.given.plant
    fitted = {c.path: (c.value, *c.ci95) for c in found.coefficients}
    for effect in found.added:
        if effect.coefficient is not None:
            fitted[effect.coefficient.path] = (effect.coefficient.value, *effect.coefficient.ci95)
        elif effect.path == _OFFSET:
            fitted["hull.volume"] = tuple(value_at(plant, "hull.volume") + v for v in (effect.value, *effect.ci95))
    rows = []
    for name, path, unit in _CONSTANTS:
        value, *limits = (unit * v for v in fitted[path]) if path in fitted else (None,)
        rows.append(
            {
                "name": name,
                "given": unit * value_at(plant, path),
                "stated": plant.notes.get(path, "").startswith("stated by"),
                "value": value,
                "ci95": limits or None,
            }
        )
    return rows
