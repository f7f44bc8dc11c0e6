"""simulate and predict on a model small enough to do by hand, and on plants."""

import math
import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.model import Diverged, Model, check_interval, inputs_of, outputs_of, predict, simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import linear_yaw_coefficients


@dataclass(frozen=True)
class Toy:
    """r[k+1] = a r[k] + b rudder[k], observed fully; heading is not modelled."""

    a: float = 0.5
    b: float = 2.0
    dt: float = 1.0
    inputs = ("rudder_rad",)
    states = ("r_radps",)
    outputs = ("r_radps",)

    def initial(self, y0):
        return np.nan_to_num(np.array(y0, dtype=float))

    def step(self, x, u):
        return self.a * x + self.b * u

    def output(self, x):
        return x.copy()

    def correct(self, x, y):
        return np.where(np.isfinite(y), y, x)


def record(rudder, r, dt=1.0, segment=None):
    values = {"rudder_rad": rudder} if r is None else {"rudder_rad": rudder, "r_radps": r}
    return Record.from_arrays(dt * np.arange(len(rudder)), values, segment=segment)


RUDDER = [1.0, 0.0, -1.0, 0.5, 0.0, 0.0]
MEASURED = [4.0, 1.0, 2.0, 3.0, 8.0, 0.0]


def test_a_toy_is_a_model():
    assert isinstance(Toy(), Model)
    assert isinstance(load_vehicle("slocum"), Model)


def test_simulate_runs_free_from_the_first_measurement():
    found = simulate(Toy(), record(RUDDER, MEASURED))
    assert found["r_radps"].tolist() == [4.0, 4.0, 2.0, -1.0, 0.5, 0.25]
    assert found["rudder_rad"].tolist() == RUDDER


def test_simulate_starts_each_segment_anew():
    found = simulate(Toy(), record(RUDDER, MEASURED, segment=[0, 0, 0, 1, 1, 1]))
    assert found["r_radps"].tolist() == [4.0, 4.0, 2.0, 3.0, 2.5, 1.25]
    assert len(found.segments) == 2


def test_one_step_ahead_starts_from_the_last_measurement():
    found = predict(Toy(), record(RUDDER, MEASURED))["r_radps"]
    assert found.tolist() == [4.0, *(0.5 * m + 2.0 * u for m, u in zip(MEASURED[:-1], RUDDER[:-1]))]


def test_two_steps_ahead_start_from_the_measurement_before():
    found = predict(Toy(), record(RUDDER, MEASURED), horizon=2)["r_radps"]
    ahead = [0.25 * MEASURED[k] + RUDDER[k] + 2.0 * RUDDER[k + 1] for k in range(4)]
    assert found.tolist() == [4.0, 4.0, *ahead]


def test_a_horizon_as_long_as_the_record_is_a_free_run():
    made = record(RUDDER, MEASURED, segment=[0, 0, 0, 1, 1, 1])
    assert np.array_equal(predict(Toy(), made, horizon=6)["r_radps"], simulate(Toy(), made)["r_radps"])


def test_a_channel_that_was_not_measured_is_not_corrected():
    made = record(RUDDER, None)
    assert np.isnan(outputs_of(Toy(), made)).all()
    assert np.array_equal(predict(Toy(), made)["r_radps"], simulate(Toy(), made)["r_radps"])
    assert simulate(Toy(), made)["r_radps"].tolist() == [0.0, 2.0, 1.0, -1.5, 0.25, 0.125]


@pytest.mark.parametrize("horizon", [0, -1])
def test_a_horizon_below_one_is_refused(horizon):
    with pytest.raises(ValueError, match=f"needs a horizon of at least 1 sample, got {horizon}"):
        predict(Toy(), record(RUDDER, MEASURED), horizon)


@pytest.mark.parametrize("use", [simulate, predict])
def test_a_discrete_model_refuses_another_interval(use):
    with pytest.raises(
        ValueError, match=re.escape("steps 1 s at a time, got samples 2 to 2 s apart: call record.resample(1)")
    ):
        use(Toy(), record(RUDDER, MEASURED, dt=2.0))


def test_a_thousandth_of_an_interval_is_let_pass():
    check_interval(Toy(), np.array([0.0, 1.0009, 2.0]))
    with pytest.raises(ValueError, match=r"got samples 0\.998 to 1\.002 s apart"):
        check_interval(Toy(), np.array([0.0, 1.002, 2.0]))


def test_a_diverging_model_says_when_and_where():
    made = record(np.full(900, 1.0), np.zeros(900))
    with pytest.raises(Diverged) as caught, np.errstate(over="ignore"):
        simulate(Toy(a=10.0), made)
    # 10^308 is the last power of ten that is finite; r[k] is 2 (10^k - 1) / 9
    assert (caught.value.time, caught.value.channel) == (309.0, "r_radps")
    assert caught.value.last["r_radps"] == pytest.approx(2.0 / 9.0 * 1e308, rel=1e-12)
    assert "r_radps is not finite at 309.000 s; last finite values: r_radps 2.222e+307" in str(caught.value)


def test_of_many_values_a_run_that_diverged_tells_the_largest():
    last = {"u_mps": 1.0, "v_mps": -2e35, "w_mps": 3e34, "p_radps": 0.1, "q_radps": 1e33, "r_radps": 0.2}
    said = str(Diverged(4.0, "r_radps", last))
    assert "r_radps is not finite at 4.000 s; largest of the last finite values: r_radps 0.2, v_mps -2e+35" in said
    assert "q_radps" in said
    assert not any(name in said for name in ("u_mps", "p_radps"))


def test_a_plant_that_runs_away_says_when_and_where():
    # sinking at 10 m/s adds some thousand times the yaw rate to it each second
    plant = replace_at(load_vehicle("slocum"), "hull.n_wr", 2.0)
    columns = {"rudder_rad": np.zeros(5), "r_radps": np.full(5, 0.05), "w_mps": np.full(5, 10.0)}
    made = Record.from_arrays(4.0 * np.arange(5), columns)
    for use in (simulate, predict):
        with pytest.raises(Diverged) as caught:
            use(replace(plant, longest_step=0.01), made)
        assert caught.value.time == 4.0
        assert caught.value.last["r_radps"] == pytest.approx(0.05)
        assert "Lower the step or check the model's coefficients" in str(caught.value)


def test_a_plant_is_simulated_at_the_records_own_times():
    plant = replace(load_vehicle("slocum"), longest_step=0.5)
    time = np.array([0.0, 1.0, 7.0, 7.5, 20.0])
    made = Record.from_arrays(time, {"rudder_rad": np.zeros(5), "heading_rad": np.ones(5), "r_radps": np.full(5, 0.1)})
    k = -linear_yaw_coefficients(plant.family.view(plant.vector).hull)[0]
    found = simulate(plant, made)
    # fourth order: (0.5 s / 12 s)^4 of 0.1 rad/s
    assert found["r_radps"] == pytest.approx(0.1 * np.exp(-k * time), abs=1e-7)
    assert found["heading_rad"] == pytest.approx(1.0 + 0.1 * (1.0 - np.exp(-k * time)) / k, abs=1e-6)


def test_prediction_of_a_plant_with_its_own_data_is_its_simulation():
    plant = replace_at(load_vehicle("slocum"), {"effects.rudder.lag": 2.0, "effects.compass.bias": 0.1})
    time = np.array([0.0, 3.0, 8.0, 11.0, 16.0, 20.0, 22.0])
    made = simulate(plant, Record.from_arrays(time, {"rudder_rad": 0.3 * np.sin(time)}))
    for horizon in (1, 3):
        again = predict(plant, made, horizon)
        for name in plant.outputs:
            assert again[name] == pytest.approx(made[name], abs=1e-12)


def test_inputs_that_may_lack_are_constants_and_others_are_asked_for():
    plant = load_vehicle("slocum")
    found = inputs_of(plant, Record.from_arrays([0.0, 4.0], {"rudder_rad": [0.1, 0.2], "roll_rad": [0.3, 0.4]}))
    assert found.flags.c_contiguous
    assert found.tolist() == [[0.1, 0, 0, plant.hull.speed, 0, 0, 0, 0.3], [0.2, 0, 0, plant.hull.speed, 0, 0, 0, 0.4]]
    with pytest.raises(ValueError, match="no channel 'rudder_rad'"):
        simulate(plant, Record.from_arrays([0.0, 4.0], {"heading_rad": [0.0, 0.0]}))


def test_the_record_keeps_what_the_model_does_not_say():
    made = Record.from_arrays([0.0, 4.0], {"rudder_rad": [0.1, 0.2], "depth_m": [3.0, 4.0]}, attrs={"source": "test"})
    found = simulate(load_vehicle("slocum"), made)
    assert found["depth_m"].tolist() == [3.0, 4.0]
    assert found.attrs["source"] == "test"
    assert math.isfinite(found["heading_rad"][-1])


@pytest.mark.parametrize("use", [simulate, predict])
@pytest.mark.parametrize(
    "given, words",
    [(3, "got 3: it has inputs"), ("model.npz", "load_model reads"), (SimpleNamespace(model=Toy()), "fit.model")],
)
def test_what_is_no_model_is_refused(use, given, words):
    with pytest.raises(ValueError, match=f"{use.__name__} needs a model, .*{words}"):
        use(given, record(RUDDER, MEASURED))
