"""Tests of detectable sizes, and of effects that have no effect up to some size."""

from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at, spec_at
from auv_gym.records.record import Record
from identification.diagnosis.judge.detectable import detectable_effects, sizes_shown
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.candidates import Candidate, Regression, Screening, deviations_shown
from identification.diagnosis.search.workbench import Workbench
from identification.diagnosis.wording import quantity
from tests.identification.diagnosis.stand_ins import PLANT
from tests.identification.gliders import QUICK

BAR = 16.0
DEADBAND = "effects.rudder.deadband"
LIMIT, RATE, LAG = "effects.rudder.lost_travel", "effects.rudder.slowness", "effects.rudder.lag"


def regression_of(changes=None, plant=PLANT):
    """A regression in which each effect changes the measurements by a function of its size in probes."""
    problem = SimpleNamespace(
        plant=plant,
        bounds=lambda path: spec_at(plant, path).bounds,
        scale=lambda path: spec_at(plant, path).probe,
    )
    ran: list[float] = []

    def shown(sizes):
        ran.extend(sizes.values())
        return {path: deviations_shown(BAR) * changes(size) for path, size in sizes.items()}

    return SimpleNamespace(problem=problem, threshold=BAR, shown=shown, ran=ran, fitted=())


@pytest.mark.parametrize("expected", [0.02, 3.0, 500.0, np.inf])
@pytest.mark.parametrize(
    "changes, size, hidden",
    [
        (lambda x: x / 3.0, 3.0, 0.0),
        (lambda x: max(x - 5.0, 0.0), 6.0, 5.0),  # a dead region
        (lambda x: max(x - 0.3, 0.0) / 0.2, 0.5, 0.3),  # one that ends below a probe
        (lambda x: x**2, 1.0, 0.0),
    ],
)
def test_the_smallest_size_is_found_by_running_it(changes, size, hidden, expected):
    probe = spec_at(PLANT, DEADBAND).probe
    regression = regression_of(changes)
    (found,) = sizes_shown(regression, {DEADBAND: expected * probe}).values()
    # a factor of two, halved twice on the logarithmic scale, is 1.19; between two visible sizes it is interpolated
    assert 0.98 * size < found.size / probe < 1.19 * size
    assert (found.hidden == 0.0) if hidden == 0.0 else 0.4 * hidden < found.hidden / probe <= hidden
    assert max(regression.ran) <= spec_at(PLANT, DEADBAND).bounds[1] / probe


@pytest.mark.parametrize("changes, reason", [(lambda x: 0.0, "nothing"), (lambda x: 1e-2 * min(x, 1.0), "too little")])
def test_an_effect_that_no_size_shows_is_said_to_be_one(changes, reason):
    rudder = Candidate("rudder deadband", (DEADBAND,))
    screened = [Screening(rudder, np.zeros(1), 0.0, 1.0, np.array([0.1]))]  # detectable according to its slope
    (found,) = detectable_effects(regression_of(changes), screened, set())  # type: ignore[arg-type]
    assert not np.isfinite(found.size)
    assert found.reason == f"changes {reason} {'that' if reason == 'nothing' else 'of what'} was measured"


def test_a_size_beyond_what_is_possible_is_none_that_the_record_shows():
    bias = Candidate("compass bias", ("effects.compass.bias",))  # within half a turn
    screened = [Screening(bias, np.zeros(1), 0.0, 1.0, np.array([size])) for size in (3.1, 11.5, np.inf)]
    found = detectable_effects(regression_of(), screened, set())  # type: ignore[arg-type]
    assert [d.size for d in found] == [3.1, np.inf, np.inf]
    assert [d.reason for d in found] == [
        "",
        "changes too little of what was measured",
        "changes nothing that was measured",
    ]
    assert detectable_effects(regression_of(), screened, {"effects.compass.bias"}) == ()  # type: ignore[arg-type]


def test_an_effect_that_acts_as_a_refitted_coefficient_has_no_detectable_size_of_its_own():
    gain = Candidate("rudder gain", ("effects.rudder.gain",))
    regression, screened = regression_of(), [Screening(gain, np.zeros(1), 0.0, 1.0, np.array([0.95]))]
    (held,) = detectable_effects(regression, screened, set())  # type: ignore[arg-type]
    assert held.size == 0.95
    regression.fitted = ("hull.n_delta",)
    (found,) = detectable_effects(regression, screened, set())  # type: ignore[arg-type]
    assert not np.isfinite(found.size)
    assert found.reason == "rudder effectiveness N_dr has the same effect"


def test_a_rate_limit_behind_a_lag_and_a_saturation_beyond_all_commands_are_hidden_up_to_some_size():
    """Behind a lag of 4 s, steps of 0.2 rad move at 0.05 rad/s at most; they reach half of the travel."""
    plant = replace_at(QUICK, LAG, 4.0)
    time = 4.0 * np.arange(240)
    rudder = 0.1 * np.where(time % 160.0 < 80.0, 1.0, -1.0)
    quiet = Record.from_arrays(time, {"rudder_rad": rudder, "u_mps": np.full(240, 0.35), "heading_rad": np.zeros(240)})
    clean = simulate(plant, quiet)["heading_rad"]
    noise = np.deg2rad(0.5) * np.random.default_rng(1).standard_normal(240)
    record = quiet.with_channels({"heading_rad": clean + noise})
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    state = bench.fit(plant, ())
    regression = Regression(bench.problem, state.point, state.paths, BAR)
    screened = regression.screened([Candidate(path, (path,)) for path in (LIMIT, RATE)])
    found = {d.path: d for d in detectable_effects(regression, screened, set())}
    for path in (LIMIT, RATE):
        shown, unit = found[path], spec_at(plant, path).unit
        assert np.isfinite(shown.size)
        (hidden,) = (s.hidden for s in sizes_shown(regression, {path: shown.size}).values())
        assert 0.5 * shown.size <= hidden < shown.size
        assert shown.reason.startswith("up to ")
        assert shown.reason.endswith(f"{quantity(1.0, unit).partition(' ')[2]}, it changes nothing that was measured")
        for size, seen in ((0.99 * hidden, False), (shown.size, True)):
            moved = simulate(replace_at(plant, path, size), quiet)["heading_rad"] - clean
            assert (np.abs(moved).max() > 1e-9) == seen
    assert found[RATE].size > 4.0 / 0.2  # s/rad
    without = [s for s in screened if s.candidate.paths[0] == LIMIT]
    assert not np.isfinite(without[0].detectable[0])  # according to its slope at a probe it is never detectable
