"""Tests of discovered terms: found in logs with a force outside the library of effects, and none in other logs."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import linear_yaw_coefficients, yaw_inertia
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import acceptance, discovery, terms
from identification.diagnosis.search.discovery import Discovery, Term, discover, library_of
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.terms import Found
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.missions import run_mission
from identification.fit.windows import free_run_windows
from tests.identification.diagnosis.stand_ins import Table, state_of
from tests.identification.gliders import QUICK

YAW = "effects.discovered.yaw."


def searched(plant, record, window=None, settle=None, seed=0) -> Discovery:
    bench = Workbench(
        plant, record, parts_of(plant, record), windows=free_run_windows(plant, record, window or plant.window)
    )
    state = bench.fit(bench.plant, plant.family.coefficients)
    return discover(bench, state, library_of(plant), np.random.default_rng(seed), settle or plant.settle)


def turned_by(moment, seed: int) -> Record:
    """A log of the Slocum's commands with a heading by independent integration, with a moment (psi, r, u, roll).

    The integration is by Heun's method with a fiftieth of a sample, on the linear form of yaw.
    """
    plant, rng = QUICK, np.random.default_rng(seed)
    record = run_mission(plant, rng, duration=1500.0)
    hull = plant.family.view(plant.vector).hull
    (damping, effect), inertia = linear_yaw_coefficients(hull), yaw_inertia(hull)
    rudder, u, roll = record["rudder_rad"], record["u_mps"], np.zeros(len(record))
    turning = np.cos(record["roll_rad"]) / np.cos(record["pitch_rad"])  # of the heading, by a body yaw rate
    step, headings = plant.dt / 50, []
    psi, r = float(record["heading_rad"][0]), 0.0
    for k in range(len(record)):
        headings.append(psi)
        for _ in range(50):
            first = damping * r + effect * rudder[k] + moment(psi, r, u[k], roll[k]) / inertia
            ahead = r + step * first
            second = damping * ahead + effect * rudder[k]
            second += moment(psi + step * turning[k] * r, ahead, u[k], roll[k]) / inertia
            psi, r = psi + 0.5 * step * turning[k] * (r + ahead), r + 0.5 * step * (first + second)
    noisy = np.array(headings) + rng.normal(0.0, np.radians(0.5), len(record))
    kept = [n for n in record.names if n in plant.inputs]
    return Record.from_arrays(record.time, {**{n: record[n] for n in kept}, "heading_rad": noisy})


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_moment_simulated_elsewhere_is_found_with_its_size(seed):
    found = searched(QUICK, turned_by(lambda psi, r, u, roll: 0.02 * np.sin(2.0 * psi), seed))
    assert found.holds
    (term,) = found.terms
    assert term.path == f"{YAW}sin_2heading"
    assert term.frequency >= 0.8
    assert term.ci95[0] < 0.02 < term.ci95[1]
    assert term.ci95[1] - term.ci95[0] < 0.006
    assert term.evidence_held > 20.0
    assert value_at(found.plant, term.path) == term.value
    assert "times sin 2 heading, 95 % interval 0.0" in found.summary()


def test_a_law_that_no_term_is_finds_one_near_it_or_nothing():
    """No term is proportional to the root of r: a term found instead must predict parts, or is rejected."""
    record = turned_by(lambda psi, r, u, roll: -0.08 * np.sign(r) * np.sqrt(abs(r)), 0)
    found = searched(QUICK, record)
    assert all(t.evidence_held > 6.6 for t in found.terms)
    assert {t.path.removeprefix(YAW) for t in found.terms} <= {"r", "r_r", "rudder_rudder", "ur", "wr"}


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_log_has_no_term(seed):
    plant = QUICK
    found = searched(plant, run_mission(plant, np.random.default_rng(100 + seed), duration=900.0))
    assert not found.terms
    assert not found.rejected
    assert found.paths == plant.family.coefficients
    assert found.summary() == "No term in the library explains the remaining error."


@pytest.mark.slow
def test_a_search_repeats_to_the_last_digit():
    record = turned_by(lambda psi, r, u, roll: 0.02 * np.sin(2.0 * psi), 0)
    first, second = (searched(QUICK, record, seed=7) for _ in range(2))
    assert first.terms == second.terms
    assert first.rejected == second.rejected


@pytest.mark.parametrize("left", [False, True])
def test_a_second_term_is_sought_where_something_is_left(monkeypatch, left):
    asked, real = [], discovery.search
    monkeypatch.setattr(discovery, "what_is_left", lambda bench, state: Left(changes="x" if left else ""))
    monkeypatch.setattr(discovery, "search", lambda *args: asked.append(args) or real(*args))
    found = searched(QUICK, turned_by(lambda psi, r, u, roll: 0.02 * np.sin(2.0 * psi), 0))
    assert [t.path for t in found.terms] == [f"{YAW}sin_2heading"]
    assert len(asked) == 1 + left


@pytest.mark.slow
def test_a_term_that_another_one_makes_idle_goes(monkeypatch):
    """The first search excludes the true term and finds another, which passes; the second finds the true one."""
    asked, real, true = [], discovery.search, f"{YAW}sin_2heading"

    def blind_at_first(bench, state, library, rng):
        asked.append(library)
        if len(asked) == 1:
            return real(bench, state, [p for p in library if p != true], rng)
        paths, scales = (*state.paths, true), dict.fromkeys([*library, *state.paths[2:]], 0.01)
        problem = bench.problem.scaled(scales)
        point = problem.solve(replace_at(state.plant, true, 0.02), paths, state.point)
        return Found(true, State(problem.plant_at(point, paths), paths, point), 1.0, (), scales)

    monkeypatch.setattr(discovery, "search", blind_at_first)
    monkeypatch.setattr(discovery, "what_is_left", lambda bench, state: Left(changes="x"))
    found = searched(QUICK, turned_by(lambda psi, r, u, roll: 0.02 * np.sin(2.0 * psi), 0))
    assert len(asked) == 2
    assert [t.path for t in found.terms] == [true]
    assert [(t.path, bool(t.objection)) for t in found.rejected] == [(f"{YAW}cos_heading", True)]
    assert value_at(found.plant, f"{YAW}cos_heading") == 0.0
    assert found.terms[0].value == value_at(found.plant, true) == pytest.approx(0.02, abs=0.003)


def test_a_term_that_parts_do_not_foretell_is_rejected_with_the_reason(monkeypatch):
    record = turned_by(lambda psi, r, u, roll: 0.02 * np.sin(psi), 3)
    monkeypatch.setattr(Workbench, "gains", lambda bench, before, after: (40.0, 3.0))
    found = searched(QUICK, record)
    assert not found.holds
    (term,) = found.rejected
    assert (term.evidence_train, term.evidence_held) == (40.0, 3.0)
    assert f"({term.objection})" in found.summary()
    assert term.objection == acceptance.UNREPEATED
    assert found.paths == QUICK.family.coefficients


def test_the_seed_resamples_windows():
    record = turned_by(lambda psi, r, u, roll: 0.008 * np.sin(psi), 1)
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    state = bench.fit(QUICK, QUICK.family.coefficients)
    library = [p for p in library_of(QUICK) if p != f"{YAW}sin_heading"]
    often = [terms.selection_of(bench, state, library, np.random.default_rng(seed))[0].frequency for seed in (0, 0, 1)]
    np.testing.assert_array_equal(often[0], often[1])
    assert not np.array_equal(often[0], often[2])


@pytest.mark.parametrize("flies, held, objection", [(False, 50.0, acceptance.DIVERGES), (True, 9.0, "does not hold")])
def test_a_term_passes_the_gate_of_terms(monkeypatch, flies, held, objection):
    path, probe = f"{YAW}sin_2heading", 0.02
    bench = Table({frozenset(): (0.0, 0.0), frozenset({path}): (100.0, held)}, stable=flies)
    state, after = state_of(QUICK), state_of(replace_at(QUICK, path, probe), path)
    monkeypatch.setattr(discovery, "term_interval", lambda bench, found: (probe, (0.019, 0.021)))
    found = Found(path, after, 1.0, (), {})
    term = discovery._weighed(bench, state, found, 18, 20.0)  # type: ignore[arg-type]
    assert term.objection.startswith(objection)


@pytest.mark.slow
def test_a_force_with_depth_is_found_on_a_float():
    plant = load_vehicle("qiandao_float")
    truth = replace_at(plant, "effects.discovered.heave.depth", 0.01)
    record = run_mission(truth, np.random.default_rng(3), target_depths=(40.0, 10.0), duration=1000.0)
    (term,) = searched(plant, record).terms
    assert term.path == "effects.discovered.heave.depth"
    assert term.ci95[0] < 0.01 < term.ci95[1]
    assert term.words.startswith(f"a force down of {term.value:.4g} N per metre of depth, 95 % interval 0.0")
    assert term.words.endswith("N/m")


@pytest.mark.parametrize("factor", [0.6, 1.3])
def test_coefficients_as_given_get_no_term_that_does_what_their_refit_has_done(factor, monkeypatch):
    path, *_ = paths = QUICK.family.coefficients
    true = replace_at(QUICK, path, factor * value_at(QUICK, path))
    record = run_mission(true, np.random.default_rng(3), duration=500.0)
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    state = bench.fit(QUICK, paths)
    assert len(bench.with_given(state)) == 1
    monkeypatch.setattr(terms, "tried", lambda problem, near: pytest.fail("a term is fitted"))
    assert terms.search(bench, state, library_of(bench.plant), np.random.default_rng(0)) is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_force_with_depth_is_found_on_a_torpedo_among_two_hundred_terms(seed):
    plant = load_vehicle("npsauv")
    truth = replace_at(plant, "effects.discovered.heave.depth", 5.0)
    record = run_mission(truth, np.random.default_rng(seed), duration=200.0)
    (term,) = searched(plant, record, window=25.0, settle=5.0).terms
    assert term.path == "effects.discovered.heave.depth"
    assert term.ci95[0] < 5.0 < term.ci95[1]


def test_words_say_the_force_its_regressor_and_its_interval():
    title = "discovered heave force from depth"
    term = Term("effects.discovered.heave.depth", title, "N/m", -0.12, (-0.14, -0.10), 0.98, 40.0, 38.0)
    assert term.words == "a heave force of -0.12 N per metre of depth, 95 % interval -0.14 to -0.1 N/m"
    other = replace(term, title="discovered yaw moment from u v", unit="kg", value=12.03, ci95=(11.99, 12.07))
    assert other.words == "a yaw moment of 12.03 kg, times u v, 95 % interval 11.99 to 12.07 kg"


def test_without_a_library_there_is_nothing_to_search():
    plant = QUICK
    assert len(library_of(plant)) == 18
    with pytest.raises(ValueError, match="needs some to choose from"):
        discover(None, State(plant, (), None), (), np.random.default_rng(0), 20.0)  # type: ignore[arg-type]
