"""Gains from the tuner: same seed, same gains; cheaper than those it starts from; for a vehicle of one's own too."""

from dataclasses import replace

import pytest

from auv_gym.plant import load_vehicle, save_vehicle
from controllers.autopilots import autopilot
from controllers.gains import gains_for, read_gains
from scripts.tune_controllers import TABLE_4, bench_of, cost, first_gains, main, tuned


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


def test_a_vehicle_of_ones_own_is_tuned_and_flown(tmp_path):
    mine, gains = tmp_path / "mine.toml", tmp_path / "gains.toml"
    save_vehicle(replace(load_vehicle("qiandao_float"), name="mine"), mine)
    assert main(["--vehicle", str(mine), "--dt", "1.4", "--evaluations", "5", "--out", str(gains)]) == 0
    controller = autopilot(load_vehicle(mine, dt=1.4), gains=gains)
    reading = {"depth_m": 10.0, "depth_rate_mps": 0.0, "dt_s": 1.4}
    command, _ = controller.act(controller.start(), reading, {"depth_m": 20.0})
    assert command["piston_m"] < 0.55  # less volume, deeper


@pytest.mark.parametrize("vehicle, name", [("ganeshblue_corrected", "heading_rad"), ("mermaid", "depth_m")])
def test_tuning_lowers_the_cost_on_other_noise_too(vehicle, name):
    bench = bench_of(load_vehicle(vehicle), 0)
    other = bench._replace(seed=99)
    start = first_gains(bench.plants[0])
    found = tuned(bench, 25, lambda share, text: None)
    assert cost(bench, found, "pid", name) < cost(bench, start, "pid", name)
    assert cost(other, found, "pid", name) < cost(other, start, "pid", name)


def test_the_published_gains_of_the_s_plane_are_never_changed():
    start = first_gains(load_vehicle("remus100"), s_plane=True)
    for name, law in start.loops["s_plane"].items():
        assert (law["k1"], law["k2"], law["k3"]) == TABLE_4[name]
    assert gains_for("heu_torpedo", 0.1).loops["s_plane"].keys() == TABLE_4.keys()
    assert list(first_gains(load_vehicle("remus100")).loops) == ["pid"]


def test_an_unknown_vehicle_is_refused(tmp_path, capsys):
    assert main(["--vehicle", "titanic", "--out", str(tmp_path / "gains.toml")]) == 1
    assert "No vehicle 'titanic'" in capsys.readouterr().err
    assert not (tmp_path / "gains.toml").exists()
