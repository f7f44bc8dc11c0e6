"""What `auv-gym diagnose` says to type after it doubted the log."""

import tomllib

import numpy as np
import pytest

from auv_gym.cli.options.after_doubt import next_command
from auv_gym.plant import load_vehicle
from auv_gym.records.reading import read_record
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.log.slips import Slip, possible_slips, undone

PLANT = load_vehicle("slocum")


@pytest.fixture
def log(tmp_path):
    k = np.arange(60)
    columns = {
        "time_s": 4.0 * k,
        "Yaw [deg]": 20.0 * np.sin(0.05 * k),
        "rudder_rad": 0.3 * np.cos(0.3 * k),
        "pitch_deg": 5.0 * np.cos(0.1 * k),
        "roll_rad": 0.1 * np.sin(0.2 * k),
    }
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def doubted(text, log):
    slip = next(s for s in possible_slips(read_record(log), PLANT) if s.text.startswith(text))
    return Doubt(slip.text, slip.channels, 50.0, slip.mend, slip)


@pytest.mark.parametrize(
    "text, lines",
    [
        ("heading_rad looks mirrored", '"Yaw [deg]" = "-heading_deg"'),
        ("the rudder acts with the opposite sign", '"rudder_rad" = "-rudder_rad"'),
        ("rudder_rad looks like degrees", '"rudder_rad" = "rudder_deg"'),
        ("roll_rad and pitch_rad look exchanged", '"roll_rad" = "pitch_rad" and "pitch_deg" = "roll_deg"'),
    ],
)
def test_a_slip_is_undone_by_the_lines_that_it_says(log, text, lines):
    doubt, options = doubted(text, log), "--vehicle slocum --out out"
    told = next_command([doubt], [str(log)], None, None, options)
    assert told == f"write into names.toml: {lines}; then auv-gym diagnose {log} --mapping names.toml {options}"
    names = log.with_name("names.toml")
    names.write_text(lines.replace(" and ", "\n"))
    mapped, mended = read_record(log, names), undone(read_record(log), doubt.slip, PLANT)
    assert tomllib.loads(names.read_text())
    for name in mended.names:
        np.testing.assert_allclose(mapped[name], mended[name], atol=1e-9)  # the mapping turns before it converts
    told = next_command([doubt], [str(log)], names, None, options)
    assert told.startswith(f"in {names}, change the lines of these columns to ")


def test_an_offset_is_told_in_the_unit_of_the_column(log):
    slip = Slip("", "", ("heading_rad",), (-1.0,), offset=np.pi)
    told = next_command([Doubt("", ("heading_rad",), 9.0, "", slip)], [str(log)], None, None, "")
    assert '"Yaw [deg]" = { to = "heading_deg", factor = -1.0, offset = 180.0 }' in told


def test_of_several_possible_units_none_is_written(log):
    slip = Slip("", "multiply pitch_rad by 1 or 2, whichever is right", ("pitch_rad",))
    told = next_command([Doubt("", ("pitch_rad",), 9.0, slip.mend, slip)], [str(log)], None, None, "--vehicle slocum")
    assert told == f"in the file, {slip.mend}, then auv-gym diagnose {log} --vehicle slocum"


def test_what_no_mapping_can_mend_is_to_be_mended_in_the_file(log):
    told = next_command([doubted("time runs at half", log)], [str(log)], None, None, "--vehicle slocum")
    assert told == f"in the file, multiply time_s by 2, then auv-gym diagnose {log} --vehicle slocum"


def test_a_doubt_that_no_correction_mends_leads_to_the_other_vehicles(log):
    told = next_command([Doubt("far apart", (), 1.0, "check the vehicle")], [str(log)], None, None, "--vehicle slocum")
    assert told.startswith(f"auv-gym look {log} (this compares the log with all vehicles")
