"""The water's measured density as a channel of a record, looked up in profiles over depth along the vehicle's track."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auv_gym.channels import depth_from_pressure
from auv_gym.records.record import Record

_SLOPE_OVER = 10.0  # m over which the gradient is computed
_POSSIBLE = (950.0, 1100.0)  # kg/m^3, in situ, from hot fresh water to the deepest trench


@dataclass(frozen=True, eq=False)
class Profile:
    """In-situ density over depth: depth (n,), m, rising; density (n,), kg/m^3."""

    depth: np.ndarray
    density: np.ndarray

    @classmethod
    def of(cls, label: str, depth: np.ndarray, density: np.ndarray) -> Profile:
        """A profile of samples in any order, without missing values; raises if nothing is left."""
        kept = np.isfinite(depth) & np.isfinite(density)
        depth, first = np.unique(depth[kept], return_index=True)
        density = density[kept][first]
        if depth.size < 2:
            raise ValueError(f"The density profile {label!r} needs at least 2 depths with a density, got {depth.size}.")
        low, high = float(density.min()), float(density.max())
        if low < _POSSIBLE[0] or high > _POSSIBLE[1]:
            raise ValueError(
                f"The density profile {label!r} goes from {low:g} to {high:g}; water has {_POSSIBLE[0]:g} to "
                f"{_POSSIBLE[1]:g} kg/m^3: give the density in situ, not an anomaly, in kg/m^3."
            )
        return cls(depth, density)

    def at(self, depth: np.ndarray) -> np.ndarray:
        """Density at depths, kg/m^3; beyond its ends, the profile continues with the slope of its outer tenth."""
        d, r = self.depth, self.density
        outer = max(d.size // 10, 1)
        top, bottom = (r[outer] - r[0]) / (d[outer] - d[0]), (r[-1] - r[-1 - outer]) / (d[-1] - d[-1 - outer])
        beyond = top * np.minimum(depth - d[0], 0.0) + bottom * np.maximum(depth - d[-1], 0.0)
        return np.interp(depth, d, r) + beyond


def read_profiles(path: str | Path) -> dict[str, Profile]:
    """The density profiles in a CSV file with density_kgpm3 and depth_m or pressure_dbar, by the label of their dive.

    A file without dive_id, segment or run holds a single profile, with the label ''.  Raises if a column is missing.
    """
    from auv_gym.records.reading import read_columns

    columns, labels = read_columns(path)
    if "density_kgpm3" not in columns or not {"depth_m", "pressure_dbar"} & columns.keys():
        raise ValueError(
            f"{Path(path).name} needs the columns density_kgpm3 and depth_m or pressure_dbar, got {', '.join(columns)}."
        )
    depth = columns["depth_m"] if "depth_m" in columns else depth_from_pressure(columns["pressure_dbar"])
    return {
        label: Profile.of(label, depth[labels == label], columns["density_kgpm3"][labels == label])
        for label in dict.fromkeys(labels.tolist())
    }


def with_density(record: Record, profiles: Mapping[str, Profile]) -> Record:
    """The record with the density at its measured depth, the gradient there, and that depth, by segment.

    The channels density_kgpm3, density_gradient_kgpm4 and density_depth_m come from the profile with the segment's
    label.

    A segment without a profile uses that of the nearest segment that has one; a single profile serves all.
    Raises if no label matches.
    """
    labels = record.labels
    having = [k for k, label in enumerate(labels) if label in profiles]
    if not having and len(profiles) > 1:
        raise ValueError(
            f"None of the profiles ({', '.join(profiles)}) belongs to a segment of the record "
            f"({', '.join(map(repr, labels))}): give one profile, or label them as the segments are."
        )
    only = next(iter(profiles.values()))
    depth, density, gradient = record["depth_m"], np.empty(len(record)), np.empty(len(record))
    for k, segment in enumerate(record.segments):
        near = min(having, key=lambda other: abs(other - k), default=None)
        profile = only if near is None else profiles[labels[near]]
        density[segment] = profile.at(depth[segment])
        above, below = profile.at(depth[segment] - 0.5 * _SLOPE_OVER), profile.at(depth[segment] + 0.5 * _SLOPE_OVER)
        gradient[segment] = (below - above) / _SLOPE_OVER
    return record.with_channels(
        {"density_kgpm3": density, "density_gradient_kgpm4": gradient, "density_depth_m": depth}
    )
