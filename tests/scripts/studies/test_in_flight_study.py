"""The study of an effect that begins in mid-episode: the vehicle that changes, the costs, and a policy exchanged."""

import numpy as np
import pytest

from auv_gym.model import Model
from auv_gym.rl import Policy
from controllers.piloting import pilot_for
from scripts.studies.rl import in_flight
from scripts.studies.rl.in_flight import HOUR, SWITCHED, Becomes, Flight, costs_of, flown
from scripts.studies.rl.scenarios import SCENARIOS, true_env

GLIDER = SCENARIOS["glider"]


def test_a_vehicle_becomes_another_one_at_its_time():
    vehicle = Becomes(GLIDER.believed, GLIDER.truth, 3 * GLIDER.dt)
    assert isinstance(vehicle, Model)
    assert len(vehicle.states) == len(GLIDER.believed.states) + 1
    x = vehicle.initial(GLIDER.believed.output(GLIDER.believed.initial(np.zeros(len(vehicle.outputs)))))
    u = np.array([vehicle.constants.get(name, 0.0) for name in vehicle.inputs])
    for k in range(6):
        plant = GLIDER.believed if k < 3 else GLIDER.truth
        following = vehicle.step(x, u)
        assert following[:-1] == pytest.approx(plant.step(x[:-1], u), abs=0.0)
        assert following[-1] == (k + 1) * GLIDER.dt
        x = following
    assert np.isfinite(vehicle.output(x)).all()


def test_costs_are_means_of_their_hours():
    time = np.arange(1, 10801) * 1.0  # the step that ends at one hour belongs to the first
    rewards = -np.where(time <= HOUR, 1.0, np.where(time <= 2.0 * HOUR, 2.0, 3.0))
    assert costs_of(Flight(time, rewards, ())) == [1.0, 2.0, 3.0]


@pytest.mark.slow
def test_a_monitor_exchanges_the_policy_for_one_of_the_vehicle_that_it_names(monkeypatch, tmp_path):
    taught, pilot = [], pilot_for(true_env(GLIDER), "pid")  # which moves the rudder, as a policy would
    monkeypatch.setattr(in_flight, "CLEAN", 3.0)
    monkeypatch.setattr(in_flight, "train", lambda training, folder: None)
    monkeypatch.setattr(Policy, "load", lambda folder: pilot)
    monkeypatch.setattr(in_flight, "taught", lambda scenario, found, *rest: taught.append(found) or pilot)
    flight = flown(GLIDER, SWITCHED, 0, 1, 0, tmp_path)
    assert len(flight.rewards) == 3 * HOUR / GLIDER.dt
    path, size = GLIDER.effect
    (found,) = taught
    assert found[path] == pytest.approx(size, rel=0.1)  # some 300 samples behind an alarm
    time, named = flight.named[-1]
    assert named is found
    assert HOUR < time < 1.5 * HOUR
