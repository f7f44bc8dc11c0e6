"""`auv-gym export`."""

import importlib
import json
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.records.record import Record


def test_sdf_says_what_it_does_not_hold(tmp_path, capsys):
    file = tmp_path / "npsauv.sdf"
    assert main(["export", "npsauv", "--to", "sdf", "--out", str(file)]) == 0
    assert "Not representable in SDF: Cross-flow drag" in capsys.readouterr().out
    assert ElementTree.parse(file).getroot().tag == "sdf"


@pytest.mark.parametrize("form, ending, needed", [("sdf", ".sdf", "auv_gym"), ("control", ".mat", "control")])
def test_a_file_without_an_ending_is_given_the_usual_one(tmp_path, capsys, form, ending, needed):
    pytest.importorskip(needed, reason=f"the extra `{needed}` is not installed")
    for given, written in (("boat", f"boat{ending}"), ("boat.v2", "boat.v2")):
        assert main(["export", "npsauv", "--to", form, "--out", str(tmp_path / given)]) == 0
        assert capsys.readouterr().out.rstrip().endswith(f"Written to {tmp_path / written}")
        assert (tmp_path / written).exists()
    assert {f.name for f in tmp_path.iterdir()} == {f"boat{ending}", "boat.v2"}


def test_a_file_under_the_ending_of_another_form_is_refused(tmp_path, capsys):
    assert main(["export", "npsauv", "--to", "sdf", "--out", str(tmp_path / "boat.mat")]) == 1
    assert "--out with --to sdf ends in .sdf, got 'boat.mat': rename it" in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_casadi_reads_the_function_that_was_written(tmp_path, capsys):
    ca = pytest.importorskip("casadi", reason="the extra `casadi` is not installed")
    file = tmp_path / "glider.casadi"
    assert main(["export", "ganeshblue", "--to", "casadi", "--out", str(tmp_path / "glider")]) == 0
    told = capsys.readouterr().out
    assert f"Written to {file} and {file}.json" in told
    assert "x: heading_rad, r_radps, north_m, east_m" in told
    assert "defaults of u, where not 0: u_mps = 0.3 m/s" in told
    rhs = ca.Function.load(str(file))
    assert rhs.name_in() == ["x", "u"]
    known = json.loads((tmp_path / "glider.casadi.json").read_text())
    assert list(known["defaults"]) == known["inputs"]
    assert set(known["units"]) == {*known["states"], *known["inputs"]}
    north = float(rhs([0.0] * 4, list(known["defaults"].values()))[2])
    assert north == pytest.approx(0.3)  # it goes ahead


def test_control_writes_a_mat_file(tmp_path, capsys):
    pytest.importorskip("control", reason="the extra `control` is not installed")
    assert main(["export", "npsauv", "--to", "control", "--continuous", "--out", str(tmp_path / "npsauv.mat")]) == 0
    assert "inputs: stern_plane_rad, bow_plane_rad" in capsys.readouterr().out


def test_minari_takes_logs(tmp_path, monkeypatch, capsys):
    pytest.importorskip("minari", reason="the extra `minari` is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    values = {name: np.linspace(0.0, 0.1, 40) for name in ("rudder_rad", "heading_rad", "r_radps")}
    Record.from_arrays(np.arange(40.0), values).save(tmp_path / "log.nc")
    given = ["export", "ganeshblue", "--to", "minari", "--log", str(tmp_path / "log.nc"), "--out", "glider/log-v0"]
    assert main(given) == 0
    assert "1 episode, 39 steps: minari.load_dataset('glider/log-v0')" in capsys.readouterr().out


def test_observations_are_readings(tmp_path, monkeypatch):
    """A rate that is missing for half of the log is no observation; on straight lines, it would be made up."""
    minari = pytest.importorskip("minari", reason="the extra `minari` is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    rows = "".join(f"{k},{0.01 * k},{0.001 * k},{0.01 if k < 20 else ''}\n" for k in range(40))
    (tmp_path / "log.csv").write_text("time_s,rudder_rad,heading_rad,r_radps\n" + rows)
    given = ["export", "ganeshblue", "--to", "minari", "--log", str(tmp_path / "log.csv"), "--out", "glider/half-v0"]
    assert main(given) == 0
    (episode,) = minari.load_dataset("glider/half-v0").iterate_episodes()
    assert episode.observations.shape == (40, 1)


def test_options_of_another_form_are_refused(capsys):
    assert main(["export", "ganeshblue", "--to", "minari"]) == 1
    assert main(["export", "ganeshblue", "--to", "sdf", "--continuous"]) == 1
    assert main(["export", "ganeshblue", "--to", "control", "--mapping", "none.toml"]) == 1
    assert main(["export", "ganeshblue", "--to", "casadi", "--cache-dir", "none"]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "Give --log with --to minari" in told
    assert "--continuous does not apply to sdf" in told
    assert "--mapping does not apply to control" in told
    assert "--cache-dir does not apply to casadi" in told


def test_the_name_of_a_data_set_is_checked_before_the_log_is_read(tmp_path, monkeypatch, capsys):
    pytest.importorskip("minari", reason="the extra `minari` is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    assert main(["export", "slocum", "--to", "minari", "--log", "none.csv", "--out", "slocum/dives"]) == 1
    assert "such as slocum/dives-v0, got 'slocum/dives'" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("package, module", [("casadi", "symbols"), ("minari", "for_minari")])
def test_a_missing_package_names_its_extra(package, module, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, f"auv_gym.exports.{module}", raising=False)
    with pytest.raises(ImportError, match=rf"in the clone of auv-gym: pip install '\.\[{package}\]'"):
        importlib.import_module(f"auv_gym.exports.{module}")


def test_a_missing_control_names_its_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "control", None)
    assert main(["export", "npsauv", "--to", "control"]) == 1
    assert "in the clone of auv-gym: pip install '.[control]'" in " ".join(capsys.readouterr().err.split())
