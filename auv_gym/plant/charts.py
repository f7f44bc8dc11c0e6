"""Reference attitudes along a record, for fits in which Euler angles would break down.

Near the vertical, heading and roll change without bound while the vehicle hardly turns, and jump by half a turn.  A fit
then uses rotation vectors relative to the attitudes of the record (`auv_gym.physics.rotations`).  At each row, the
three states are small turns about the bow, starboard and downward axes.  The three outputs are turns about the level
axes ahead and to starboard and about the vertical, since the errors of inclinometers and compasses are about these; the
reading is zero.  Everything else in a fit stays the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.physics.rotations import into_chart, out_of_chart
from auv_gym.records.attitude import ANGLES, from_angles, interpolated, turns_far, unrolled
from auv_gym.records.record import Record
from auv_gym.vehicles import Family


@dataclass(frozen=True, eq=False)
class Chart:
    """Reference attitudes at each row of a record; `Chart.off` keeps Euler angles.

    references: (n, 4), quaternions.  turned: (n, 3), rad, the sum of the measured turns about the body axes since the
    segment began.  states: index of the attitude among the plant's states.  All empty if the chart is off.
    """

    references: np.ndarray
    turned: np.ndarray
    states: int = -1

    @classmethod
    def off(cls) -> Chart:
        return cls(np.empty((0, 4)), np.empty((0, 3)))

    @classmethod
    def along(cls, family: Family, record: Record, far: bool | None = None) -> Chart:
        """The chart for a fit of a vehicle to a record; it is on if the attitude was fully measured and turns far.

        far: whether it does; by default decided from the whole record, so that all of its windows share one chart.
        Between readings, references follow the shortest turn.
        """
        known = all(name in family.states and name in family.outputs and record.has(name) for name in ANGLES)
        if not known or far is False:
            return cls.off()
        table = record.matrix(ANGLES)
        if far is None and not any(turns_far(*table[part, :2].T) for part in record.segments):
            return cls.off()
        references, time = from_angles(*table.T), record.time
        read = np.all([record.readings(name) for name in ANGLES], axis=0)
        for part in record.segments:
            rows = part.start + np.flatnonzero(read[part])
            if 0 < rows.size < part.stop - part.start:
                references[part] = interpolated(time[part], time[rows], references[rows])
        turned = np.concatenate([unrolled(references[part]) for part in record.segments])
        return cls(references, turned, family.states.index(ANGLES[0]))

    @property
    def on(self) -> bool:
        return len(self.references) > 0

    def readings(self, names: Sequence[str], values: np.ndarray) -> np.ndarray:
        """Measured values, (rows, C), for comparison with a run in the chart; fully measured attitudes are zero."""
        return self._replaced(names, values, np.zeros((len(values), 3))) if self.on else values

    def signals(self, names: Sequence[str], values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Measured values, (rows, C), as signals that vary with the motion; attitudes as the sum of their turns."""
        return self._replaced(names, values, self.turned[rows]) if self.on else values

    def seen(self, starts: np.ndarray, rows: Sequence[int] | np.ndarray) -> np.ndarray:
        """States, (W, n_states), converted from Euler angles to the chart of these rows, (W,)."""
        return self._each(into_chart, starts, rows)

    def kept(self, starts: np.ndarray, rows: Sequence[int] | np.ndarray) -> np.ndarray:
        """States, (W, n_states), converted from the chart of these rows, (W,), to the plant's Euler angles."""
        return self._each(out_of_chart, starts, rows)

    def _each(self, change: Any, starts: np.ndarray, rows: Sequence[int] | np.ndarray) -> np.ndarray:
        starts = np.array(starts, dtype=float)
        if self.on:
            for start, row in zip(starts, rows, strict=True):
                change(self.references[row], start[self.states : self.states + 3])
        return starts

    def _replaced(self, names: Sequence[str], values: np.ndarray, attitudes: np.ndarray) -> np.ndarray:
        columns = [list(names).index(name) for name in ANGLES]
        read = np.isfinite(values[:, columns]).all(axis=1, keepdims=True)
        values = values.copy()
        values[:, columns] = np.where(read, attitudes, np.nan)
        return values
