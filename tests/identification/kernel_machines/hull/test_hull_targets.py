"""Forces on a hull from runs of a vehicle whose hull is known: without noise, with it, and what is refused."""

from dataclasses import replace
from itertools import pairwise
from math import radians

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at
from auv_gym.physics.rigid_body import coriolis_forces
from auv_gym.plant import Plant, load_vehicle, without_effects
from auv_gym.records.record import Record, concat
from auv_gym.vehicles.body.derived import N_TERMS
from auv_gym.vehicles.body.dynamics import fill_terms, polynomial
from auv_gym.vehicles.body.learned_hull import LearnedHull
from identification.experiments.excitation import bang_bang
from identification.kernel_machines.hull.hull_targets import READINGS, VELOCITIES, HullTargets, hull_targets

NOISE = dict(zip(READINGS, [0.01] * 3 + [radians(0.1)] * 3 + [radians(0.2)] * 2))


def driven(plant: Plant, seed: int = 0, duration: float = 30.0, volts: tuple[float, ...] = (4.0,)) -> Record:
    """A run from rest with both pairs of fins thrown from side to side, and the voltage stepped."""
    rng, n = np.random.default_rng(seed), round(duration / 0.1) + 1
    fins = {
        name: bang_bang(n, 0.1, rng, amplitude=radians(8.0), hold_s=(2.0, 6.0))
        for name in ("rudder_rad", "stern_plane_rad")
    }
    values = {name: np.zeros(n) for name in plant.outputs} | fins
    values["propeller_V"] = np.repeat(volts, -(-n // len(volts)))[:n]
    return simulate(plant, Record.from_arrays(0.1 * np.arange(n), values))


def noisy(record: Record, seed: int) -> Record:
    rng = np.random.default_rng(seed)
    return record.with_channels(
        {name: record[name] + s * rng.standard_normal(len(record)) for name, s in NOISE.items()}
    )


def hull_forces(plant: Plant, velocities: np.ndarray) -> np.ndarray:
    """C(v)v + D(v)v of a plant's hull without cross-flow drag, from its coefficients; effects are no part of it."""
    computed = plant.family.view(without_effects(plant).derived).computed
    terms = np.zeros(N_TERMS + 5)
    ends, forces = [int(end) for end in computed.ends], np.empty((len(velocities), 6))
    for row, velocity in enumerate(velocities):
        u, v, w, p, q, r = velocity
        fill_terms(u, v, w, p, q, r, terms)
        hull = np.array([polynomial(computed, a, b, terms) for a, b in pairwise(ends)])
        forces[row] = -hull - np.array(coriolis_forces(computed.momentum, u, v, w, p, q, r))
    return forces


def errors(plant: Plant, found: HullTargets, clean: Record) -> np.ndarray:
    """Root mean square error of the forces over that of the forces, by axis."""
    rows = np.array([clean.segments[s].start for s in found.segment]) + np.round(found.time / 0.1).astype(int)
    true = hull_forces(plant, clean.matrix(VELOCITIES)[rows])
    return np.sqrt(np.mean((found.forces - true) ** 2, axis=0) / np.mean(true**2, axis=0))


@pytest.fixture(scope="module")
def vehicle() -> Plant:
    return load_vehicle("heu_torpedo")


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"effects.rudder.dead_time": 0.25, "effects.stern_plane.lag": 0.4, "effects.rudder.backlash": 0.02},
        {"effects.stern_plane.offset": 0.03, "effects.load.force_y": 1.0, "effects.load.payload": 0.5},
    ],
)
def test_without_noise_the_forces_are_those_of_the_hull(vehicle, effects):
    plant = replace_at(vehicle, effects)
    record = driven(plant, volts=(4.0, 3.5, 4.5))
    found = hull_targets(plant, [record])
    assert found.velocities == pytest.approx(record.matrix(VELOCITIES)[found.ends : -found.ends], abs=1e-9)
    # commands of a backlash switch inside the Gauss rule's steps, which costs two digits
    assert np.all(errors(plant, found, record) < (1e-3 if effects else 1e-4))


def test_the_plants_own_hull_does_not_matter(vehicle):
    record = driven(vehicle)
    expected = hull_targets(vehicle, [record]).forces
    for other in (
        replace_at(vehicle, {"hull.sway.uv": -10.0, "hull.yaw.ur": 0.0, "hull.surge.u_u": -20.0}),
        replace(vehicle, learned=LearnedHull.silent()),
    ):
        assert np.array_equal(hull_targets(other, [record]).forces, expected)


def test_with_the_noise_of_a_good_log(vehicle):
    clean = driven(vehicle, duration=60.0)
    found = hull_targets(vehicle, [noisy(clean, 1)])
    # over 20 seeds: at most 2.7, 10.6, 10.7, 10.5, 3.4 and 3.0 %
    assert np.all(errors(vehicle, found, clean) < [0.04, 0.12, 0.13, 0.15, 0.04, 0.04])
    assert found.noise == pytest.approx(list(NOISE.values()), rel=0.15)
    rows = clean.matrix(VELOCITIES)[found.ends : -found.ends]
    spread = np.sqrt(np.mean((found.velocities - rows) ** 2, axis=0))
    assert np.all(spread < [0.005, 0.003, 0.003, 0.0015, 0.001, 0.001])  # of 0.01 m/s and 0.0017 rad/s


def test_segments_are_treated_apart(vehicle):
    parts = [driven(vehicle, seed=1), driven(vehicle, seed=2, duration=20.0, volts=(3.5,))]
    whole = hull_targets(vehicle, [concat(parts)])
    alone = [hull_targets(vehicle, [part]) for part in parts]
    assert np.array_equal(np.unique(whole.segment), [0, 1])
    expected = np.concatenate([one.forces for one in alone])
    assert whole.forces == pytest.approx(expected, abs=1e-3)  # one smoothness for both
    assert np.array_equal(whole.time, np.concatenate([one.time for one in alone]))
    assert np.array_equal(hull_targets(vehicle, parts).forces, whole.forces)


def refused(plant: Plant, *records: Record) -> str:
    with pytest.raises(ValueError) as error:
        hull_targets(plant, records)
    return str(error.value)


def test_what_cannot_be_is_refused_in_words(vehicle):
    record = driven(vehicle)
    assert "got 'slocum' of family 'glider'" in refused(load_vehicle("slocum"), record)
    assert "waves or shear" in refused(replace_at(vehicle, {"effects.waves.amplitude_cos": 0.5}), record)
    assert "has no channel 'w_mps'" in refused(vehicle, record.without("w_mps"))
    assert "has no channel 'propeller_V'" in refused(vehicle, record.without("propeller_V"))
    time = record.time
    time[50:] += 0.05
    uneven = Record.from_arrays(time, {name: record[name] for name in record.names})
    assert "needs even samples" in refused(vehicle, uneven)
    assert "at least 20 samples, got one of 15" in refused(vehicle, record, record.between(0.0, 1.45))
    assert "at least one record" in refused(vehicle)
    assert "need pitch within 86 deg" in refused(
        vehicle, record.with_channels({"pitch_rad": record["pitch_rad"] + radians(85.0)})
    )
    without = record.with_channels({"propeller_rpm": np.full(len(record), 1300.0)})
    bow = without.with_channels({"bow_plane_rad": np.zeros(len(record))})
    assert "all or none" in refused(load_vehicle("npsauv"), without, bow)
    assert "too noisy for segments as short as 25 samples" in refused(vehicle, noisy(record, 0).between(0.0, 2.45))


def test_effects_that_depend_on_the_heading_need_it(vehicle):
    towed = replace_at(vehicle, {"effects.load.tether_north": 2.0, "effects.load.tether_station": -0.7})
    record = driven(towed)
    assert np.all(errors(towed, hull_targets(towed, [record]), record) < 1e-3)
    assert "has no channel 'heading_rad'" in refused(towed, record.without("heading_rad"))
    assert len(hull_targets(vehicle, [driven(vehicle).without(["heading_rad", "depth_m"])])) > 200
