"""Tests of how a candidate's fit begins: first values, a few steps, and what these promise."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.begun import _first_values, begun_from, rival_of
from identification.diagnosis.search.candidates import Candidate, Screening, screen
from identification.diagnosis.search.trials import judged
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK

OFFSET, LAG = "effects.rudder.offset", "effects.rudder.lag"


def screened_of(path: str, estimate: float = 0.0, evidence: float = 0.0) -> Screening:
    return Screening(Candidate(path, (path,)), np.array([estimate]), evidence, 1.0, np.zeros(1))


def test_starts_move_with_a_candidate_and_the_coefficients_that_it_moves():
    """The pump errs by 7 % and the drag by 9 %, so that the unknown volume of each dive moves far with them."""
    plant, pump = replace(load_vehicle("mermaid"), deviations={}), "effects.oil.pump_gain"
    drags = {p: 0.91 * value_at(plant, p) for p in ("hull.drag_quadratic", "hull.drag_linear")}
    record = run_mission(replace_at(plant, {pump: 0.07, **drags}), np.random.default_rng(3))
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    state = bench.fit(bench.plant, bench.plant.coefficients)
    (one,) = screen(bench.problem, state.point, state.paths, [Candidate(pump, (pump,))], 10.0)
    assert one.evidence > 30.0
    assert begun_from(bench, state, state, one, state).promise == pytest.approx(one.evidence, rel=0.1)


def test_a_base_with_other_noises_is_compared_with_the_state_at_these(offset_log):
    bench, state, _ = offset_log
    logs = state.point.logs.copy()
    logs[0] += 0.7  # twice the heading's noise
    loud = replace(state, point=bench.problem.point(state.point.vector, logs, state.point))
    rival = rival_of(bench, state, loud)
    assert np.array_equal(rival.point.logs, logs)
    assert 0.0 <= bench.gain(loud, rival) < 5.0
    assert bench.gain(state, rival) < -50.0
    assert rival_of(bench, state, state) is state


@pytest.mark.parametrize("seed", [3, 4])
def test_beside_coefficients_as_given_what_is_idle_promises_nothing(seed):
    """A few steps from there bring the coefficients closer to the truth, whichever candidate is added."""
    path, *_ = paths = QUICK.family.coefficients
    true = replace_at(QUICK, path, 0.6 * value_at(QUICK, path))
    record = run_mission(true, np.random.default_rng(seed), duration=500.0)
    bench, idle = Workbench(QUICK, record, parts_of(QUICK, record), 0.1), "effects.yaw.roll_moment"
    state = bench.fit(QUICK, paths)
    (base,) = bench.with_given(state)
    (one,) = screen(bench.problem, base.point, paths, [Candidate(idle, (idle,))], 10.0)
    promised = begun_from(bench, state, base, one, rival_of(bench, state, base)).promise
    assert promised < 1.0
    fixed = replace(state, point=bench.problem.point(state.point.vector, base.point.logs, state.point))
    assert begun_from(bench, state, base, one, fixed).promise > 10.0  # enough for a finalist


def test_begun_with_too_little_process_noise_promises_are_no_more_than_whole_fits_gain(offset_log):
    """With less noise nearly everything promises much; what the state's own noise leaves of it is compared instead."""
    bench, state, candidates = offset_log
    base, *_ = bench.quieted(state)
    assert rival_of(bench, state, base) is state
    ends, loud, least = {}, {}, {}
    for path in (OFFSET, LAG, "effects.compass.bias"):
        (own,) = (c for c in candidates if path in c.paths)
        (screening,) = screen(bench.problem, base.point, state.paths, [own], 10.0)
        begun = begun_from(bench, state, base, screening, rival_of(bench, state, base))
        whole = judged(bench, state, own, screening, begun.state, len(candidates))
        ends[path], loud[path] = (begun.promise, whole.train), screening.evidence
        weaker = bench.problem.point(begun.state.point.vector, base.point.logs, begun.state.point)
        least[path] = bench.gain(state, replace(begun.state, point=weaker))
    assert all(promise <= max(train, 0.0) + 1.0 for promise, train in ends.values())
    assert ends[OFFSET][0] > 0.5 * ends[OFFSET][1]
    assert ends[LAG][0] > least[LAG] + 10.0
    assert max(v for p, v in loud.items() if p != OFFSET) > 10.0 * max(v for p, (v, _) in ends.items() if p != OFFSET)


def test_what_is_begun_beside_weaker_process_noise_ends_with_the_noises_that_suit_it(offset_log):
    bench, state, candidates = offset_log
    base, *_ = bench.quieted(state)
    (offset,) = (c for c in candidates if OFFSET in c.paths)
    (screening,) = screen(bench.problem, base.point, state.paths, [offset], 10.0)
    begun = begun_from(bench, state, base, screening, state)
    assert begun.quiet
    weaker = bench.problem.point(begun.state.point.vector, base.point.logs, begun.state.point)
    assert (
        begun.promise == bench.gain(state, begun.state) > bench.gain(state, replace(begun.state, point=weaker)) + 10.0
    )


def test_a_first_value_whose_run_is_lost_gives_way_to_the_others(offset_log):
    bench, state, candidates = offset_log
    (offset,) = (c for c in candidates if OFFSET in c.paths)
    problem, screening = bench.problem, screen(bench.problem, state.point, state.paths, [offset], 10.0)[0]
    whole, lost = begun_from(bench, state, state, screening, state), []

    class Losing:
        """The problem, except that its first run is lost as in the filter, with NaN scores."""

        def __getattr__(self, name):
            return getattr(problem, name)

        def with_gains(self, point, vector):
            lost.append(vector[problem.index[OFFSET]])
            made = problem.with_gains(point, vector)
            return made if len(lost) > 1 else replace(made, scores=np.full_like(made.scores, np.nan))

    other = copy(bench)
    other.problem = Losing()
    begun = begun_from(other, state, state, screening, state)
    assert len(lost) > 1
    assert begun.state.finite
    assert value_at(begun.state.plant, OFFSET) == pytest.approx(value_at(whole.state.plant, OFFSET), rel=0.2)


@pytest.mark.parametrize(
    "path, estimate, probes",
    [
        (OFFSET, 3.0, [1.0, 3.0, -1.0]),
        (OFFSET, -0.2, [-1.0, 1.0, -0.2]),  # a probe may be too large for the record
        (OFFSET, 90.0, [1.0, 12.0, -1.0]),
        (LAG, -3.0, [1.0, 3.0, 6.0]),  # one-sided: never negative; larger sizes may show what small ones do not
    ],
)
def test_a_fit_starts_on_both_sides_of_neutral_or_beyond_a_corner(path, estimate, probes):
    starts = _first_values(QUICK, screened_of(path, estimate))
    probe = spec_at(QUICK, path).probe
    assert [value / probe for (value,) in starts] == pytest.approx(probes)
