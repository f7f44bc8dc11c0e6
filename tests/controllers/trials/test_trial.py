"""A closed-loop trial is what a log of the same commands gives."""

import numpy as np

from auv_gym.model import simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from controllers.autopilots import autopilot
from controllers.trials.trial import at_rest, run_trial


def test_a_supply_sags_over_a_trial_as_in_a_simulated_log():
    sagging = {"effects.supply.sag": 0.1, **{f"parts.t{k}.power": 1.2 for k in range(1, 9)}}
    plant = replace_at(load_vehicle("bluerov2_heavy"), sagging)
    targets = {"north_m": [(0.0, 20.0)], "depth_m": [(0.0, 10.0)], "heading_rad": [(0.0, 0.0)]}
    start = at_rest(plant, {"depth_m": 10.0})
    run = run_trial(plant, autopilot(plant, targets=tuple(targets)), targets, 20.0, start=start)
    np.testing.assert_array_equal(run["elapsed_s"], run["time_s"])
    names = (*plant.family.actuators, *plant.outputs)
    simulated = simulate(plant, Record.from_arrays(run["time_s"], {name: run[name] for name in names}))
    # of the transient of a first command only, which a record counts as having stood before
    np.testing.assert_allclose(simulated["u_mps"][200:], run["u_mps"][200:], atol=1e-3)
