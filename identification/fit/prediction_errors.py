"""Prediction-error fits: the likelihood of a record by an extended Kalman filter with sensor and process noise.

A fit of free runs attributes all that a model does not explain to sensor noise.  But waves, gusts and turbulence push
the vehicle, and a controller steers against them, so that such a fit is biased in closed loop.  Here the vehicle is
pushed by random accelerations of unknown strength and correlation time.  If their strengths are zero, the filter is a
free run, and the fit is an output-error fit.
Sources: Ljung 1999, ch. 7; Harvey 1989, ch. 3; Forssell and Ljung 1999, Automatica 35, pages 1215-1241.
The base classes are in `stretches.py` (the record), `linearised.py`, `followed.py` (the vehicle along the record),
`sensitivities.py`, `filtering.py` and `noises.py`; this module has the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.fit.filtering import FAR, other_precision
from identification.fit.followed import Point
from identification.fit.noises import Noise, Noises
from identification.fit.online import FilterPlan
from identification.fit.sensitivities import LEAST_GAIN

_QUIETER = 30.0  # factor by which accelerations are weakened for a second try of a fit
_HALVINGS, _SHORTER = 6, 0.4  # tries of a step that is not confirmed, and the factor of its length from one to the next
_DOUBLINGS = 5  # most doublings of a step
_FAR_TURN = 1.0  # gain of log-likelihood by an iteration after which responses are recomputed before a fit ends
_SLOW = 0.3  # gain of an iteration, over the last one, above which its step is lengthened: Gauss-Newton gains far less
_FIRST_NOISE_STEPS, NOISE_STEPS = 40, 6  # most steps of the noises, at first and after each iteration of a fit


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
        settled: bool = False,
    ) -> Point:
        """The point of greatest likelihood over the paths and, with `noise`, the noises, from the plant's values.

        Each iteration fits the parameters with the filter's gains held, then recomputes the gains, then fits the
        noises.  A fit ends when an iteration raises the log-likelihood by less than `gain`, and weaker accelerations do
        not help.  If an iteration gains hardly less than the one before, the fit follows a narrow valley in short
        steps: the step is then lengthened as long as that helps.
        near: a point whose noises and initial states the fit begins with; the result is no less likely if the point
        has the plant's values.  settled: whether weaker accelerations have been tried there.
        """
        here, known = self._begun(plant.vector, near), None
        if noise:
            here, known = self._renewed(here, paths, _FIRST_NOISE_STEPS if near is None else NOISE_STEPS)
        here = self.prepared(here, paths)
        own, last = False, np.inf  # own: whether the responses are those of this point or of one close to it
        for _ in range(iterations):
            before = self.objective(here, paths)
            there = self.descended(here, paths)
            fresh = self._confirmed(here, there, paths, before - gain)
            if self.objective(fresh, paths) - before > _SLOW * last:
                fresh = self._further(here, fresh, paths, gain)
            # if the parameters stay as they are, the noises suit them already
            if noise and not (own and self.objective(fresh, paths) <= before + gain):
                fresh, known = self._renewed(fresh, paths, NOISE_STEPS, known)
            gained = last = self.objective(fresh, paths) - before
            here = fresh if gained > 0.0 else here
            own = own and gained < _FAR_TURN
            if gained > gain:
                continue
            if self.is_answered(here) and not own:  # a fit must not end by slopes from farther away
                here, own = self.prepared(here, paths, anew=True), True
                continue
            there = self._weaker(here, paths) if noise and not settled else here
            if not self.objective(there, paths) > self.objective(here, paths) + gain:
                break
            here, known, own = there, None, False
        else:
            return self.stilled(here, paths) if noise else here
        return here

    def _begun(self, vector: np.ndarray, near: Point | None) -> Point:
        """The point where a fit begins: with the gains of the nearby point if it has these values, else filtered anew.

        If the vehicle diverges with the noises of the nearby point, the fit begins with the first guess of noises.
        """
        if near is not None and np.array_equal(vector, near.vector):
            return self.with_gains(near, vector)
        point = self.point(vector, self.first_noise() if near is None else near.logs, near)
        return self.point(vector, self.first_noise()) if near is not None and point.system is None else point

    def _confirmed(self, here: Point, there: Point, paths: Sequence[str], least: float) -> Point:
        """The filter at the end of a step that was made with the gains held, or of a shorter step, or the first point.

        A step is shortened until its end has more than the `least` objective.  The tries end if the loss decreases,
        twice in a row, in proportion to the length and not to its square: with recomputed gains, any step of this
        direction then loses more than it gains.
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
        """The point without some accelerations, or what a fit from weaker ones reaches, if either is likelier."""
        there = self.stilled(here, paths)
        if there is here and paths and self.pushed:
            there = self._quieter(here, paths)
        return there

    def stilled(self, here: Point, paths: Sequence[str]) -> Point:
        """The point without those accelerations whose absence is likelier, given their cost.

        The linearised filter judges each acceleration by itself.  The absence of all is judged by the vehicle itself,
        unless it is hopeless in the linearised filter, since this filter is far from a vehicle that accelerations have
        carried away.
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
        """A point of a problem without the last added noises (`with_noises`), with first guesses for these.

        A swell gets half the strength of the acceleration of the same velocity.  The other accelerations are weakened:
        having absorbed the swell, they would leave nothing of it to find.  A lasting sensor error gets the size of its
        channel's noise.
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
        """The point with the same parameters and much weaker accelerations; None if its filter leaves the record.

        With hardly any process noise, an unstable vehicle leaves the record, and its slopes hold no information.
        which: the weakened accelerations, (D,) bool; by default all but a swell's, which absorb no steady effect.
        """
        which = ~self.swells if which is None else which
        count, pushed = len(self.channels), len(self.pushed)
        logs = here.logs.copy()
        logs[count : count + pushed][which] -= np.log(_QUIETER)
        return self._if_it_follows(here, logs)

    def hurried(self, here: Point) -> Point | None:
        """The point with the same parameters and brief accelerations instead of lasting ones, of likeliest strengths.

        None if no acceleration lasts, or if the filter leaves the record.
        """
        lasting = np.flatnonzero(self.lasting(here))
        if here.system is None or not lasting.size:
            return None
        brief = self.slowness[2]
        logs = self._likeliest(here.system, self._without(here.logs, lasting.tolist()), lasting, self._guesses, brief)
        return self._if_it_follows(here, logs)

    def lasting(self, here: Point) -> np.ndarray:
        """Which accelerations of a point last longer than the vehicle's own motions, (D,).

        Unlike brief accelerations, lasting ones can absorb a steady effect.
        """
        return self.pushes(here) & (here.logs[len(self.channels) + len(self.pushed) :] > self.slowness[0])

    def _if_it_follows(self, here: Point, logs: np.ndarray) -> Point | None:
        """The point with other noises, or None if its filter does not follow the record as well as the point's own."""
        there = self.point(here.vector, logs, here)
        if here.system is None or not np.isfinite(there.scores).all() or not self._keeps_to(there, here.system):
            return None
        return there

    def renewed(self, point: Point, logs: np.ndarray, paths: Sequence[str], missing: bool = True) -> Point:
        """The point with the likeliest noises for its parameters, sought from given ones, or else from its own.

        missing: whether accelerations that are missing are tried.
        """
        known = None if missing else np.eye(logs.size)
        there = self._renewed(self.point(point.vector, logs, point), paths, NOISE_STEPS, known)[0]
        if self.objective(point, paths) > self.objective(there, paths):
            there = self._renewed(point, paths, NOISE_STEPS, known)[0]
        return there

    def _further(self, here: Point, there: Point, paths: Sequence[str], gain: float) -> Point:
        """The point at the end of a step, which is doubled as long as the objective rises by more than `gain`.

        The gains are held along the way, and recomputed at its end.
        """
        way, moved, best, length = there.vector - here.vector, there.starts - here.starts, there, 1.0
        for _ in range(_DOUBLINGS):
            length *= 2.0
            beyond = self.bounded(here.vector + length * way, paths)
            point = self.descended(self.with_gains(there, beyond, here.starts + length * moved), ())
            if not self.objective(point, paths) > self.objective(best, paths) + gain:
                break
            best = point
        if best is there:
            return there
        fresh = self.point(best.vector, best.logs, best)
        return fresh if self.objective(fresh, paths) > self.objective(there, paths) else there

    def _quieter(self, here: Point, paths: Sequence[str]) -> Point:
        """The point that a fit reaches from much weaker accelerations, or from brief ones, if it is likelier.

        If an effect was missing, accelerations have grown to absorb it, and would leave little of it to find.
        """
        for there in side_by_side(lambda reach: reach(here, paths), (self._from_weaker, self.from_brief)):
            if there is not None and self.objective(there, paths) > self.objective(here, paths):
                return there
        return here

    def _from_weaker(self, here: Point, paths: Sequence[str]) -> Point | None:
        """The point that a step of a fit reaches from much weaker accelerations; None if these are needed."""
        weaker = self.quieted(here)
        return None if weaker is None else self._settled(here, weaker, here.logs, paths)

    def from_brief(self, here: Point, paths: Sequence[str]) -> Point | None:
        """The point that a step of a fit reaches from brief accelerations in place of lasting ones.

        None if no acceleration lasts, or if the lasting ones are needed.
        """
        brief = self.hurried(here)
        return None if brief is None else self._settled(here, brief, None, paths)

    def _settled(self, here: Point, there: Point, logs: np.ndarray | None, paths: Sequence[str]) -> Point | None:
        """The end of a step of a fit from `there`, with noises sought from given ones, or else from its own.

        None if each row is far less likely after the fit of the parameters than `here`: the accelerations are then
        needed, and a fit of the noises would only bring them back.
        """
        there = self.descended(there, paths)
        if self.objective(here, paths) - self.objective(there, paths) >= FAR * len(self.rows):
            return None
        return self.renewed(there, there.logs if logs is None else logs, paths)

    def _renewed(
        self, here: Point, paths: Sequence[str], steps: int, known: np.ndarray | None = None
    ) -> tuple[Point, np.ndarray]:
        """The point with better noises, or itself, and their inverse curvature; known: that of a nearby point."""
        about = self._about_itself(here)
        logs, known = self.better_noise(about, steps, known)
        if np.array_equal(logs, here.logs):
            return here, known
        if other_precision(about, logs):
            there = self.point(here.vector, logs, about)
        else:  # hardly moves the path about which the vehicle is linearised
            there = self.descended(self.with_noise(about, logs), ())
        return (there if self.objective(there, paths) > self.objective(here, paths) else here), known

    def _about_itself(self, here: Point) -> Point:
        """The point linearised about its own path, since noises that suit another path need not suit this one.

        A point at the end of a step with the gains held has the slopes of the step's beginning.
        """
        if here.system is None or here.system.vector is None or np.array_equal(here.system.vector, here.vector):
            return here
        fresh = self.point(here.vector, here.logs, here)
        return here if fresh.system is None else fresh

    def standard_errors(self, plant: Plant, paths: Sequence[str], noise: Noise) -> dict[str, float]:
        """Standard error of each path, in its unit, all fitted, with known noises; infinite if undetermined."""
        point = self.point(plant.vector, self.logs_of(noise))
        _, flat = self.own_slopes(point, paths)
        normal = flat @ flat.T + np.diag(self.pulls(point.vector, paths)[1] ** 2)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-12, hermitian=True)
        errors = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / size
        return {p: float(e * self.scale(p)) if e > 0.0 else np.inf for p, e in zip(paths, errors, strict=True)}

    def online(self, point: Point, memory: float) -> FilterPlan:
        """The filter of a point as a plan for samples that arrive one by one; each row must be a single sample."""
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
