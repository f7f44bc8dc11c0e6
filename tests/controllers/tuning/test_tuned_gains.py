"""Gains from the tuner: same seed, same gains; cheaper than those it starts from; for a vehicle of one's own too."""

from dataclasses import replace

import pytest

from auv_gym.plant import load_vehicle
from controllers.gains import Gains, gains_for, read_gains, with_gains
from controllers.tuning.bench import bench_of
from controllers.tuning.kinds.body import TABLE_4
from controllers.tuning.requirements import parse_requirements
from controllers.tuning.spread import known_intervals
from controllers.tuning.tuning import cost, first_gains, judged, tuned
from scripts.tune_controllers import main


def quiet(share, text):
    pass


def test_same_seed_same_file_and_others_entries_stay(tmp_path, capsys):
    one, two, three = (tmp_path / f"{name}.toml" for name in ("one", "two", "three"))
    for path, seed in ((one, "0"), (two, "0"), (three, "1")):
        given = ["--vehicle", "ganeshblue", "--evaluations", "8", "--seed", seed, "--out", str(path)]
        assert main(given) == 0
    assert one.read_bytes() == two.read_bytes() != three.read_bytes()
    assert "heading_deg" in capsys.readouterr().out
    assert main(["--vehicle", "slocum", "--evaluations", "6", "--out", str(one)]) == 0
    assert [e.vehicle for e in read_gains(one)] == ["ganeshblue", "slocum"]
    assert read_gains(one)[0] == read_gains(two)[0]


def test_laws_that_are_not_tuned_again_stay_in_the_file():
    pid, gpc = (
        Gains("mine", 0.1, loops={"pid": {"a": {"b": 1.0}}}),
        Gains("mine", 0.1, loops={"gpc": {"a": {"c": 2.0}}}),
    )
    both = with_gains(with_gains((Gains("other", 0.1),), pid), gpc)
    assert [entry.vehicle for entry in both] == ["other", "mine"]
    assert both[1].loops == {**pid.loops, **gpc.loops}


@pytest.mark.slow
@pytest.mark.parametrize("vehicle, name", [("ganeshblue_corrected", "heading_rad"), ("mermaid", "depth_m")])
def test_tuning_lowers_the_cost_on_other_noise_too(vehicle, name):
    bench = bench_of(load_vehicle(vehicle), 0)
    other = bench._replace(seed=99)
    start = first_gains(bench.plants[0])
    found = tuned(bench, 25, quiet)
    assert cost(bench, found, "pid", name) < cost(bench, start, "pid", name)
    assert cost(other, found, "pid", name) < cost(other, start, "pid", name)


@pytest.mark.slow
def test_what_is_required_changes_the_gains_and_judging_says_on_how_many_vehicles_it_is_met():
    plant = replace(load_vehicle("ganeshblue_corrected"), name="mine")
    bench = bench_of(plant, 0)
    asked = parse_requirements(["sensitivity_peak<=1.2", "heading_rad.overshoot_percent<=90"], ("heading_rad",))
    free, bound = tuned(bench, 14, quiet), tuned(bench, 14, quiet, requirements=asked)
    found = {}
    for label, gains in (("free", free), ("bound", bound)):
        found[label] = judged(plant, gains, "pid", asked, known_intervals(plant), 5, draws=4)
    peaks = {label: max(of.values("heading_rad", "sensitivity_peak")) for label, of in found.items()}
    assert peaks["bound"] < peaks["free"]
    assert not found["free"].passed
    channel, requirement, worst, met = found["free"].verdicts()[0]
    assert (channel, str(requirement), worst) == ("heading_rad", "sensitivity_peak<=1.2", peaks["free"])
    assert met < len(found["free"].loops["heading_rad"]) == 1 + 4 + 2


def test_the_published_gains_of_the_s_plane_are_never_changed():
    start = first_gains(load_vehicle("remus100"), ("pid", "s_plane"))
    for name, law in start.loops["s_plane"].items():
        assert (law["k1"], law["k2"], law["k3"]) == TABLE_4[name]
    assert gains_for("heu_torpedo", 0.1).loops["s_plane"].keys() == TABLE_4.keys()
    assert list(first_gains(load_vehicle("remus100")).loops) == ["pid"]


def test_an_unknown_vehicle_is_refused(tmp_path, capsys):
    assert main(["--vehicle", "titanic", "--out", str(tmp_path / "gains.toml")]) == 1
    assert "No vehicle 'titanic'" in capsys.readouterr().err
    assert not (tmp_path / "gains.toml").exists()
