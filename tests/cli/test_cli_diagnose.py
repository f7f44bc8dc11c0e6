"""The command `auv-gym diagnose`: its files, and what it says to bad input."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.cli.diagnose import _error_table
from auv_gym.cli.options.logs import thinned
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.readers.slocum import bundled_slocum_log
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from identification.diagnosis.result_files import digest_of
from identification.experiments.heading_control import closed_loop

# with heading and rudder alone, what the deadband does differs with the speed, and no constant effect is named
ATTITUDE = ("u_mps", "pitch_rad", "roll_rad")


@pytest.fixture(scope="module")
def log() -> Record:
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.deadband", 0.06)
    return closed_loop(plant, rng=np.random.default_rng(2), duration=600.0, track_noise=None)


def write_csv(path, columns):
    rows = zip(*columns.values())
    path.write_text("\n".join([",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n")
    return path


def columns_of(record, **changes):
    columns = {"time_s": record.time, "heading_rad": record["heading_rad"], "rudder_rad": record["rudder_rad"]}
    return {**columns, **changes}


def run(log_path, out, *options, vehicle="slocum"):
    return main(["diagnose", str(log_path), "--vehicle", vehicle, "--out", str(out), *options])


def test_a_csv_log_in_degrees_gives_the_three_files(log, tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    columns = columns_of(log)
    degrees = {"time_s": columns["time_s"], "heading_deg": np.rad2deg(columns["heading_rad"]) % 360.0}
    degrees["rudder_deg"] = np.rad2deg(columns["rudder_rad"])
    degrees |= {name: log[name] for name in ATTITUDE}
    out = tmp_path / "out"
    assert run(write_csv(tmp_path / "mission.csv", degrees), out, "--seed", "5", "--timings") == 0
    said = " ".join(capsys.readouterr().out.split())
    for step in ("reading the log", "checking the log", "fitting what is known", "searching effects", "judging"):
        assert re.search(rf"{step} \d+\.\d", said)
    assert "The model is missing an effect: rudder deadband, " in said
    content = json.loads((out / "diagnosis.json").read_text())
    assert content["verdict"] == "named"
    assert content["seed"] == 5
    (effect,) = content["effects"]
    assert effect["path"] == "effects.rudder.deadband"
    assert set(effect["evidence"]) == {"all_rows", "cross_validated"}
    assert 0.5 < effect["frequency"] <= 1.0
    assert content["dropped"] == []
    assert content["error"]["metric"] == "RMS error of free runs in unseen parts of the log"
    assert 4 <= content["error"]["parts"] <= content["error"]["windows"]
    assert effect["ci95"][0] < 0.06 < effect["ci95"][1]
    assert {p.name for p in out.iterdir()} == {"diagnosis.json", "vehicle.toml", "report.html"}
    assert load_vehicle(out / "vehicle.toml").effects.rudder.deadband == pytest.approx(effect["value"])


def test_a_log_can_be_thinned(log, tmp_path):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    out = tmp_path / "out"
    assert run(write_csv(tmp_path / "mission.csv", columns_of(log)), out, "--resample", "8") == 0
    diagnosed = json.loads((out / "diagnosis.json").read_text())["record_sha256"]
    path = tmp_path / "mission.csv"
    assert diagnosed == digest_of(read_record(path).resample(8.0)) != digest_of(read_record(path))


def bad_logs(record):
    n = len(record)
    heading, rudder, time = record["heading_rad"], record["rudder_rad"], record.time
    nothing = np.full(n, np.nan)
    return {
        "missing column": ({"time_s": time, "heading_rad": heading}, ["rudder_rad", "heading_rad"]),
        "unknown unit suffix": ({"time_s": time, "heading_degree": heading, "rudder_rad": rudder}, ["heading_degree"]),
        "constant rudder": (columns_of(record, rudder_rad=np.full(n, 0.1)), ["Nothing excites", "constant at 0.1"]),
        "constant heading": (
            columns_of(record, heading_rad=np.full(n, 1.0)),
            ["heading_rad is constant at 1 rad in all 151 samples, although the inputs move"],
        ),
        "no times": ({**columns_of(record), "time_s": nothing}, ["None of the 151 rows has a time"]),
        "too short": ({k: v[:20] for k, v in columns_of(record).items()}, ["at least 4 windows of 120 s"]),
        "nothing in a required channel": (columns_of(record, heading_rad=nothing), ["heading_rad", "no value in any"]),
        "no rudder": (columns_of(record, rudder_rad=nothing), ["rudder_rad", "no value in any"]),
    }


CASES = [
    *("missing column", "unknown unit suffix", "constant rudder", "too short", "nothing in a required channel"),
    *("no rudder", "constant heading", "no times"),
]


@pytest.mark.parametrize("case", CASES)
def test_bad_logs_are_refused_in_words(case, log, tmp_path, capsys):
    columns, words = bad_logs(log)[case]
    out = tmp_path / "out"
    assert run(write_csv(tmp_path / "bad.csv", columns), out) == 1
    said = " ".join(capsys.readouterr().err.split())
    for word in words:
        assert word.lower() in said.lower(), said
    assert "Traceback" not in said
    assert not out.exists()


def test_a_diagnosis_to_repeat_that_is_not_there_is_named(log, tmp_path, capsys):
    path, missing = write_csv(tmp_path / "log.csv", columns_of(log)), tmp_path / "diagnosis.json"
    assert run(path, tmp_path / "out", "--again", str(missing)) == 1
    assert f"There is no file {missing}. Give the diagnosis.json that" in " ".join(capsys.readouterr().err.split())


def test_a_page_given_as_the_diagnosis_to_repeat_is_said_to_be_none(log, tmp_path, capsys):
    path, page = tmp_path / "log.csv", tmp_path / "report.html"
    write_csv(path, columns_of(log))
    page.write_text("<html></html>")
    assert run(path, tmp_path / "out", "--again", str(page)) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "is no diagnosis.json, since it does not hold JSON. Give the diagnosis.json that" in said


def test_a_vehicle_without_a_part_with_a_command_is_refused(log, tmp_path, capsys):
    path, vehicle = tmp_path / "log.csv", tmp_path / "bare.toml"
    write_csv(path, columns_of(log))
    vehicle.write_text('family = "body"\nname = "bare"\n[hull]\nmass = { value = 52, unit = "kg" }\n')
    assert run(path, tmp_path / "out", vehicle=str(vehicle)) == 1
    assert "bare.toml has no part with a command" in " ".join(capsys.readouterr().err.split())


def test_a_gap_may_be_cut_out_instead(log, tmp_path, capsys):
    heading = np.r_[log["heading_rad"]]
    heading[70:80] = np.nan
    path = write_csv(
        tmp_path / "gap.csv", columns_of(log, heading_rad=heading, **{name: log[name] for name in ATTITUDE})
    )
    out = tmp_path / "out"
    assert run(path, out, "--refuse-gaps") == 1
    assert "or no --refuse-gaps" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()
    assert run(path, out, "--window", "90") == 0
    line = "10 of 151 samples (6.6 %) were dropped, where heading_rad had no value; the record is cut there."
    assert " ".join(capsys.readouterr().err.split()).count(line) == 1
    content = json.loads((out / "diagnosis.json").read_text())
    assert content["effects"][0]["path"] == "effects.rudder.deadband"
    assert line in content["log_notes"]
    assert line in (out / "report.html").read_text()


def test_a_clock_that_was_set_back_cuts_the_log(log, tmp_path, capsys):
    time = log.time
    time[80:] -= 60.0
    path = write_csv(tmp_path / "back.csv", columns_of(log, time_s=time))
    assert run(path, tmp_path / "out", "--window", "90") == 0
    assert "The clock went back once; the record is cut there." in " ".join(capsys.readouterr().err.split())


def test_a_log_is_not_resampled_to_far_more_samples_than_it_has(log, tmp_path, capsys):
    path = tmp_path / "log.csv"
    write_csv(path, columns_of(log))
    assert run(path, tmp_path / "out", "--resample", "0.01") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "--resample 0.01 is far below the log's own interval of 4 s, and resampling adds no information" in said


def test_windows_shorter_than_two_samples_are_refused(log, tmp_path, capsys):
    path = write_csv(tmp_path / "log.csv", columns_of(log))
    assert run(path, tmp_path / "out", "--window", "0.1") == 1
    assert "4 s apart): choose longer windows or a smaller --resample" in " ".join(capsys.readouterr().err.split())
    assert main(["compare", "slocum", "--record", str(path), "--window", "0.1"]) == 1
    assert "samples 4 s apart: choose longer windows" in " ".join(capsys.readouterr().err.split())


def test_an_unknown_vehicle_is_answered_with_the_nearest_names(tmp_path, capsys):
    assert run("slocum:ammonite", tmp_path / "out", vehicle="ganeshblu") == 1
    assert "Did you mean 'ganeshblue'" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("kept", [0, 200, 5000])
def test_a_truncated_binary_is_refused(kept, tmp_path, capsys):
    pytest.importorskip("dbdreader", reason="the extra `slocum` is not installed")
    whole = bundled_slocum_log("ammonite").read_bytes()
    path = tmp_path / "cut.mbd"
    path.write_bytes(whole[:kept])
    assert run(path, tmp_path / "out") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "cut.mbd" in said
    assert "Traceback" not in said


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(log, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    path = write_csv(tmp_path / "log.csv", columns_of(log))
    assert run(path, tmp_path / "file" / "out") == 1
    assert "Cannot write into" in " ".join(capsys.readouterr().err.split())


def test_a_log_much_finer_than_the_vehicles_step_is_brought_to_it():
    time = 0.005 * np.arange(2001)
    fine = Record.from_arrays(time, {"heading_rad": np.sin(time)})
    coarse = thinned(fine, 0.05)
    assert coarse.sample_interval == pytest.approx(0.05)
    assert coarse.notes[-1].startswith("Resampled from an interval of 0.005 s to the vehicle's time step of 0.05 s")
    assert thinned(fine, 0.019) is fine  # not four times as fine


def test_what_is_remarkable_in_a_log_is_said_once_and_before_the_search(tmp_path, capsys, monkeypatch):
    time = 0.01 * np.arange(4000)
    columns = {"time_s": time, **{f"t{k}_share": 0.3 * np.sin(k * time) for k in range(1, 10)}}
    columns |= {name: 0.1 * np.sin(time) for name in ("depth_m", "heading_rad", "roll_rad", "pitch_rad")}
    columns["t8_share"] = np.zeros(4000)

    def search(*given, **settings):
        raise ValueError("The search begins.")

    monkeypatch.setattr("identification.diagnosis.diagnose", search)
    assert run(write_csv(tmp_path / "log.csv", columns), tmp_path / "out", vehicle="bluerov2_heavy") == 1
    said, _, after = " ".join(capsys.readouterr().err.split()).partition("The search begins.")
    assert after == ""
    for words in (
        "t8_share does not move. This log shows nothing about its gain, dead zone, lag, place or direction.",
        "also has t9_share, which is not used",
        "Resampled from an interval of 0.01 s",
    ):
        assert said.count(words) == 1


def test_a_log_in_degrees_is_doubted_and_ends_with_the_mapping_that_mends_it(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    record = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(3), duration=600.0)
    wrong = record.with_channels({name: np.degrees(record[name]) for name in ("heading_rad", "rudder_rad")})
    wrong.save(tmp_path / "log.nc")
    code = main(["diagnose", str(tmp_path / "log.nc"), "--vehicle", "slocum", "--out", str(tmp_path / "out")])
    assert code == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Something is wrong with the log: rudder_rad and heading_rad look like degrees, not rad." in told
    assert 'Next: write into names.toml: "rudder_rad" = "rudder_deg" and "heading_rad" = "heading_deg"; then' in told


def test_the_table_of_errors_has_each_stage_under_its_own_name():
    def stage(rmse: float) -> SimpleNamespace:
        return SimpleNamespace(scores={"depth_m": SimpleNamespace(rmse=rmse)})

    stages = {"as given": stage(0.13), "refitted": stage(0.0216)}
    d = SimpleNamespace(stages=stages, given=stages["as given"], before=stages["as given"], reach="", unseen_words="")
    shown = _error_table(d)  # type: ignore[arg-type]
    cells = {str(column.header): [str(cell) for cell in column.cells] for column in shown.columns}
    assert cells == {"channel": ["depth_m"], "as given": ["0.13 m"], "refitted": ["0.0216 m"]}
