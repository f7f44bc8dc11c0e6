"""`auv-gym diagnose` with dives of a Seaglider: several files are one record, and what is said of them."""

import json
import re

import h5py
import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.cli.options.logs import load_stated
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.stated import as_stated, vehicle_from_dive
from identification.experiments.glider_dives import yo_mission
from tests.seaglider_dives import write_dive

STATED = {
    "sg_cal_mass": 54.5, "sg_cal_volmax": 53700.0, "sg_cal_vbdbias": 130.0, "sg_cal_rho0": 1027.5, "log_VBD_MIN": 600.0,
    "sg_cal_hd_a": 8.9e-4, "sg_cal_hd_b": 0.0224, "sg_cal_hd_c": 5.7e-6, "sg_cal_hd_s": -0.25, "log_VBD_MAX": 3960.0,
    "sg_cal_abs_compress": 1.5e-6, "sg_cal_therm_expan": 7.05e-5, "sg_cal_temp_ref": 15.0, "log_C_VBD": 2700.0,
    "log_VBD_CNV": -0.245296,
}  # fmt: skip


def write_fixed_dive(path, number, columns):
    """A dive's file with GPS fixes, of columns by the basestation's own names."""
    with h5py.File(write_dive(path, "SG998", number, columns, STATED), "a") as file:
        fixes = file.create_dataset("gps_info", data=np.arange(3.0))
        fixes.make_scale("gps_info")
        begun, ended = columns["time"][0] - 60.0, columns["time"][-1] + 60.0
        for key, values in {"time": (begun - 60.0, begun, ended), "lat": [47.0] * 3, "lon": [-125.0] * 3}.items():
            file[f"log_gps_{key}"] = np.array(values)
            file[f"log_gps_{key}"].dims[0].attach_scale(fixes)
        file["log_gps_time"].attrs["units"] = "seconds since 1970-1-1 00:00:00"


def write_log(path, **changes):
    """A table of two dives of the preset, ten minutes afloat behind each; changes: factors of columns, 0 for none."""
    glider, rows = load_vehicle("seaglider"), []
    record = yo_mission(glider, (250.0, 250.0), rng=np.random.default_rng(1), dt=20.0)
    names = ("buoyancy_volume_m3", "pitch_rad", "heading_rad", "temperature_C", "density_kgpm3", "depth_m")
    for number, part in enumerate(record.segments):
        dive = np.column_stack([record.time[part], *(record[name][part] for name in names)])
        afloat = np.tile(dive[-1], (30, 1)) + np.outer(20.0 * np.arange(1, 31), [1.0, *[0.0] * 6])
        afloat[:, 1], afloat[:, 2], afloat[:, -1] = 0.0, -1.1, 0.2
        rows += [np.column_stack([np.full(len(dive) + 30, number), np.vstack([dive, afloat])])]
    table = np.vstack(rows) * [1.0, 1.0, *(changes.get(name, 1.0) for name in names)]
    kept = [0, 1, *(k for k, name in enumerate(names, start=2) if changes.get(name, 1.0))]
    head = ["segment", "time_s", *names]
    np.savetxt(path, table[:, kept], delimiter=",", header=",".join(head[k] for k in kept), comments="")
    return str(path)


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"pitch_rad": 0.0, "heading_rad": 0.0}, "The log has no channel pitch_rad, which is needed"),
        ({"buoyancy_volume_m3": -1.0}, "check the column's sign and unit, throughout the log; its sign looks turned."),
        ({"buoyancy_volume_m3": 1e6}, "throughout the log; it looks like cm3 (a name that ends in _cm3)."),
        ({"depth_m": 0.03}, "100 % near the surface. Check signs and units of depth, pitch and the inputs"),
    ],
)
def test_a_log_that_no_dive_can_have_is_refused_with_what_to_do(tmp_path, capsys, changes, words):
    log = write_log(tmp_path / "log.csv", **changes)
    assert main(["diagnose", log, "--vehicle", "seaglider", "--out", str(tmp_path / "out")]) != 0
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_log_that_states_no_constants_is_said_to(tmp_path, capsys):
    log = write_log(tmp_path / "log.csv")
    load_stated("seaglider", log)
    told = "log.csv states no constants of its vehicle (sg_cal_mass and others): those of seaglider are used."
    assert told in " ".join(capsys.readouterr().err.split())
    load_stated("seaexplorer", log)  # one glider, with numbers of its own
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_dives_that_end_afloat_without_a_ctd_or_a_heading_say_what_is_assumed_and_left_out(tmp_path, capsys):
    none = dict.fromkeys(("temperature_C", "density_kgpm3", "heading_rad"), 0.0)
    log = write_log(tmp_path / "log.csv", **none)
    assert main(["diagnose", log, "--vehicle", "seaglider", "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "(density_kgpm3): 1027.5 kg/m3 is assumed throughout" in said
    assert "(temperature_C): 15 degC is assumed throughout" in said
    assert re.search(
        r"\d+ % of the log is left out, since seaglider does not describe it: \d+ % near the surface", said
    )
    result = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert result["failures"] == []  # pictures count the rows that are left
    assert result["currents"] == []


@pytest.mark.slow
def test_dives_of_a_seaglider_are_one_record_of_the_glider_that_they_state(tmp_path, capsys):
    write_fixed_dive(tmp_path / "first.nc", 1, {"time": np.arange(3.0), "depth": np.arange(3.0)})
    glider = vehicle_from_dive(tmp_path / "first.nc")
    neutral = glider.hull.engine_neutral
    # the log has no CTD: water of one density, in which the hull neither shrinks nor warms
    flown = replace_at(glider, {"hull.compressibility": 0.0, "hull.expansion": 0.0, "effects.volume.offset": 4e-5})
    record = yo_mission(flown, (180.0, 200.0, 190.0), rng=np.random.default_rng(2), dt=15.0, noise=0.03)
    assert as_stated(load_vehicle("seaglider"), tmp_path / "first.nc")[0].hull.mass == 54.5
    files = []
    for number, part in enumerate(record.segments, start=1):
        files.append(tmp_path / f"p998000{number}.nc")
        columns = {
            "time": 1.7e9 + record["elapsed_s"][part],
            "depth": record["depth_m"][part],
            "eng_head": np.degrees(record["heading_rad"][part]) % 360.0,
            "eng_pitchAng": np.degrees(record["pitch_rad"][part]),
            "eng_rollAng": np.zeros(part.stop - part.start),
            "eng_vbdCC": 1e6 * (record["buoyancy_volume_m3"][part] - neutral),
        }
        write_fixed_dive(files[-1], number, columns)
    out = tmp_path / "out"
    assert main(["diagnose", *map(str, files), "--vehicle", "seaglider", "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert re.search(r"vehicle constants taken from \S+p9980001.nc: mass, density, temperature", said)
    assert said.count("(density_kgpm3): 1027.5 kg/m3 is assumed throughout") == 1
    assert "since sg998 does not describe it" in said
    result = json.loads((out / "diagnosis.json").read_text())
    assert result["verdict"] in ("named", "tied")
    assert load_vehicle(out / "vehicle.toml").hull.mass == 54.5
    # it surfaces where it dived, so that the water took it back
    assert (
        "Depth-averaged current to the north and east, from GPS and dead reckoning, with 95 % intervals: dive 1: "
        in result["summary"]
    )
    assert [0.1 < np.hypot(c["north"], c["east"]) < 0.4 for c in result["currents"]] == [True] * 3
