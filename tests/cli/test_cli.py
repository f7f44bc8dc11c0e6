import subprocess
import sys

import numpy as np
import pytest

from auv_gym import __version__
from auv_gym.channels import CHANNELS
from auv_gym.cli import main
from auv_gym.effects import GliderEffects
from auv_gym.param import list_paths, replace_at
from auv_gym.plant import list_vehicles, load_vehicle
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from identification.experiments.float_dives import depth_control, summer_lake
from identification.experiments.heading_control import closed_loop
from identification.experiments.missions import mission_of

pytestmark = pytest.mark.usefixtures("wide")


def test_help_and_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"auv-gym {__version__}"
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(command in text for command in ("simulate", "diagnose", "list"))


LIGHT = {
    "--help": 0,
    "diagnose --help": 0,
    "list": 0,
    "diagnose nothing.csv --vehicle slocm --out OUT": 1,
    "diagnose nothing.csv --vehicle nothing.toml --out OUT": 1,
    "diagnose nothing.csv --vehicle slocum --out FILE/out": 1,
    "diagnose nothing.csv --vehicle slocum --out OUT": 1,
    "diagnose nothing.csv --vehicle slocum --out OUT --window 0": 2,
    "identify nothing.csv --method grey_box --vehicle slocm --out OUT/model.toml": 1,
    "identify nothing.csv --method arx --out OUT/model.npz": 1,
    "compare slocum --record nothing.csv": 1,
    "simulate slocm": 1,
    "simulate slocum --dt 0": 2,
}


def test_lists_and_early_errors_import_nothing_that_takes_long(tmp_path):
    """Each of these packages takes longer to import than such an answer should."""
    (tmp_path / "file").write_text("")
    code = f"""
import sys
from auv_gym.cli import main
for line, expected in {LIGHT!r}.items():
    assert main(line.replace("OUT", "out").replace("FILE", "file").split()) == expected, line
    found = {{"numba", "scipy", "xarray", "pandas", "h5py", "gymnasium", "matplotlib"}} & set(sys.modules)
    assert not found, (line, found)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_lists_name_everything(capsys):
    assert main(["list"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in list_vehicles())
    assert all(name in text for name in CHANNELS)
    assert all(f"effects.{p}" in text for p in list_paths(GliderEffects()) if not p.startswith("discovered."))
    assert "sin_2heading" in text
    assert main(["list", "vehicles"]) == 0
    assert "heading_rad" not in capsys.readouterr().out


def test_simulate_writes_the_experiment_as_netcdf(tmp_path, capsys):
    out = tmp_path / "run.nc"
    assert main(["simulate", "slocum", "--out", str(out), "--seed", "5", "--duration", "200"]) == 0
    expected = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(5), duration=200.0)
    written = Record.load(out)
    assert written.names == expected.names
    np.testing.assert_array_equal(written["heading_rad"], expected["heading_rad"])
    assert str(out) in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


def test_simulate_writes_csv_that_reads_back(tmp_path):
    arguments = ["simulate", "ganeshblue", "--dt", "2", "--duration", "100", "--track-noise-m", "-1"]
    for name in ("run.csv", "run.nc"):
        assert main([*arguments, "--out", str(tmp_path / name)]) == 0
    text, exact = read_record(tmp_path / "run.csv"), Record.load(tmp_path / "run.nc")
    assert not text.has("north_m")
    assert text.sample_interval == 2.0
    for name in exact.names:
        np.testing.assert_allclose(text[name], exact[name], rtol=1e-9, atol=1e-9)


def test_simulate_takes_effects(tmp_path):
    effects = ["--effect", "effects.rudder.offset=0.05", "--effect", "effects.yaw.moment=0.01"]
    assert main(["simulate", "slocum", "--out", str(tmp_path / "with.nc"), *effects]) == 0
    assert main(["simulate", "slocum", "--out", str(tmp_path / "without.nc")]) == 0
    one, two = Record.load(tmp_path / "with.nc"), Record.load(tmp_path / "without.nc")
    np.testing.assert_array_equal(one["u_mps"], two["u_mps"])
    assert (one["heading_rad"] != two["heading_rad"]).any()


def test_simulate_makes_dives_of_a_float_with_a_piston(tmp_path, capsys):
    arguments = ["simulate", "qiandao_float", "--target-depth", "15", "--target-depth", "5", "--duration", "600"]
    effect = ["--effect", "effects.volume.offset=5e-6"]
    assert main([*arguments, *effect, "--depth-noise-m", "0.01", "--out", str(tmp_path / "dive.nc")]) == 0
    assert "qiandao_float, 599" in capsys.readouterr().out
    plant = replace_at(load_vehicle("qiandao_float"), "effects.volume.offset", 5e-6)
    settings = {"hold": 300.0, "noise": 0.01, "temperature_profile": summer_lake}
    expected = depth_control(plant, [15.0, 5.0], rng=np.random.default_rng(0), **settings)
    written = Record.load(tmp_path / "dive.nc")
    assert written.names == expected.names
    np.testing.assert_array_equal(written["depth_m"], expected["depth_m"])


def test_simulated_missions_read_back_dive_by_dive(tmp_path, capsys):
    arguments = ["simulate", "mermaid", "--target-depth", "150", "--target-depth", "200", "--seed", "2"]
    for name in ("mission.csv", "mission.nc"):
        assert main([*arguments, "--out", str(tmp_path / name)]) == 0
    assert "in 2 dives" in capsys.readouterr().out
    text, exact = read_record(tmp_path / "mission.csv"), Record.load(tmp_path / "mission.nc")
    assert text.labels == exact.labels == ["dive 1", "dive 2"]
    for name in exact.names:
        np.testing.assert_allclose(text[name], exact[name], rtol=1e-9, atol=1e-12)


def test_the_help_of_simulate_says_which_options_are_for_gliders_in_steady_flight(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["simulate", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for flag, words in (
        ("--target-depth", "Float, or glider in steady flight (seaglider): target depth"),
        ("--depth-noise-m", "glider in steady flight (seaglider): 0.05"),
    ):
        assert words in text.partition(f"{flag} <float>")[2][:260]
    assert {"target_depths", "depth_noise"} <= {*mission_of(load_vehicle("seaglider")).settings}


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["simulate", "slocum", "--target-depth", "3"], "--target-depth does not apply to slocum"),
        (["simulate", "mermaid", "--duration", "600"], "--duration does not apply to mermaid"),
        (["simulate", "qiandao_float", "--compass-noise-deg", "1"], "family float_piston: leave it out"),
        (["simulate", "qiandao_float", "--duration", "1"], "longer than a sample of"),
        (
            ["simulate", "mermaid", "--target-depth", "9"],
            "need target depths (--target-depth, target_depths) from 50 to",
        ),
        (["simulate", "slocum_flight", "--target-depth", "3"], "(--target-depth, target_depths) from 32 to 1000 m"),
        (["simulate", "remus100", "--dt", "1"], "No gains of 'remus100' within a factor of 2"),
        (["simulate", "slocm"], "Did you mean 'slocum'"),
        (["simulate", "slocum", "--dt", "700"], "--duration must be at least one sample (700 s), got 600 s."),
        (["simulate", "slocum", "--effect", "effects.rudder.offset"], "got no '='"),
        (["simulate", "slocum", "--effect", "effects.rudder.offset=much"], "the value 'much'"),
        (["simulate", "slocum", "--effect", "effects.rudder.ofset=0.1"], "Did you mean 'effects.rudder.offset'"),
        (["simulate", "slocum", "--effect", "effects.rudder.offset=9"], "from -0.5 to 0.5 rad"),
        (["simulate", "slocum", "--duration", "2"], "--duration must be at least one sample (4 s), got 2 s."),
        (["simulate", "slocum", "--duration", "8.1e6"], "makes 2.02e+06 samples, but memory allows for 2000000"),
        (["simulate", "slocum", "--duration", "2001", "--dt", "0.001"], "a longer --dt"),
        (["simulate", "slocum", "--out", "run.xlsx"], ".nc or .csv"),
        (
            ["simulate", "slocum", "--out", "no/such/folder/run.nc"],
            "--out names the folder no/such/folder, which does not",
        ),
        (["diagnose", "nothing.csv", "--vehicle", "slocum", "--out", "OUT"], "There is no file nothing.csv"),
        (["diagnose", "nothing.csv", "--vehicle", "slocm", "--out", "OUT"], "Did you mean 'slocum'"),
        (["diagnose", "nothing.csv", "--vehicle", "slocum", "--out", "FILE"], "Cannot write into"),
    ],
)
def test_errors_are_one_message_and_exit_code_1(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("AUV_GYM_DEBUG", raising=False)
    (tmp_path / "file").write_text("")
    places = {"OUT": str(tmp_path / "out"), "FILE": str(tmp_path / "file" / "out")}
    assert main([places.get(argument, argument) for argument in arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("Error: ")
    assert words in error
    assert "Traceback" not in error


def test_usage_errors_exit_with_2(capsys):
    assert main(["simulate"]) == 2
    assert main(["list", "vehicels"]) == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert (
        "'what': vehicles, parts, effects, methods or channels is needed, got 'vehicels'. Did you mean 'vehicles'?"
        in said
    )
    assert "Value error" not in said
    assert main(["nonsense"]) == 2
    assert "Usage" in capsys.readouterr().err


def test_an_interrupt_is_said_and_has_its_exit_code(monkeypatch, capsys):
    def interrupted(name):
        raise KeyboardInterrupt

    monkeypatch.setattr("auv_gym.presets.find_vehicle", interrupted)
    assert main(["look", "log.csv", "--vehicle", "slocum"]) == 130
    assert capsys.readouterr().err.split() == ["Stopped."]


def test_debug_shows_the_traceback(monkeypatch):
    monkeypatch.setenv("AUV_GYM_DEBUG", "1")
    with pytest.raises(ValueError, match="slocum"):
        main(["simulate", "slocm"])


@pytest.mark.parametrize(
    "options, words",
    [
        (["--min-depth", "500"], "The log has no sample deeper than 500 m; its depth"),
        (["--max-depth", "0"], "The log has no sample shallower than 0 m; its depth"),
        (["--min-depth", "500", "--max-depth", "600"], "The log has no sample between 500 and 600 m; its depth"),
        (["--min-depth", "30", "--max-depth", "20"], "--min-depth needs to be less"),
    ],
)
def test_diagnose_says_why_a_depth_range_is_empty(options, words, tmp_path, capsys):
    log = tmp_path / "run.csv"
    assert main(["simulate", "slocum", "--out", str(log)]) == 0
    capsys.readouterr()
    assert main(["diagnose", str(log), "--vehicle", "slocum", "--out", str(tmp_path / "out"), *options]) == 1
    assert words in capsys.readouterr().err


def test_the_folder_is_checked_before_the_log_is_read(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file" / "out")
    assert main(["diagnose", "no-such-log.csv", "--vehicle", "slocum", "--out", out]) == 1
    assert "Cannot write into" in capsys.readouterr().err
