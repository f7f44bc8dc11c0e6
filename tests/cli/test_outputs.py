"""What commands write: never over an input, nor over a file of another kind, and this is said before any work."""

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.cli.options.outputs import is_gains, is_mapping, is_simulated, is_vehicle
from auv_gym.plant import load_vehicle, save_vehicle
from auv_gym.records.record import Record

GAINS = '[[vehicle]]\nname = "remus100"\ndt_s = 0.1\n'
MAPPING = 'Hdg = "heading_deg"\n'
LOG = "time_s,heading_deg,Fin\n" + "".join(f"{k},{k % 7},{k % 3}\n" for k in range(40))


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("auv_gym.cli.options.console.errors.width", 250)
    save_vehicle(load_vehicle("slocum"), "vehicle.toml")
    for name, text in (("log.csv", LOG), ("gains.toml", GAINS), ("names.toml", MAPPING)):
        (tmp_path / name).write_text(text)
    (tmp_path / "link.toml").symlink_to(tmp_path / "vehicle.toml")
    return {path.name: path.read_bytes() for path in tmp_path.iterdir()}


INPUT, OTHER = "would overwrite", "would overwrite a file that is not"


@pytest.mark.parametrize(
    "command, words",
    [
        ("look log.csv --mapping-out log.csv", f"{INPUT} log.csv, which the command is to read: give another name."),
        ("look log.csv --mapping names.toml --mapping-out names.toml", "which was given with --mapping"),
        ("look log.csv --mapping-out vehicle.toml", f"{OTHER} a mapping"),
        ("look log.csv --mapping-out gains.toml", f"{OTHER} a mapping"),
        ("diagnose log.csv --vehicle vehicle.toml --out .", "which was given with --vehicle: give another folder."),
        ("diagnose log.csv --vehicle link.toml --out .", "which was given with --vehicle"),
        ("diagnose log.csv --vehicle slocum --mapping ./vehicle.toml --out .", "which was given with --mapping"),
        ("tune slocum --out vehicle.toml", f"{OTHER} a file of gains"),
        ("tune vehicle.toml --out vehicle.toml", "which was given with VEHICLE"),
        ("tune slocum --gains gains.toml --out new.toml --report gains.toml", "which was given with --gains"),
        ("export npsauv --to sdf --out vehicle.toml", f"{OTHER} an SDF file"),
        ("export vehicle.toml --to control --out vehicle.toml", "which was given with VEHICLE"),
        ("export slocum --to casadi --out log.csv", f"{OTHER} a function that CasADi saved"),
        ("export slocum --to control --out log.csv", f"{OTHER} a MAT file"),
        ("identify log.csv --method grey_box --vehicle vehicle.toml --out vehicle.toml", "was given with --vehicle"),
        ("identify log.csv --method grey_box --vehicle slocum --out names.toml", f"{OTHER} a vehicle file"),
        ("simulate slocum --out log.csv", f"{OTHER} a record as this command writes it"),
    ],
)
def test_inputs_and_files_of_another_kind_are_kept(command, words, files, tmp_path, capsys):
    assert main(command.split()) == 1
    said = capsys.readouterr().err
    assert words in said, said
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files


def test_a_command_may_be_run_again_on_its_own_output(tmp_path):
    for command in (
        "look log.csv --mapping-out new.toml",
        "simulate slocum --duration 40 --out new.csv",
        "simulate slocum --duration 40 --out new.nc",
        "export npsauv --to sdf --out new.sdf",
    ):
        assert main(command.split()) == 0, command
        assert main(command.split()) == 0, command


def test_kinds_of_files_are_told_apart(tmp_path):
    kinds = {is_gains: "gains.toml", is_mapping: "names.toml", is_vehicle: "vehicle.toml"}
    for is_one in kinds:
        for name in (*kinds.values(), "log.csv"):
            assert is_one(tmp_path / name) == (kinds[is_one] == name), (is_one.__name__, name)
    (tmp_path / "draft.toml").write_text('# Mapping of log.csv.\n# "Fin" = ""\n')
    assert is_mapping(tmp_path / "draft.toml")
    assert (
        main(
            [
                "simulate",
                "qiandao_float",
                "--duration",
                "60",
                "--target-depth",
                "2",
                "--target-depth",
                "4",
                "--out",
                "dives.csv",
            ]
        )
        == 0
    )
    assert is_simulated(tmp_path / "dives.csv")
    Record.from_arrays(np.arange(4.0), {"depth_m": np.arange(4.0)}).save(tmp_path / "log.nc")
    assert is_simulated(tmp_path / "log.nc")
    (tmp_path / "other.nc").write_bytes(b"CDF\1")
    assert not is_simulated(tmp_path / "other.nc")


@pytest.mark.parametrize(
    "report, words",
    [
        ("log.csv", "Cannot write into log.csv: it is a file. Give another folder."),
        ("rep.htm", "--report needs a name that ends in .html, or a folder, got 'rep.htm'."),
        ("folder.html", "--report folder.html is a folder: give a file in it, such as folder.html/report.html."),
    ],
)
def test_where_no_report_can_be_written_is_said_before_the_fit(report, words, tmp_path, monkeypatch, capsys):
    (tmp_path / "folder.html").mkdir()
    monkeypatch.setattr("identification.identified.identify", None)  # no fit is begun
    given = [
        "identify",
        "log.csv",
        "--method",
        "arx",
        "--input",
        "fin_deg",
        "--output",
        "heading_rad",
        "--out",
        "m.npz",
        "--report",
    ]
    assert main([*given, report]) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "rep.htm").exists()


def test_a_mapping_in_use_is_not_the_one_that_look_says_to_write(tmp_path, capsys):
    (tmp_path / "plain.csv").write_text(LOG.replace("heading_deg", "Hdg"))
    assert main(["look", "plain.csv", "--vehicle", "slocum", "--mapping", "names.toml"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert text.endswith("--mapping names.toml --mapping-out names_2.toml")
