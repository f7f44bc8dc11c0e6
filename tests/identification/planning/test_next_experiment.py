"""Tests of the experiment that distinguishes two explanations: its rank, its length, and the campaign that runs it."""

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from controllers.pid import heading_pid
from identification.campaign.file.plan import plan
from identification.campaign.file.reading import read_campaign
from identification.campaign.running.staging import check_campaign_run
from identification.deciding import LEAST_WINDOWS
from identification.diagnosis import diagnose
from identification.experiments.heading_control import closed_loop
from identification.experiments.kinds import KINDS
from identification.fit.noises import Noise
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows
from identification.planning.next_experiment import (
    ENOUGH,
    Proposal,
    Rival,
    minutes_of,
    next_experiment,
    rivals_of,
    words,
    write_experiment,
)
from identification.planning.separation import separation

OFFSET, MOMENT = "effects.rudder.offset", "effects.yaw.moment"


def fitted(plant, record, *paths):
    """The rivals of a record: one for each of these effects, with the coefficients refitted."""
    problem = Shooting(plant, record, free_run_windows(plant, record, plant.window))
    rivals = []
    for path in paths:
        free = (*plant.family.coefficients, path)
        rivals.append(Rival(spec_at(plant, path).title, problem.plant_at(problem.solve(plant, free), free), free))
    return rivals


@pytest.fixture(scope="module")
def tie():
    """A glider at one speed whose rudder stays off its stop, so that a rudder offset and a yaw moment act alike."""
    plant = load_vehicle("ganeshblue")
    record = closed_loop(
        replace_at(plant, OFFSET, 0.06),
        controller=heading_pid(plant, settling=40.0),
        rng=np.random.default_rng(1),
        speed=float(plant.hull.speed),
        track_noise=None,
        rudder_excitation=0.1,
    )
    return plant, record, fitted(plant, record, OFFSET, MOMENT)


def design(plant, name):
    return next(d for d in KINDS.of(plant.family).designs(plant) if d.name == name)


def test_another_speed_tells_a_rudder_offset_from_a_yaw_moment(tie):
    plant, record, rivals = tie
    chosen = [design(plant, name) for name in ("rudder_prbs", "turns_three_speeds")]
    best = next_experiment(plant, rivals, record=record, designs=chosen, minutes=(2.0, 60.0))
    assert best[0].design.name == "turns_three_speeds"
    assert best[0].evidence > ENOUGH
    assert best[0].minutes <= 10.0
    assert best[-1].evidence < best[0].evidence
    assert f"{best[0].minutes:.0f} minutes" in words(best)


@pytest.mark.slow
def test_the_rivals_are_what_a_diagnosis_ties(tie):
    plant, record, _ = tie
    ((one, other),) = rivals_of(diagnose(record, plant))
    assert {one.paths[-1], other.paths[-1]} == {OFFSET, MOMENT}
    for rival in (one, other):
        assert abs(value_at(rival.plant, rival.paths[-1])) > spec_at(plant, rival.paths[-1]).probe


@pytest.mark.slow
def test_the_command_writes_the_campaign_and_says_how_long(tie, tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    _, record, _ = tie
    record.save(tmp_path / "log.nc")
    out = tmp_path / "out"
    command = ["diagnose", str(tmp_path / "log.nc"), "--vehicle", "ganeshblue", "--out", str(out), "--next-experiment"]
    assert main(command) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "To tell them apart, run" in said
    assert "minutes should suffice" in said
    assert len(plan(read_campaign(out / "next_experiment.toml"))) >= 2


def test_what_acts_alike_everywhere_cannot_be_told_apart():
    plant = load_vehicle("qiandao_float")
    effects = ("effects.volume.compressibility", "effects.water.gradient")
    same = replace_at(plant, effects[0], 2e-7)
    noise = Noise({"depth_m": 0.02}, {})
    one = Rival("one", same, effects[:1])
    other = Rival("other", replace_at(plant, effects[1], 3.31e-3), effects[1:])
    found = next_experiment(plant, [one, other], noise=noise, designs=[design(plant, "stairs")], minutes=(4.0, 60.0))
    assert found[0].minutes == np.inf
    assert found[0].evidence < 1.0
    assert words(found).startswith("None of the experiments")


def test_expected_evidence_is_what_noisy_logs_give_on_average():
    plant = load_vehicle("slocum")
    truth, other, paths = replace_at(plant, MOMENT, 0.0003), plant, plant.family.coefficients
    sigma, seeds = 0.01, range(12)
    records = [closed_loop(truth, rng=np.random.default_rng(5), duration=480.0, compass_noise=0.0, track_noise=None)]
    noise = Noise({"heading_rad": sigma}, {})
    expected = separation(records, truth, other, paths, noise)
    clean, gains = records[0], []
    for seed in seeds:
        error = sigma * np.random.default_rng(seed).standard_normal(len(clean))
        record = clean.with_channels({"heading_rad": clean["heading_rad"] + error})
        problem = PredictionErrors(plant, record, free_run_windows(plant, record, plant.window))
        near = [problem.point(p.vector, problem.logs_of(noise)) for p in (truth, other)]
        best = [problem.total(problem.solve(p, paths, n, noise=False)) for p, n in zip((truth, other), near)]
        gains.append(2.0 * (best[0] - best[1]))
    # a mean of 12 draws of a difference whose deviation is twice the root of its mean
    assert np.mean(gains) == pytest.approx(expected, abs=3.0 * 2.0 * np.sqrt(expected / len(gains)))
    assert expected > 5.0
    # accelerations that push the vehicle at random hide a part of it
    pushed = Noise({"heading_rad": sigma}, {"r_radps": (2e-4, 20.0)})
    assert separation(records, truth, other, paths, pushed) < 0.8 * expected


def test_the_written_campaign_is_checked_and_runs(tie, tmp_path, capsys):
    plant, record, rivals = tie
    found = next_experiment(plant, rivals, record=record, designs=[design(plant, "turns_fast")])
    file = write_experiment(found[0], plant, rivals, tmp_path)
    runs = plan(read_campaign(file))
    assert {run.cell["vehicle.file"] for run in runs} == {"next_experiment_1.toml", "next_experiment_2.toml"}
    assert main(["campaign", str(file), "--out", str(tmp_path / "runs"), "--jobs", "1", "--only", "runs"]) == 0
    assert "2 of 2 runs done" in capsys.readouterr().out


@pytest.mark.parametrize(
    "vehicle", ["slocum", "qiandao_float", "mermaid", pytest.param("remus100", marks=pytest.mark.slow), "seawing"]
)
def test_every_design_is_a_campaign(vehicle, tmp_path):
    plant = load_vehicle(vehicle)
    same = [Rival("a", plant, ()), Rival("b", plant, ())]

    for given in KINDS.of(plant.family).designs(plant):
        proposal = Proposal(given, 3.0, 0.0, 3.0, ("a", "b"))
        for run in plan(read_campaign(write_experiment(proposal, plant, same, tmp_path))):
            if given.name not in ("dives", "dives_slow", "turns_slow", "speeds", "circle", "straight"):  # for time
                check_campaign_run(run.settings, tmp_path)
            assert run.settings.experiment.kind in ("env", "mission")


def test_bad_requests_are_said_plainly(tie):
    plant, record, rivals = tie
    with pytest.raises(ValueError, match="at least two explanations"):
        next_experiment(plant, rivals[:1], record=record)
    with pytest.raises(ValueError, match="needs the sensors' noise"):
        next_experiment(plant, rivals)
    with pytest.raises(ValueError, match="0 < least < most"):
        next_experiment(plant, rivals, record=record, minutes=(5.0, 2.0))


@pytest.mark.parametrize("vehicle", ["slocum", "mermaid", "seaglider", "vt690", "bluerov2"])
def test_the_shortest_experiment_has_enough_windows_for_a_diagnosis(vehicle):
    plant = load_vehicle(vehicle)
    time = np.arange(0.0, 60.0 * minutes_of(plant)[0], plant.dt)
    log = Record.from_arrays(time, dict.fromkeys((*plant.inputs, "depth_m"), np.zeros(time.size)))
    assert len(free_run_windows(plant, log, 0.5 * plant.window)) >= LEAST_WINDOWS
