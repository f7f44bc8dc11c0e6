"""An extended Kalman filter of a plant along a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.fit.adjoint import slopes_of
from identification.fit.followed import Point
from identification.fit.kalman import Pass, System, run_filter
from identification.fit.sensitivities import Sensitivities

_SAME = 0.05  # of the log-likelihood: starts that gain less leave the path as it is
_PASSES = 4  # of the filter, each from the starts fitted by the one before
_LOOSE = 0.3  # initial deviations of the filter, over those of the likeliest start of a stretch
_LEAST_LEFT = 1e-10  # least posterior share of a start's variance: less is rounding error
_TOO_FAR = 1e100  # information on a start, relative to its prior, whose square would overflow
FAR = 1.0  # loss of log-likelihood for each row at which a vehicle counts as far from its linearisation
_OTHER_NOISE = 0.7  # change of a noise's logarithm beyond which the precision of the starts is computed anew


def other_precision(near: Point, logs: np.ndarray) -> bool:
    """Whether noises are so far from a point's that the precision of the starts differs."""
    return bool(np.abs(logs - near.logs).max(initial=0.0) > _OTHER_NOISE)


class Filter(Sensitivities):
    """The filter of a plant over the stretches of a record, linearised about its own path."""

    def _better_starts(
        self, system: System, made: Pass, logs: np.ndarray, starts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The likeliest starts, and roots of their covariances with `_LOOSE` times their deviations.

        A filter that starts there stays near its linearisation.  The initial width does not matter: in a linear system,
        the filter's likelihood differs from that of the likeliest start only by a constant, whatever the model.
        """
        slopes = slopes_of(system, made, np.ones(len(self.rows)), *self._numbers(logs))
        starts, roots, solid = starts.copy(), np.zeros_like(system.start), len(self.live)
        for w in range(len(self.stretches)):
            free = np.flatnonzero(~self._fixed(w))
            own = np.ix_(free, free)
            units = self.spread[self.live][free]
            r = slopes.means[w, :solid][free] * units
            with np.errstate(over="ignore", invalid="ignore"):
                n = np.outer(r, r) - 2.0 * slopes.covariances[w, :solid, :solid][own] * np.outer(units, units)
            if not np.abs(n).max() < _TOO_FAR:  # the run is so far off that its likelihood has no usable slope
                roots[w] = system.start[w]
                continue
            root = system.start[w][:, free] / units
            # the covariance R'R becomes R'(I - R N R')R; the increase of its inverse is the information of the data
            values, vectors = np.linalg.eigh(np.eye(len(root)) - root @ n @ root.T)
            cross = (vectors / np.sqrt(np.clip(values, _LEAST_LEFT, 1.0))).T @ root @ n
            values, vectors = np.linalg.eigh(0.5 * (n + n.T) + cross.T @ cross)
            values = np.maximum(values, 0.0)
            data, before = (vectors * values) @ vectors.T, root.T @ root
            told = r + data @ (before @ r)
            away = (self.starts[w][self.live][free] - starts[w][self.live][free]) / units
            inverse = (vectors / (values + 1.0)) @ vectors.T  # of data + I, whatever the size of data
            step = inverse @ (told + away)
            starts[w, self.live[free]] += step * units
            half = vectors * np.minimum(_LOOSE / np.sqrt(values + 1.0), 1.0)
            roots[w][own] = (units[:, None] * half).T
        return starts, roots

    def point(self, vector: np.ndarray, logs: np.ndarray, near: Point | None = None) -> Point:
        """The filter with these parameters and noises, linearised along its own path.

        near: a point whose starts are the first guess.  A vehicle that is less likely, and has left the path of its own
        filter, is given up: an unstable one with hardly any process noise does so from any start nearby.
        """
        if near is None:
            first = self._system(vector, self.first_path, self.starts, self.widest)
            found, _ = self._filtered(vector, logs, first, self.starts, self.widest, anew=True, renewed=True)
            starts, roots = (found.starts, found.roots) if found.system else (self.starts, _LOOSE * self.widest)
        else:
            starts, roots = near.starts, near.roots
        renewed = near is None or other_precision(near, logs)
        responses = near.system.responses if near is not None and near.system is not None else None
        best, highest = None, -np.inf
        for _ in range(_PASSES):
            system = self._followed_system(vector, self._numbers(logs), starts, roots)
            system = replace(system, responses=responses)
            found, gained = self._filtered(vector, logs, system, starts, roots, anew=False, renewed=renewed)
            total = self.total(found)
            best, highest = (found, total) if total > highest else (best, highest)
            if gained < _SAME:  # the path belongs to these starts
                break
            if near is not None and total < self.total(near) and not self._keeps_to(found, system):
                break
            starts, roots, renewed = found.starts, found.roots, False
        return best or self._nowhere(vector, logs)

    def _filtered(
        self,
        vector: np.ndarray,
        logs: np.ndarray,
        system: System,
        starts: np.ndarray,
        roots: np.ndarray,
        *,
        anew: bool,
        renewed: bool,
    ) -> tuple[Point, float]:
        """The filtered point for a linearised vehicle, from the likeliest starts, and the log-likelihood gained.

        anew: whether the starts may be far from likely.  renewed: whether their precision may have changed.
        """
        if not (np.isfinite(system.a).all() and np.isfinite(system.error).all()):
            return self._nowhere(vector, logs), 0.0
        made = run_filter(system, *self._numbers(logs))
        if not np.isfinite(made.scores).all():
            return self._nowhere(vector, logs), 0.0
        if renewed:
            assert system.path is not None
            better, roots = self._better_starts(system, made, logs, starts)
            starts = better if anew else starts
            system = replace(system, start=roots, origin=self._origin(system.path, starts))
            made = run_filter(system, *self._numbers(logs))
        found = self._followed(vector, logs, starts, made.gains, made.whiten, system)
        if not (np.isfinite(found.path).all() and np.isfinite(found.scores).all()):
            return self._nowhere(vector, logs), 0.0
        there = self.descended(found, ())
        assert there.system is not None
        assert system.path is not None
        system = replace(there.system, origin=self._origin(system.path, there.starts))
        return replace(there, system=system), self.total(there) - self.total(found)

    def _keeps_to(self, here: Point, system: System) -> bool:
        """Whether the filter of a vehicle is about as likely as the linearised filter, and so stays near its path."""
        linear = float(run_filter(system, *self._numbers(here.logs)).scores.sum())
        return self.total(here) > linear - FAR * len(self.rows)

    def _nowhere(self, vector: np.ndarray, logs: np.ndarray) -> Point:
        """The point of a filter that diverges, with a likelihood of zero."""
        (rows, count), size = self.finite.shape, len(self._moving)
        none, unlikely = np.zeros((rows, count)), np.full(rows, -np.inf)
        gains, whiten = np.zeros((rows, size, count)), np.zeros((rows, count, count))
        first = (self.first_path, gains, whiten, none, self.starts, self.widest)
        return Point(vector, logs, none, unlikely, *first, None)
