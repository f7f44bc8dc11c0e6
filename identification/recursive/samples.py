"""Depth and piston of records in the form that the estimators of a diving model use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.records.record import Record, records_of

SAMPLES_PER_PARAMETER = 4


@dataclass(frozen=True, eq=False)
class Samples:
    """Rows of all records, one after the other.

    depth: m.  piston: m, from the row before, which acted on the way to the row's depth.  interval: s since the row
    before; 0 where a segment begins.
    """

    depth: np.ndarray
    piston: np.ndarray
    interval: np.ndarray

    @classmethod
    def of(cls, records: Sequence[Record], name: str, parameters: int) -> Samples:
        """The samples of records; raises, on behalf of the estimator `name`, if nothing can be fitted to them."""
        records = records_of(f"{name}.fit", records)
        for record in records:
            lacking = [channel for channel in ("depth_m", "piston_m") if not record.has(channel)]
            if lacking:
                raise ValueError(
                    f"{name}.fit needs the channels depth_m and piston_m, got {', '.join(record.names)}: add "
                    f"{' and '.join(lacking)}, or map a column to it on reading."
                )
        parts = [_segment(record, part) for record in records for part in record.segments]
        found = cls(*(np.concatenate(columns) for columns in zip(*parts)))
        rows, needed = sum(max(part[0].size - 2, 0) for part in parts), SAMPLES_PER_PARAMETER * parameters
        if rows < needed:
            raise ValueError(
                f"{name}.fit needs at least {needed} samples with two before them in their segment, got {rows}: "
                "record longer."
            )
        if np.unique(found.piston).size < 3:
            raise ValueError(
                f"{name}.fit needs a piston that takes at least 3 positions, got {np.unique(found.piston).size}: "
                "nothing excites the float, or not enough to tell its parameters apart. Record a dive with a return."
            )
        if np.ptp(found.depth) == 0.0:
            raise ValueError(f"{name}.fit needs a float that moves, got {found.depth[0]:g} m throughout.")
        return found

    @property
    def sample_time(self) -> float:
        """Median interval, s."""
        return float(np.median(self.interval[self.interval > 0.0]))


def _segment(record: Record, part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    depth, piston, time = record["depth_m"][part], record["piston_m"][part], record.time[part]
    return depth, np.concatenate([piston[:1], piston[:-1]]), np.diff(time, prepend=time[0])
