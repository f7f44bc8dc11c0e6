"""A glider's way to a depth: heavy and nose down above it, light and nose up below."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class GlideToDepth:
    """Engine and pitch in proportion to the distance from the wanted depth, within `band` m of it; no memory.

    neutral, half: m^3, the engine's volume at rest and what it may move from there.  pitch: rad, the steepest.
    """

    neutral: float
    half: float
    pitch: float
    band: float

    targets = ("depth_m",)
    commands = ("buoyancy_volume_m3", "pitch_rad")

    def start(self) -> None:
        return None

    def act(
        self, state: None, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], None]:
        """reading: depth_m.  target: depth_m."""
        share = min(max((target["depth_m"] - reading["depth_m"]) / self.band, -1.0), 1.0)
        return {"buoyancy_volume_m3": self.neutral - share * self.half, "pitch_rad": -share * self.pitch}, None
