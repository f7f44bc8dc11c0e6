"""Tests of causality: shifts between columns are detected and measured, and strong feedback is not mistaken for one."""

import numpy as np
import pytest
from scipy.signal import lfilter

from auv_gym.channels import channel
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record, concat
from identification.experiments.excitation import prbs
from identification.experiments.missions import run_mission
from identification.linear.causality import check_causality, leads

INPUT, OUTPUT, ADDED = "rudder_rad", "heading_rad", "excitation_rudder_rad"
PD, STRONG = (0.3, 0.5), (2.0, 3.0)


def turned(seed, n=1500, *, gains=(0.0, 0.0), clock=12, amplitude=0.1, noise=0.01, resolution=0.0, stop=np.inf, dt=0.1):
    """A heading that a rudder turns, under feedback of its noisy reading in the same sample, with a PRBS added."""
    rng = np.random.default_rng(seed)
    added = prbs(n, clock, amplitude, rng) if amplitude else np.zeros(n)
    drift = lfilter([1.0, 0.5], [1.0, -0.9], 0.002 * rng.standard_normal(n))
    error = noise * rng.standard_normal(n)
    rate = heading = before = 0.0
    rows = np.empty((n, 2))
    for k in range(n):
        read = heading + error[k]
        read = resolution * round(read / resolution) if resolution else read
        command = added[k] - gains[0] * read - gains[1] * (read - before)
        rows[k] = min(max(command, -stop), stop), read
        rate, before = 0.8 * rate + 0.1 * rows[k, 0] + drift[k], read
        heading += rate
    return Record.from_arrays(dt * np.arange(n), {INPUT: rows[:, 0], OUTPUT: rows[:, 1], ADDED: added})


def late(record, samples, *names):
    """The record with some columns logged so many samples late."""
    if not samples:
        return record
    return record.with_channels({n: np.r_[np.full(samples, record[n][0]), record[n][:-samples]] for n in names})


def check(record):
    return check_causality([record], [INPUT], [OUTPUT])


@pytest.mark.parametrize("settings", [{}, {"clock": 5}, {"clock": 1}, {"gains": PD}, {"gains": PD, "clock": 5}])
@pytest.mark.parametrize("known", [True, False], ids=["excitation", "no excitation"])
def test_nothing_is_found_where_nothing_is_shifted(settings, known):
    for seed in range(3):
        record = turned(seed, **settings)
        assert check(record if known else record.without([ADDED])) == ()


@pytest.mark.parametrize(
    "settings",
    [
        {"gains": STRONG, "noise": 0.02, "stop": 0.2},  # noise takes it from stop to stop
        {"gains": (0.3, 0.8), "noise": 0.0, "resolution": 0.0175},  # steps of the reading make it jump
        {"gains": (0.3, 0.8), "noise": 0.0, "resolution": 0.0175, "amplitude": 0.0},
        {"gains": PD, "amplitude": 0.0},
        {"gains": (0.5, 1.5), "noise": 0.03},
    ],
)
def test_feedback_of_noise_is_not_taken_for_a_shift(settings):
    for seed in range(4):
        record = turned(seed, **settings)
        assert check(record.without([ADDED])) == ()
        assert check(record) == ()


@pytest.mark.parametrize("gains", [(0.0, 0.0), PD], ids=["open loop", "closed loop"])
@pytest.mark.parametrize("shift", [1, 3, 10])
def test_a_shift_of_the_input_is_seen_and_measured(gains, shift):
    record = turned(1, 4000, gains=gains, noise=0.003)
    found = leads([late(record, shift, INPUT)], [INPUT], [OUTPUT])
    assert [(lead.input, lead.output) for lead in found] == [(INPUT, OUTPUT)]
    about = pytest.approx(shift - 1, abs=0.7 * shift)  # noise hides when an answer begins
    assert found[0].samples == about
    assert found[0].chance < 1e-6
    both = leads([late(record, shift, INPUT, ADDED)], [INPUT], [OUTPUT])
    assert both[0].samples == about
    unknown = leads([late(record, shift, INPUT).without([ADDED])], [INPUT], [OUTPUT])
    # where noise acts on the input at once, a lead of less than two samples cannot be told from it
    assert bool(unknown) == (gains == (0.0, 0.0) or shift > 1)


def test_the_words_say_how_far_and_what_to_do():
    record = turned(1, 4000, noise=0.003)
    (same,) = check(late(record, 1, INPUT))
    assert same.startswith(
        "heading_rad moves in the same sample as rudder_rad, and can at the earliest one sample later"
    )
    (ahead,) = check(late(record, 3, INPUT))
    assert ahead == (
        "heading_rad moves 2 samples (0.2 s) before rudder_rad: check the clock or the alignment of the columns."
    )


def test_exchanged_columns_are_seen_where_the_excitation_is_known():
    record = turned(1, 4000, gains=PD, noise=0.003)
    exchanged = record.with_channels({INPUT: record[OUTPUT], OUTPUT: record[INPUT]})
    assert leads([exchanged], [INPUT], [OUTPUT])[0].samples > 0
    assert check(exchanged.without([ADDED])) == ()


def test_only_the_shifted_input_is_named():
    one, other = turned(1, 3000, noise=0.003), turned(2, 3000, noise=0.003)
    moved = {"stern_plane_rad": INPUT, "pitch_rad": OUTPUT, "excitation_stern_plane_rad": ADDED}
    both = one.with_channels({name: other[of] for name, of in moved.items()})
    found = leads([late(both, 3, "stern_plane_rad")], [INPUT, "stern_plane_rad"], [OUTPUT, "pitch_rad"])
    assert [(lead.input, lead.output) for lead in found] == [("stern_plane_rad", "pitch_rad")]


def test_an_excitation_that_never_came_to_the_input_is_passed_over():
    record = turned(1, 3000, noise=0.003)
    strange = record.with_channels({ADDED: np.random.default_rng(0).standard_normal(3000)})
    assert check(strange) == ()
    assert check(late(strange, 3, INPUT)) == check(late(record, 3, INPUT))
    assert check(record.with_channels({ADDED: np.zeros(3000)})) == ()


def test_segments_are_taken_apart_and_short_records_tell_nothing():
    parts = [turned(seed, 800, noise=0.003) for seed in range(4)]
    assert leads(parts, [INPUT], [OUTPUT]) == ()
    for shifted in ([late(part, 3, INPUT) for part in parts], [concat([late(part, 3, INPUT) for part in parts])]):
        assert leads(shifted, [INPUT], [OUTPUT])[0].samples in (1, 2, 3)
    for samples in (2, 10, 30):
        assert check(late(turned(1), 1, INPUT).between(0.0, 0.1 * samples)) == ()
    still = turned(1).with_channels({INPUT: np.zeros(1500), OUTPUT: np.ones(1500)})
    assert check(still) == ()
    with pytest.raises(ValueError, match="check_causality needs even samples"):
        check(Record.from_arrays(np.cumsum(np.linspace(1, 2, 1500)), {n: still[n] for n in still.names}))


def test_without_noise_nothing_is_made_of_rounding():
    for seed in range(3):
        assert check(turned(seed, noise=0.0)) == ()
        n, rng = 1500, np.random.default_rng(seed)
        given = prbs(n, 7, 0.1, rng)
        answer = lfilter([0.0, 0.1, 0.05], [1.0, -1.5, 0.56], given)
        exact = Record.from_arrays(0.1 * np.arange(n), {INPUT: given, "r_radps": answer})
        assert check_causality([exact], [INPUT], ["r_radps"]) == ()
        assert check_causality([late(exact, 3, INPUT)], [INPUT], ["r_radps"])


@pytest.mark.parametrize("vehicle", ["slocum", "ganeshblue", "ganeshblue_corrected", "qiandao_float"])
def test_missions_of_vehicles_are_causal(vehicle):
    for seed in range(3):
        record = run_mission(load_vehicle(vehicle), np.random.default_rng(seed))
        record = record if record.is_uniform() else record.resample(1.0)
        given, found = ("piston_m", "depth_m") if record.has("piston_m") else (INPUT, OUTPUT)
        assert check_causality([record], [given], [found]) == ()


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["remus100", "vt690", "heu_torpedo", "npsauv"])
def test_manoeuvres_of_torpedoes_are_causal_and_late_planes_are_seen(vehicle):
    outputs, seen = ["heading_rad", "pitch_rad", "depth_m", "q_radps", "r_radps"], 0
    inputs = [INPUT, "stern_plane_rad"]
    for seed in range(8):
        record = run_mission(load_vehicle(vehicle), np.random.default_rng(seed))
        plain = record.without([n for n in record.names if channel(n).kind == "command" or n.startswith("excitation_")])
        assert check_causality([record], inputs, outputs) == ()
        assert check_causality([plain], inputs, outputs) == ()
        found = leads([late(record, 10, "stern_plane_rad")], inputs, outputs)
        seen += any(lead.input == "stern_plane_rad" for lead in found)
        assert all(lead.input == "stern_plane_rad" for lead in found)
    assert seen >= 7
