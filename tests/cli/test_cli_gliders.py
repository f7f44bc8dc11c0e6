"""`auv-gym diagnose` with dives of a Seaglider: several files are one record, and what is said of them."""

import json

import h5py
import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.stated import as_stated, vehicle_from_dive
from identification.experiments.glider_dives import yo_mission

STATED = {
    "sg_cal_mass": 54.5, "sg_cal_volmax": 53700.0, "sg_cal_vbdbias": 130.0, "sg_cal_rho0": 1027.5, "log_VBD_MIN": 600.0,
    "sg_cal_hd_a": 8.9e-4, "sg_cal_hd_b": 0.0224, "sg_cal_hd_c": 5.7e-6, "sg_cal_hd_s": -0.25, "log_VBD_MAX": 3960.0,
    "sg_cal_abs_compress": 1.5e-6, "sg_cal_therm_expan": 7.05e-5, "sg_cal_temp_ref": 15.0, "log_C_VBD": 2700.0,
    "log_VBD_CNV": -0.245296,
}  # fmt: skip


def write_dive(path, number, columns):
    """A dive's file as the basestation writes it, of columns by its own names."""
    with h5py.File(path, "w") as file:
        file.attrs["dive_number"], file.attrs["platform_id"] = number, "SG998"
        dim = file.create_dataset("sg_data_point", data=np.arange(len(columns["time"]), dtype=float))
        dim.make_scale("sg_data_point")
        for key, values in columns.items():
            file[key] = values
            file[key].dims[0].attach_scale(dim)
        file["time"].attrs["units"] = "seconds since 1970-1-1 00:00:00"
        file["depth"].attrs["units"] = "meters"
        for key, value in STATED.items():
            file[key] = value


@pytest.mark.slow
def test_dives_of_a_seaglider_are_one_record_of_the_glider_that_they_state(tmp_path, capsys):
    write_dive(tmp_path / "first.nc", 1, {"time": np.arange(3.0), "depth": np.arange(3.0)})
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
        write_dive(files[-1], number, columns)
    out = tmp_path / "out"
    assert main(["diagnose", *map(str, files), "--vehicle", "seaglider", "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "p9980001.nc states: mass, density, temperature" in said
    assert "(density_kgpm3): 1027.5 kg/m3 is assumed throughout" in said
    assert "since sg998 does not describe it" in said
    result = json.loads((out / "diagnosis.json").read_text())
    assert result["verdict"] in ("named", "tied")
    assert load_vehicle(out / "vehicle.toml").hull.mass == 54.5
