"""Constants that a dive's file states in the place of the vehicle's own."""

from math import pi

import h5py
import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.stated import as_stated, vehicle_from_dive
from auv_gym.records.readers.seaglider import neutral_volume
from auv_gym.records.reading import read_record
from auv_gym.vehicles.operators_constants import seaglider_constants
from tests.seaglider_dives import write_dive

# SG561, dive 2; volumes in cm3, counts of the buoyancy device from its largest volume at 600 down
CONSTANTS = {
    "sg_cal_mass": 53.959, "sg_cal_volmax": 53164.3, "sg_cal_vbdbias": 134.8, "sg_cal_rho0": 1027.5,
    "sg_cal_hd_a": 8.9e-4, "sg_cal_hd_b": 0.0224, "sg_cal_hd_c": 5.7e-6, "sg_cal_hd_s": -0.25,
    "sg_cal_abs_compress": 1.55e-6, "sg_cal_therm_expan": 7.05e-5, "sg_cal_temp_ref": 15.0,
    "log_C_VBD": 2700.0, "log_VBD_MIN": 600.0, "log_VBD_MAX": 3960.0, "log_VBD_CNV": -0.245296,
}  # fmt: skip


@pytest.fixture
def dive(tmp_path):
    """A function that writes a dive's file with these constants."""

    def write(constants, name="p5610002.nc"):
        n = 20
        columns = {
            "time": 1.4e9 + 30.0 * np.arange(n), "depth": 12.0 + 3.0 * np.arange(n), "eng_head": np.full(n, 30.0),
            "eng_pitchAng": np.full(n, -20.0), "eng_rollAng": np.zeros(n), "eng_vbdCC": np.full(n, -146.2),
        }  # fmt: skip
        return write_dive(tmp_path / name, "SG561", 2, columns, constants)

    return write


def test_a_dives_file_gives_the_vehicle(dive):
    plant = vehicle_from_dive(dive(CONSTANTS))
    hull = plant.hull
    assert (plant.name, hull.mass, hull.temperature) == ("sg561", 53.959, 15.0)
    assert hull.volume == pytest.approx((53164.3 - 134.8) * 1e-6)
    assert hull.compressibility == pytest.approx(1.55e-10)  # of 1/dbar, per Pa
    assert (hull.drag_0, hull.drag_power, hull.expansion) == (0.0224, -0.25, 7.05e-5)
    assert hull.lift_1 == pytest.approx(8.9e-4 * 180.0 / pi)
    assert hull.drag_2 == pytest.approx(5.7e-6 * (180.0 / pi) ** 2)
    assert hull.engine_low == pytest.approx(-0.245296e-6 * 3360)
    assert hull.engine_neutral == pytest.approx(-0.245296e-6 * 2100)
    assert plant.notes["hull.mass"] == "stated by p5610002.nc"
    given = load_vehicle("seaglider")
    share = plant.deviations["hull.lift_1"] / hull.lift_1
    assert share == pytest.approx(given.deviations["hull.lift_1"] / given.hull.lift_1)  # known in proportion


def test_without_the_engines_counts_the_hull_is_neutral_where_its_pilots_have_it(dive):
    constants = {name: value for name, value in CONSTANTS.items() if name.startswith("sg_cal")}
    found = seaglider_constants(constants)
    assert found["hull.volume"] == pytest.approx(53.959 / 1027.5)
    assert "hull.engine_low" not in found
    assert neutral_volume(constants) is None
    assert neutral_volume(CONSTANTS) == pytest.approx(-0.245296 * 2100)
    counted = {"log_C_VBD": 2832.0, "sg_cal_vbd_min_cnts": 390.0, "sg_cal_vbd_cnts_per_cc": -4.0767}
    assert neutral_volume({**counted, "log_VBD_MIN": 1.0, "log_VBD_CNV": 1.0}) == pytest.approx(2442.0 / -4.0767)


def test_a_file_that_states_nothing_is_refused(dive):
    path = dive({})
    with pytest.raises(ValueError, match=r"p5610002\.nc states no constant of seaglider .sg_cal_mass"):
        vehicle_from_dive(path)
    assert as_stated(load_vehicle("seaglider"), path) == (load_vehicle("seaglider"), ())


def test_a_constant_that_cannot_be_is_refused_with_its_place(dive):
    with pytest.raises(ValueError, match=r"p5610002.nc states hull.volume = .* needs 0.001 to 10"):
        vehicle_from_dive(dive({**CONSTANTS, "sg_cal_volmax": 0.0}))
    with pytest.raises(ValueError, match=r"constants that cannot be of seaglider: hull.engine_low must be less"):
        vehicle_from_dive(dive({**CONSTANTS, "log_VBD_CNV": 0.2453}))


def test_only_a_vehicle_of_a_series_takes_what_a_log_states(dive):
    path = dive(CONSTANTS)
    for name in ("slocum_flight", "remus100"):
        plant = load_vehicle(name)
        assert as_stated(plant, path) == (plant, ())
    assert value_at(load_vehicle("seaglider"), "hull.as_logged") == 1.0


def test_the_volume_counts_from_the_largest_one_in_every_dive(dive):
    """Where the pilots move $C_VBD by 50 counts, 12 cm3, the volume of the same counts stays."""
    read = []
    for centre, logged in ((2700.0, -146.2), (2650.0, -146.2 - 50.0 * 0.245296)):
        path = dive({**CONSTANTS, "log_C_VBD": centre}, f"p561000{int(centre)}.nc")
        with h5py.File(path, "r+") as file:
            file["eng_vbdCC"][...] = logged
        read.append(read_record(path)["buoyancy_volume_m3"])
    assert read[0] == pytest.approx(read[1], abs=1e-12)
    assert read[0][0] == pytest.approx(-1e-6 * (146.2 + 2100.0 * 0.245296))
