"""The likelihood of a record by the one-step errors of an extended Kalman filter, with noise of sensors and of motion.

Free runs blame the sensors for all that a model does not explain.  Waves, gusts and turbulence push the vehicle, and a
controller steers against them, so that a fit of free runs in closed loop is biased.  Here accelerations of unknown
strength and correlation time push it; where these come to nothing, the filter is a free run, the fit output error.
Sources: Ljung 1999, ch. 7; Harvey 1989, ch. 3; Forssell and Ljung 1999, Automatica 35, pages 1215-1241.
The parts: what a record tells (`stretches.py`), a vehicle that follows it (`followed.py`), its `sensitivities.py`, the
filter (`filtering.py`) and `noises.py`; the fit is here.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.fit.followed import Point
from identification.fit.noises import FAR, Noise, Noises
from identification.fit.online import FilterPlan
from identification.fit.sensitivities import LEAST_GAIN

_QUIETER = 30.0  # times weaker accelerations, with which a fit is tried too
_HALVINGS, _SHORTER = 6, 0.4  # of a step that is not confirmed, and by how much
_DOUBLINGS = 5
_FAR_TURN = 1.0  # of the log-likelihood, that a turn brings after which responses are taken anew before a fit ends
_SLOW = 0.3  # of what the turn before has brought: Gauss and Newton's steps bring far less each time
_FIRST_NOISE_STEPS, NOISE_STEPS = 40, 6  # to better noises, at first and after each turn of a fit


class PredictionErrors(Noises):
    """Measured outputs of a record over stretches, and the filters of a plant that predict them row by row.

    Arguments: see `identification.fit.stretches.Stretches`.
    """

    def solve(
        self,
        plant: Plant,
        paths: Sequence[str],
        near: Point | None = None,
        iterations: int = 12,
        noise: bool = True,
        gain: float = LEAST_GAIN,
    ) -> Point:
        """The point of greatest likelihood over the paths and, with `noise`, the noises, from the plant's values.

        near: a point with noises and starts to begin with, which is not left if it is of these values and as likely.
        In turns: parameters with the filter's gains held, gains made anew, noises.  It ends where a turn raises the
        log-likelihood by less than `gain`.  Where turns bring hardly less than those before, they go along a narrow
        valley by short steps, and the next one is made longer as long as that helps.
        """
        here, known = self._begun(plant.vector, near), None
        if noise:
            here, known = self._renewed(here, paths, _FIRST_NOISE_STEPS if near is None else NOISE_STEPS)
        here = self.prepared(here, paths)
        own, last = False, np.inf  # own: whether responses are those of this point, or one near by
        for _ in range(iterations):
            before = self.objective(here, paths)
            there = self.descended(here, paths)
            fresh = self._confirmed(here, there, paths, before - gain)
            if self.objective(fresh, paths) - before > _SLOW * last:
                fresh = self._further(here, fresh, paths, gain)
            # noises suit the parameters already where these stay as they are
            if noise and not (own and self.objective(fresh, paths) <= before + gain):
                fresh, known = self._renewed(fresh, paths, NOISE_STEPS, known)
            gained = last = self.objective(fresh, paths) - before
            here = fresh if gained > 0.0 else here
            own = own and gained < _FAR_TURN
            if gained > gain:
                continue
            if self.is_answered(here) and not own:  # no fit ends by slopes that were taken farther away
                here, own = self.prepared(here, paths, anew=True), True
                continue
            there = self._weaker(here, paths) if noise else here
            if not self.objective(there, paths) > self.objective(here, paths) + gain:
                break
            here, known, own = there, None, False
        else:
            return self._stilled(here, paths) if noise else here
        return here

    def _begun(self, vector: np.ndarray, near: Point | None) -> Point:
        """Where a fit begins: a point near by if it is of these values, however its gains were made, or the filter.

        With the first guess of noises where the vehicle runs away with those of the point near by.
        """
        if near is not None and np.array_equal(vector, near.vector):
            return self.with_gains(near, vector)
        point = self.point(vector, self.first_noise() if near is None else near.logs, near)
        return self.point(vector, self.first_noise()) if near is not None and point.system is None else point

    def _confirmed(self, here: Point, there: Point, paths: Sequence[str], least: float) -> Point:
        """The filter at the end of a step that was taken with the gains held, or of a shorter one if it is less likely.

        None is left where tries fall behind in proportion to their lengths, twice in a row, and not to the squares of
        these: the gains, which the step has held, then lose by any such step more than it brings.
        """
        lost: list[float] = []
        for _ in range(_HALVINGS):
            fresh = here if there is here else self.point(there.vector, there.logs, there)
            reached = self.objective(fresh, paths)
            if reached > least or not paths:
                return fresh
            lost.append(least - reached)
            shares = [after / loss for loss, after in pairwise(lost[-3:])]
            if len(shares) == 2 and all(_SHORTER**1.5 < share < _SHORTER**0.5 for share in shares):
                break
            there = self.with_gains(here, here.vector + _SHORTER * (there.vector - here.vector))
        return here

    def _weaker(self, here: Point, paths: Sequence[str]) -> Point:
        """The likelier of what is reached from weaker accelerations: without any, or from much weaker ones."""
        there = self._stilled(here, paths)
        if there is here and paths and self.pushed:
            there = self._quieter(here, paths)
        return there

    def _stilled(self, here: Point, paths: Sequence[str]) -> Point:
        """The point without those accelerations whose absence is likelier, at what they cost.

        Without each as the linearised filter tells, and without any as the vehicle itself does: that filter is far from
        it where accelerations have carried it away.
        """
        if here.system is None or not self.pushed:
            return here
        there = np.flatnonzero(self._there(here.logs))
        logs, none = self._likeliest(here.system, here.logs, there), self._without(here.logs, there.tolist())
        lost = self.likelihood_of_noises(here.system, here.logs) - self.likelihood_of_noises(here.system, none)
        far = lost > FAR * len(self.rows)
        tried = {tuple(t): t for t in (logs, here.logs if far else none) if not np.array_equal(t, here.logs)}
        points = [here, *side_by_side(lambda logs: self.point(here.vector, logs, here), list(tried.values()))]
        return max(points, key=lambda p: self.objective(p, paths))

    def begun_with(self, point: Point) -> Point:
        """A point of the problem without its last noises (`with_noises`), with first guesses of these.

        Half of what pushes there is taken for a swell: where accelerations have taken its part, they leave none of it
        to find.  What lasts of a reading's errors is taken to be as large as they are.
        """
        count, pushed = len(self.channels), (point.logs.size - len(self.channels)) // 2
        anew = np.arange(len(self.pushed)) >= pushed
        strengths, times = np.zeros(len(anew)), np.full(len(anew), self.slowness[0])
        strengths[~anew], times[~anew] = np.split(point.logs[count:], 2)
        for d in np.flatnonzero(anew):
            if self.misread[d]:
                strengths[d] = point.logs[self.channels.index(self.pushed[d])]
            else:
                of = self.pushed.index(self.pushed[d])
                strengths[d] = strengths[of] + np.log(0.5)
            if self.swells[d]:
                times[d] = np.log(2.0 * self.periods[d])
        if self.swells[anew].any():
            strengths[~anew & ~self.swells] += np.log(0.7)
        return self.point(point.vector, np.r_[point.logs[:count], strengths, times])

    def quieted(self, here: Point, which: np.ndarray | None = None) -> Point | None:
        """The same parameters, what pushes the vehicle taken for much weaker; None where the filter loses its way.

        An unstable vehicle that hardly anything may push leaves the record, and its slopes then tell nothing.
        which: of the accelerations, by default all but those of a swell, which take no steady effect's part.
        """
        which = ~self.swells if which is None else which
        count, pushed = len(self.channels), len(self.pushed)
        logs = here.logs.copy()
        logs[count : count + pushed][which] -= np.log(_QUIETER)
        return self._if_it_follows(here, logs)

    def hurried(self, here: Point) -> Point | None:
        """The same parameters, accelerations that last taken for brief ones of the likeliest strengths.

        None where nothing lasts, or the filter loses its way.
        """
        lasting = np.flatnonzero(self.lasting(here))
        if here.system is None or not lasting.size:
            return None
        brief = self.slowness[2]
        logs = self._likeliest(here.system, self._without(here.logs, lasting.tolist()), lasting, self._guesses, brief)
        return self._if_it_follows(here, logs)

    def lasting(self, here: Point) -> np.ndarray:
        """Which accelerations of a point last longer than the vehicle's own motions do, (D,).

        What lasts takes a steady effect's part, which what is brief cannot.
        """
        return self.pushes(here) & (here.logs[len(self.channels) + len(self.pushed) :] > self.slowness[0])

    def _if_it_follows(self, here: Point, logs: np.ndarray) -> Point | None:
        """A point with other noises, None where its filter does not follow the record as that of the point does."""
        there = self.point(here.vector, logs, here)
        if here.system is None or not np.isfinite(there.scores).all() or not self._keeps_to(there, here.system):
            return None
        return there

    def renewed(self, point: Point, logs: np.ndarray, paths: Sequence[str]) -> Point:
        """The parameters of a point with the noises that suit them best, sought from some that may, or its own."""
        there = self._renewed(self.point(point.vector, logs, point), paths, NOISE_STEPS)[0]
        if self.objective(point, paths) > self.objective(there, paths):
            there = self._renewed(point, paths, NOISE_STEPS)[0]
        return there

    def _further(self, here: Point, there: Point, paths: Sequence[str], gain: float) -> Point:
        """The point at the end of a step, or further the same way, twice as far each time, while that brings more."""
        way, length = there.vector - here.vector, 1.0
        for _ in range(_DOUBLINGS):
            length *= 2.0
            beyond = self.bounded(here.vector + length * way, paths)
            point = self.point(beyond, there.logs, there)
            if not self.objective(point, paths) > self.objective(there, paths) + gain:
                break
            there = point
        return there

    def _quieter(self, here: Point, paths: Sequence[str]) -> Point:
        """The point that is reached if what pushes the vehicle is taken for much weaker at first, or for brief.

        Where an effect was missing, accelerations have grown to take its part, and would leave little of it to find.
        Where the parameters then leave each row far less likely, they are needed: better noises would bring them back.
        """
        for taken, brief in ((self.quieted, False), (self.hurried, True)):
            quiet = taken(here)
            if quiet is None:
                continue
            there = self.descended(quiet, paths)
            lost = self.objective(here, paths) - self.objective(there, paths)
            if lost < FAR * len(self.rows):
                there = self.renewed(there, there.logs if brief else here.logs, paths)
                if self.objective(there, paths) > self.objective(here, paths):
                    return there
        return here

    def _renewed(
        self, here: Point, paths: Sequence[str], steps: int, known: np.ndarray | None = None
    ) -> tuple[Point, np.ndarray]:
        """The point with better noises, or itself, and their curvature; known: that of a point near by."""
        about = self._about_itself(here)
        logs, known = self.better_noise(about, steps, known)
        if np.array_equal(logs, here.logs):
            return here, known
        there = self.point(here.vector, logs, about)
        return (there if self.objective(there, paths) > self.objective(here, paths) else here), known

    def _about_itself(self, here: Point) -> Point:
        """The point linearised about its own path: what noises suit another path says nothing of it.

        A step with the gains held leaves a point whose slopes are those of where it began.
        """
        if here.system is None or here.system.vector is None or np.array_equal(here.system.vector, here.vector):
            return here
        fresh = self.point(here.vector, here.logs, here)
        return here if fresh.system is None else fresh

    def standard_errors(self, plant: Plant, paths: Sequence[str], noise: Noise) -> dict[str, float]:
        """Standard error of each path, in its unit, all of them fitted, these noises known; infinite if untold."""
        point = self.point(plant.vector, self.logs_of(noise))
        _, flat = self.own_slopes(point, paths)
        normal = flat @ flat.T + np.diag(self.pulls(point.vector, paths)[1] ** 2)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-12, hermitian=True)
        errors = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / size
        return {p: float(e * self.scale(p)) if e > 0.0 else np.inf for p, e in zip(paths, errors, strict=True)}

    def online(self, point: Point, memory: float) -> FilterPlan:
        """The filter of a point for samples that come one by one; each row must be a sample."""
        assert self.stride == 1
        assert point.system is not None
        solid, states = len(self.live), len(self._shared)
        lasting = (self.live < states) | point.system.a[:, np.arange(solid), :solid].any(axis=(0, 2))
        variances, deviations, times = self._numbers(point.logs)
        there, live = deviations > 0.0, self.live[lasting]
        shared, first = np.r_[self._shared, np.zeros(self._size - states, bool)][live], point.path[:, :states]
        return FilterPlan(
            self.plant, self.channels, live, shared, np.median(first, axis=0), self.spread[live], self._probes(live),
            self.kicks[there], deviations[there], times[there], variances, memory,
        )  # fmt: skip
