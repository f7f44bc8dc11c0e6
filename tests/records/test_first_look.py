import tomllib

import numpy as np
import pytest

from auv_gym.records.first_look import look_at, mapping_text
from auv_gym.records.reading import read_record
from auv_gym.records.understanding import Needs

NEEDS = Needs(("heading_rad", "rudder_rad"))


def write(path, columns):
    rows = zip(*columns.values())
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def columns(**others):
    t = np.arange(0.0, 200.0, 2.0)
    return {"time_s": t, "heading_deg": (350 + 0.5 * t) % 360, "depth_m": 5 + 0.1 * t, **others}


@pytest.fixture
def log(tmp_path):
    t = columns()["time_s"]
    rare = ["" if k != 7 else 3 for k in range(t.size)]
    return write(tmp_path / "log.csv", columns(fin=np.round(0.2 * np.sin(t / 9), 4), vacuum_inHg=t, pitch_deg=rare))


def test_what_is_there_and_what_it_is_taken_as(log):
    look = look_at(log)
    assert (look.format, look.duration, look.rows) == ("a table in text", 198.0, 100)
    by_column = {signal.column: signal for signal in look.signals}
    heading = by_column["heading_deg"]
    assert (heading.channel, heading.unit, heading.samples, heading.interval) == ("heading_rad", "rad", 100, 2.0)
    assert np.degrees([heading.low, heading.high]) == pytest.approx([0, 359], abs=1.0)
    assert by_column["vacuum_inHg"].channel == by_column["fin"].channel == ""
    assert any(line.startswith("vacuum_inHg: left out") for line in look.notes)
    assert any(line.startswith("pitch_rad: left out, since it has values at 1 of 100") for line in look.notes)
    assert look.missing(NEEDS) == ["rudder_rad"]


def test_the_mapping_it_writes_is_read_and_changes_nothing(log, tmp_path):
    look = look_at(log)
    path = tmp_path / "names.toml"
    path.write_text(mapping_text(look, [NEEDS]))
    text = path.read_text()
    assert tomllib.loads(text)["heading_deg"] == "heading_deg"
    assert '# "fin" = "rudder_rad"' in text
    assert '# "vacuum_inHg" = ""' in text
    before, after = read_record(log), read_record(log, path)
    assert before.names == after.names
    assert all(np.array_equal(before[name], after[name]) for name in before.names)
    path.write_text(text.replace('# "fin" =', '"fin" ='))
    assert read_record(log, path, NEEDS).has("rudder_rad")


T = np.arange(0.0, 200.0, 2.0)
STAMPS = np.datetime_as_string(np.datetime64("2024-05-31T23:58:00") + T.astype("timedelta64[s]"))
CLOCKS = {
    "epoch_ms": 1.7171e12 + 1e3 * T,
    "timestamp_ns": [f"{1717100000 + int(t)}000000000" for t in T],
    "Time [us]": 1e6 * T,
    "time": 1.7171e9 + T,
    "elapsed_min": T / 60.0,
    "Time (h)": T / 3600.0,
    "datenum": [f"{739321.5 + t / 86400.0:.10f}" for t in T],
    "UTC": STAMPS,
    "time_utc": [stamp[11:] for stamp in STAMPS],
}
SIGNALS = [
    "heading_deg", "Hdg (deg)", "Pitch [degrees]", "yawrate_dps", "YawRate (deg/s)", "Depth [dbar]", "Depth (cm)",
    "t1_pct", "Load (%)", "STW (kn)", "oil volume (cc)", "Temp (degC)", "Pressure [kPa]", "vbd ok (%)", "P_port (RPM)",
]  # fmt: skip


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_log_is_read_by_the_mapping_just_as_without(tmp_path, clock):
    signals = {name: np.round(10.0 + np.sin(T / (k + 1)), 4) for k, name in enumerate(SIGNALS)}
    log = write(tmp_path / "log.csv", {clock: CLOCKS[clock], **signals})
    (tmp_path / "names.toml").write_text(mapping_text(look_at(log)))
    before, after = read_record(log), read_record(log, tmp_path / "names.toml")
    assert before.duration_s == pytest.approx(198.0, abs=1e-3)
    assert before.names == after.names
    assert before.attrs.get("start_epoch_s") == pytest.approx(after.attrs.get("start_epoch_s"))
    assert before.time == pytest.approx(after.time, abs=2e-5)  # days since year 0 in double precision
    assert all(np.array_equal(before[name], after[name]) for name in before.names)


def test_a_guess_keeps_the_unit_that_the_column_states(tmp_path):
    moved = np.round(np.sin(T), 4)
    log = write(tmp_path / "log.csv", {"time_s": T, "Steering [deg]": moved, "thr_FP_pct": moved, "Oil (cc)": moved})
    needs = Needs(("rudder_rad", "thr_fp_share", "buoyancy_volume_m3"))
    text = mapping_text(look_at(log), [needs])
    path = tmp_path / "names.toml"
    path.write_text(text.replace('# "', '"'))
    record = read_record(log, path, needs)
    assert record["rudder_rad"] == pytest.approx(np.radians(moved))
    assert record["thr_fp_share"] == pytest.approx(0.01 * moved)
    assert record["buoyancy_volume_m3"] == pytest.approx(1e-6 * moved)


def test_what_cannot_be_a_channel_is_not_offered_for_it(tmp_path):
    moved = np.round(np.sin(T), 4)
    others = {"vbd ok": T % 2, "vbd": 0 * T + 3, "ballast (V)": moved, "engine mode": ["climb"] * T.size}
    look = look_at(write(tmp_path / "log.csv", {"time_s": T, "oil_volume_mL": moved, **others}))
    needs = Needs(("depth_m", "buoyancy_volume_m3"))
    assert list(look.offers("buoyancy_volume_m3", needs)) == ["oil_volume_mL"]
    assert look.offers("buoyancy_volume_m3", Needs((*needs.required, "oil_volume_m3"))) == {}
    lines = mapping_text(look, [needs]).splitlines()
    assert '# "oil_volume_mL" = "buoyancy_volume_mL"' in lines
    named = [line.removeprefix("# ").partition(" =")[0] for line in lines if " = " in line]
    assert len(named) == len(set(named)), lines


def test_names_that_toml_would_trip_over_are_quoted(tmp_path):
    odd = 'a "b"\\c [deg]'
    path = tmp_path / "log.csv"
    quoted = '"' + odd.replace('"', '""') + '"'
    path.write_text(f"time_s,heading_deg,{quoted}\n" + "".join(f"{k},{k},{k}\n" for k in range(5)))
    assert odd in tomllib.loads(mapping_text(look_at(path)).replace('# "a', '"a'))


def test_a_log_in_which_nothing_is_known_is_looked_at_all_the_same(tmp_path):
    path = write(tmp_path / "log.csv", {"time_s": range(10), "kurs": range(10)})
    look = look_at(path)
    assert look.record is None
    assert "No column of the log could be read" in look.problem
    assert [signal.column for signal in look.signals] == ["kurs"]


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"pitch_rad": 30.0 * np.sin(np.arange(100))}, 'it looks like degrees: map it to "pitch_deg"'),
        ({"rudder_rad": 25.0 * np.sin(np.arange(100))}, 'map it to "rudder_deg"'),
        ({"depth_m": -5 - 0.1 * np.arange(100)}, 'positive upwards: map it to "-depth_m"'),
        ({"u_mps": 150.0 + np.sin(np.arange(100))}, "centimetres per second"),
        ({"depth_m": 50_000 + np.arange(100.0)}, 'centimetres or millimetres: map it to "depth_cm" or "depth_mm",'),
        ({"heading_deg": np.linspace(0.0, 6.28, 100)}, "looks like radians"),
        ({"buoyancy_volume_m3": 200.0 * np.sin(np.arange(100))}, 'centimetres: map it to "buoyancy_volume_cm3"'),
    ],
)
def test_units_and_signs_that_cannot_be_are_doubted(tmp_path, changes, words):
    look = look_at(write(tmp_path / "log.csv", {**columns(), **changes}))
    assert any(words in line for line in look.doubts), look.doubts


def test_the_unit_of_a_depth_follows_from_speed_and_pitch(tmp_path):
    t = 4.0 * np.arange(300)
    pitch = 0.4 * np.sin(t / 100.0)
    depth = 50_000.0 - 1000.0 * np.cumsum(4.0 * 0.4 * np.sin(pitch))
    made = {"time_s": t, "pitch_rad": pitch, "u_mps": np.full(t.size, 0.4), "depth_m": depth}
    (doubt,) = look_at(write(tmp_path / "log.csv", made)).doubts
    assert doubt.endswith('it looks like millimetres: map it to "depth_mm".')


def test_a_few_impossible_inputs_are_named(tmp_path):
    rudder = 0.3 * np.sin(np.arange(100))
    rudder[40] = 1e9
    (doubt,) = look_at(write(tmp_path / "log.csv", {**columns(), "rudder_rad": rudder})).doubts
    assert doubt.startswith("rudder_rad: 1 of 100 values is impossible for rudder, such as 1e+09 rad.")


def turning(rate_factor=1.0, time_factor=1.0):
    t = np.arange(0.0, 200.0, 0.2)
    rate = 0.2 * np.sin(t / 7)
    heading = np.cumsum(rate) * 0.2
    return {"time_s": time_factor * t, "heading_rad": np.round(heading, 6), "r_radps": np.round(rate_factor * rate, 6)}


@pytest.mark.parametrize(
    "made, words",
    [
        (turning(rate_factor=-1.0), "opposite signs"),
        (turning(rate_factor=180 / np.pi), "r_radps looks like degrees per second that were taken for radians"),
        (turning(time_factor=1000.0), "milliseconds"),
        (turning(time_factor=2.0), "time runs at twice the rate"),
    ],
)
def test_angles_are_held_against_their_rates(tmp_path, made, words):
    look = look_at(write(tmp_path / "log.csv", made))
    assert any(words in line for line in look.doubts), look.doubts


def test_a_clean_log_is_not_doubted(tmp_path):
    t = np.arange(0.0, 2000.0, 2.0)
    pitch = -0.4 * np.sign(np.sin(t / 200))
    clean = {"time_s": t, "pitch_rad": pitch, "depth_m": 50 - np.cumsum(0.6 * np.sin(pitch)), "u_mps": 0.3 + 0 * t}
    assert look_at(write(tmp_path / "a.csv", clean)).doubts == ()
    assert look_at(write(tmp_path / "b.csv", turning())).doubts == ()
    rolling = clean | {"roll_rad": 0.3 * np.sin(t / 9)}
    assert look_at(write(tmp_path / "f.csv", rolling)).doubts == ()
    exchanged = rolling | {"roll_rad": rolling["pitch_rad"], "pitch_rad": rolling["roll_rad"]}
    (doubt,) = look_at(write(tmp_path / "g.csv", exchanged)).doubts
    assert doubt.startswith("roll_rad follows the depth rate, as a pitch does")
    clean |= {"pitch_rad": -pitch, "buoyancy_volume_cm3": 200.0 * np.sign(pitch)}
    doubts = " ".join(look_at(write(tmp_path / "c.csv", clean)).doubts)
    assert "pitch_rad is positive where depth grows" in doubts
    assert "volume" not in doubts
    clean |= {"pitch_rad": pitch, "buoyancy_volume_cm3": -200.0 * np.sign(pitch)}
    (doubt,) = look_at(write(tmp_path / "d.csv", clean)).doubts
    assert doubt.startswith("buoyancy_volume_m3 is larger where depth grows")
    assert doubt.endswith('turn one of them in a mapping, as in "-buoyancy_volume_m3".')
    # counted from the largest volume, as a Seaglider's is here: a mapping that turns it would move its neutral
    clean |= {"buoyancy_volume_cm3": -500.0 - 200.0 * np.sign(pitch)}
    (doubt,) = look_at(write(tmp_path / "e.csv", clean)).doubts
    assert doubt.startswith("buoyancy_volume_m3 is larger where depth grows")
    assert doubt.endswith("Change that sign in the file.")


def test_an_angle_that_wraps_in_no_channel_of_angles_is_named(tmp_path):
    yaw = (np.arange(100) * 10.0 + 180) % 360 - 180
    look = look_at(write(tmp_path / "log.csv", {"time_s": range(100), "depth_m": range(100), "swing_deg": yaw}))
    assert any(line.startswith("swing_deg: jumps by a whole turn 3 times") for line in look.doubts), look.doubts


@pytest.mark.parametrize(
    "heading, doubted",
    [
        (lambda t: 0.4 - 0.1 * t, False),  # two turns and a half to port from where it began
        (lambda t: 150.0 + 20.0 * np.sin(t / 20.0), True),  # it begins after 24 turns, or at 150 deg
        (lambda t: 2.0 * t, True),  # fifty turns
    ],
)
def test_a_heading_of_a_few_turns_is_not_taken_for_degrees(tmp_path, heading, doubted):
    t = np.arange(0.0, 160.0)
    doubts = look_at(write(tmp_path / "log.csv", {"time_s": t, "heading_rad": heading(t)})).doubts
    assert any('map it to "heading_deg"' in doubt for doubt in doubts) == doubted


def test_what_a_vehicle_uses_includes_what_its_channels_follow_from(tmp_path):
    water = {"Temp (degC)": T, "Cond (mS/cm)": T, "Sal (PSU)": T}
    look = look_at(write(tmp_path / "log.csv", {"time_s": T, "pressure_dbar": T, "rudder_cmd_rad": T, **water}))
    assert look.uses(Needs(("depth_m", "rudder_rad"))) == {"depth_m", "pressure_dbar", "rudder_cmd_rad"}
    assert look.uses(Needs((), ("density_kgpm3",))) >= {"temperature_C", "salinity_psu", "conductivity_Spm"}
    measured = look_at(write(tmp_path / "b.csv", {"time_s": T, "pressure_dbar": T, "depth_m": T}))
    assert measured.uses(Needs(("depth_m",))) == {"depth_m"}


def test_a_depth_that_jumps_and_returns_at_once_is_doubted(tmp_path):
    yo = 50.0 + 20.0 * np.abs(T % 80.0 - 40.0) / 40.0
    spiked = np.where((T == 60.0) | (T == 90.0), 99.9, yo)
    (doubt,) = look_at(write(tmp_path / "log.csv", {"time_s": T, "depth_m": spiked})).doubts
    assert doubt.startswith("depth_m has 2 readings that jump by up to 38.9 m and back (the first at 60 s).")
    assert look_at(write(tmp_path / "log.csv", {"time_s": T, "depth_m": yo})).doubts == ()


@pytest.mark.parametrize("form", ["Thr{} %", "Thr{} (%)", "Thruster{} [%]", "thruster_{}_pct", "Thruster {} (%)"])
def test_thrusters_in_percent_are_known_by_their_number(tmp_path, form):
    k = np.arange(40.0)
    columns = {"time_s": k, form.format(1): 40.0 * np.sin(k), form.format(2): 20.0 * np.cos(k)}
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    record = look_at(path).record
    assert record is not None
    assert record["t2_pct"] == pytest.approx(20.0 * np.cos(k))
    assert record.has("t1_pct")


@pytest.mark.parametrize(
    "column, channel",
    [
        ("Press_dbar", "pressure_dbar"),
        ("Northing (m)", "north_m"),
        ("Gyro X [deg/s]", "p_radps"),
        ("gyrz_radps", "r_radps"),
        ("Rud_deg", "rudder_rad"),
    ],
)
def test_a_common_name_with_its_unit_is_recognised(tmp_path, column, channel):
    path = tmp_path / "log.csv"
    path.write_text(f"time_s,{column}\n" + "".join(f"{k},{0.1 * k}\n" for k in range(40)))
    record = look_at(path).record
    assert record is not None
    assert record.has(channel)


def test_a_mapping_also_guesses_what_a_vehicle_can_use(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,Gyro X,DVL fwd\n" + "".join(f"{k},{0.1 * k},{0.2 * k}\n" for k in range(40)))
    text = mapping_text(look_at(path), [Needs((), ("p_radps", "u_dvl_mps"))])
    assert '# "Gyro X" = "p_radps"' in text
    assert '# "DVL fwd" = "u_dvl_mps"' in text
