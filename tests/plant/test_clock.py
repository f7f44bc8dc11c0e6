"""A log's clock that runs fast, and readings that are stamped late: against a vehicle with the times put right."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record

RATE, DELAY = 0.03, 0.37
SLOW_FIN = {"effects.rudder.dead_time": 0.33, "effects.rudder.lag": 0.4, "effects.rudder.slowness": 1.5}


def commands(plant: Plant, dt: float, rows: int = 80) -> Record:
    """Commands that each step about their middle, at times of their own."""
    rng, columns = np.random.default_rng(3), {}
    for name in plant.family.required:
        size, middle = {"rad": (0.1, 0.0), "rpm": (60.0, 500.0), "mps": (0.02, 0.3)}[name.rpartition("_")[2]]
        columns[name] = middle + size * np.repeat(rng.uniform(-1.0, 1.0, rows // 8), 8)
    return Record.from_arrays(dt * np.arange(rows), columns)


def run(plant: Plant, record: Record) -> np.ndarray:
    start = np.zeros((1, len(plant.family.states)))
    start[0, plant.family.states.index("u_mps") if "u_mps" in plant.family.states else 0] = 0.5
    return plant.run(record, record.segments, start)


@pytest.mark.parametrize("name", ["slocum", "npsauv"])
def test_a_fast_clock_stretches_the_times_of_a_log(name):
    plant = replace_at(load_vehicle(name), SLOW_FIN)
    told = commands(plant, plant.dt)
    true = Record.from_arrays(told.time / (1.0 + RATE), {n: told[n] for n in plant.family.required})
    np.testing.assert_allclose(
        run(replace_at(plant, "effects.clock.rate", RATE), told), run(plant, true), rtol=1e-7, atol=1e-9
    )


def test_late_readings_are_a_dead_time_of_every_command():
    plant = load_vehicle("npsauv")
    told = commands(plant, plant.dt)
    dead = {f"effects.{part}.dead_time": DELAY for part in ("rudder", "stern_plane", "bow_plane", "propeller")}
    late, each = run(replace_at(plant, "effects.clock.delay", DELAY), told), run(replace_at(plant, dead), told)
    np.testing.assert_array_equal(late, each)
    assert np.abs(late - run(plant, told)).max() > 1e-3


def test_both_clocks_act_on_steps_as_on_runs():
    plant = replace_at(load_vehicle("slocum"), {**SLOW_FIN, "effects.clock.rate": RATE, "effects.clock.delay": 5.0})
    told = commands(plant, plant.dt)
    at_rest = Record.from_arrays(told.time, {"rudder_rad": np.where(told.time < 32.0, 0.0, told["rudder_rad"])})
    inputs = np.array(
        [[at_rest[n][k] if at_rest.has(n) else plant.constants[n] for n in plant.inputs] for k in range(80)]
    )
    state, stepped = plant.initial(np.full(len(plant.outputs), np.nan)), []
    whole = plant.run(at_rest, at_rest.segments, state[None, : len(plant.family.states)])
    for row in inputs:
        stepped.append(plant.output(state))
        state = plant.step(state, row)
    np.testing.assert_allclose(np.array(stepped), whole, rtol=1e-12, atol=1e-12)


def test_the_full_state_reaches_back_over_dead_time_and_delay():
    plant = load_vehicle("slocum")  # samples of 4 s
    assert replace_at(plant, "effects.clock.delay", 9.0).history == 4
    assert replace_at(plant, {"effects.clock.delay": 9.0, "effects.rudder.dead_time": 4.0}).history == 5
    longer = {"effects.rudder.dead_time": 8.0, "effects.clock.rate": 0.25}
    assert replace_at(plant, longer).history == 4
