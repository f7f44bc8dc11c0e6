"""What a run over a record is given: its windows, and its corrections at every row; runs shared among threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from auv_gym.compiled import threads
from auv_gym.model import Model, inputs_of
from auv_gym.plant.charts import Chart
from auv_gym.records.record import Record
from auv_gym.threads import side_by_side
from auv_gym.vehicles import Family

SHARED_ROWS = 5000  # of all runs together; from this number on, threads share the runs


class OfFamily(Model, Protocol):
    """A model whose equations are those of a vehicle family, as a `Plant` is."""

    @property
    def family(self) -> Family: ...


@dataclass(frozen=True, eq=False)
class Runs:
    """Windows of a record in the form for the compiled rollout, made once for a whole fit.

    references: (n, 4), of a chart that gives the attitudes in starts and outputs, see `Chart`; (0, 4) for Euler angles.
    """

    begin: np.ndarray
    stop: np.ndarray
    times: np.ndarray
    inputs: np.ndarray
    first: np.ndarray
    rows: int
    references: np.ndarray
    stride: int
    shares: np.ndarray

    @classmethod
    def over(
        cls,
        model: Model,
        record: Record,
        windows: Sequence[slice],
        chart: Chart | None = None,
        stride: int = 1,
        shares: np.ndarray | None = None,
    ) -> Runs:
        """Runs over windows of a record, each a whole multiple of `stride` samples, which is 1 with a chart.

        shares: (n, n_outputs), weights of each sample's outputs in its row, if the stride is more than 1.
        """
        first = np.empty(record.time.size, dtype=np.int64)
        for segment in record.segments:
            first[segment] = segment.start
        for w in windows:
            if not 0 <= w.start < w.stop <= first.size or first[w.start] != first[w.stop - 1]:
                raise ValueError(f"A window must lie inside a segment of the record, got rows {w.start} to {w.stop}.")
        begin = np.array([w.start for w in windows], dtype=np.int64)
        stop = np.array([w.stop for w in windows], dtype=np.int64)
        references = (chart or Chart.off()).references
        shares = np.empty((0, len(model.outputs))) if shares is None else shares
        times, inputs, rows = record.time.copy(), inputs_of(model, record), int((stop - begin).sum()) // stride
        return cls(begin, stop, times, inputs, first, rows, references, stride, shares)


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrections of a run at every row, see `auv_gym.plant.rollout.rollout`.

    measured: (rows, n_outputs), NaN without a reading.  gains: (rows, N, C), or (0, ...) for free runs, for the `moved`
    entries, (N,), of the F states, sensor states and accelerations, and the outputs listed in `told`, (C,).
    kicks: (D, 4).  decays: (rows, D).  carried: (W,) bool.  constant: (n_states,) bool.
    """

    measured: np.ndarray
    gains: np.ndarray
    moved: np.ndarray
    told: np.ndarray
    kicks: np.ndarray
    decays: np.ndarray
    carried: np.ndarray
    constant: np.ndarray

    @classmethod
    def none(cls, plant: OfFamily, runs: Runs) -> Correction:
        """No corrections, for free runs."""
        none, windows = np.empty(0, dtype=np.int64), runs.begin.size
        return cls(
            np.empty((0, len(plant.outputs))), np.empty((0, 0, 0)), none, none, np.empty((0, 4)), np.empty((0, 0)),
            np.zeros(windows, dtype=bool), np.zeros(len(plant.family.states), dtype=bool),
        )  # fmt: skip


def shared_out(count: int, rows: int, run: Callable[[slice], None]) -> None:
    """Perform all of `count` runs, in threads if there are many rows."""
    shares = threads() if count * rows >= SHARED_ROWS else 1
    edges = np.linspace(0, count, shares + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges.tolist())]
    side_by_side(run, parts)
