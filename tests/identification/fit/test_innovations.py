"""The innovations form: its filters, its intervals under disturbances, and when it is chosen."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.excitation import prbs
from identification.fit.disturbed import Path, filtered
from identification.fit.innovations import InnovationsForm

SIGMA = 0.01  # rad


def pushed(plant, seed, intensity, samples=220):
    """A glider's log under a PRBS at its rudder, its turn pushed at random by `intensity`, rad/s per root of s."""
    rng = np.random.default_rng(seed)
    rudder = prbs(samples, 4, 0.3, rng)
    inputs = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
    x, heading = plant.initial(np.zeros(len(plant.outputs))), []
    for value in rudder:
        heading.append(plant.output(x)[0])
        inputs[0] = value
        x = plant.step(x, inputs)
        x[1] += intensity * np.sqrt(plant.dt) * rng.standard_normal()
    measured = np.array(heading) + SIGMA * rng.standard_normal(samples)
    return Record.from_arrays(plant.dt * np.arange(samples), {"heading_rad": measured, "rudder_rad": rudder})


def covered(fit, plant):
    return [e.ci95[0] < value_at(plant, e.path) < e.ci95[1] for e in fit.estimates]


def test_a_filter_gives_the_likelihood_of_the_whole_record():
    # a random walk seen through noise: the likelihood is that of one normal vector
    rng = np.random.default_rng(0)
    rows, q, r, start = 12, 0.3, 0.2, 3.0
    reference = np.linspace(-1.0, 1.0, rows)[:, None]
    start = (3.0 * float(np.std(reference))) ** 2
    ones = np.ones((rows, 1, 1))
    after, first = np.r_[reference[1:], reference[-1:]], np.arange(rows) == 0
    error = rng.standard_normal((rows, 1))
    none = np.zeros((rows, 1, 0))
    path = Path(reference, after, ones, none, error, ones, none, np.ones((rows, 1), bool), first, np.ones(rows))
    found = filtered(path, np.array([[r], [2 * r]]), np.array([[q], [q]]))
    for number, noise in enumerate((r, 2 * r)):
        steps = np.arange(rows)
        covariance = max(start, 0.0) + q * np.minimum.outer(steps, steps) + noise * np.eye(rows)
        e = error[:, 0]
        whole = -0.5 * (e @ np.linalg.solve(covariance, e) + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
        assert found.profile[number] == pytest.approx(whole, rel=1e-6)


def test_without_disturbances_both_forms_agree_and_free_runs_are_chosen():
    plant = load_vehicle("slocum")
    choice = InnovationsForm(plant, pushed(plant, 0, 0.0)).choose(plant.family.coefficients)
    assert choice.form == "output error"
    for free, filtered_ in zip(choice.output_error.estimates, choice.innovations.estimates, strict=True):
        assert filtered_.value == pytest.approx(free.value, abs=0.2 * free.error)
        assert filtered_.error == pytest.approx(free.error, rel=0.1)
    assert all(covered(choice.fit, plant))


def test_with_disturbances_the_innovations_are_white_and_the_noises_found():
    plant = load_vehicle("slocum")
    choice = InnovationsForm(plant, pushed(plant, 3, 2e-3)).choose(plant.family.coefficients)
    assert choice.form == "innovations"
    assert "coloured" in choice.words
    assert choice.fit.process["r_radps"] == pytest.approx(2e-3, rel=0.3)  # 220 samples tell it to a tenth
    assert choice.fit.measurement["heading_rad"] == pytest.approx(SIGMA, rel=0.4)
    assert choice.fit.whiteness["heading_rad"].p_value > 0.01 > choice.output_error.whiteness["heading_rad"].p_value
    assert all(covered(choice.fit, plant))


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["slocum"])
def test_intervals_under_disturbances_are_honest(vehicle):
    plant = load_vehicle(vehicle)
    free, disturbed = [], []
    for seed in range(20):
        form = InnovationsForm(plant, pushed(plant, 100 + seed, 2e-3))
        free += covered(form.fit(plant.family.coefficients, "output error"), plant)
        disturbed += covered(form.fit(plant.family.coefficients), plant)
    assert np.mean(disturbed) >= 0.85
    assert np.mean(free) < 0.75


def test_a_disturbed_record_of_a_moved_coefficient_gives_it_back():
    plant = load_vehicle("slocum")
    truth = replace_at(plant, "hull.n_delta", 1.3 * plant.hull.n_delta)
    fit = InnovationsForm(plant, pushed(truth, 1, 1e-3)).fit(("hull.n_delta", "hull.n_r"))
    assert all(covered(fit, truth))


def test_what_no_fit_can_free_is_refused():
    plant = load_vehicle("slocum")
    with pytest.raises(ValueError, match=r"No fit can free hull\.mass"):
        InnovationsForm(plant, pushed(plant, 0, 0.0, samples=40)).fit(("hull.mass",))
