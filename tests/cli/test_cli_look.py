"""The command `auv-gym look`: first contact with a log, its mapping and its picture."""

import numpy as np
import pytest

from auv_gym.cli import main


def write(path, columns):
    rows = zip(*columns.values())
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


@pytest.fixture
def log(tmp_path):
    t = np.arange(0.0, 400.0, 4.0)
    return write(
        tmp_path / "log.csv",
        {"time_s": t, "heading_deg": t % 360, "m_fin": np.round(0.2 * np.sin(t / 30), 4), "vacuum_inHg": t},
    )


def said(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_it_ends_with_a_command_that_works(log, tmp_path, capsys):
    assert main(["look", str(log), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert "100 samples every 4 s" in text
    assert "vacuum_inHg: left out, since its unit is not known" in text
    assert "slocum rudder_rad. `m_fin` looks like `rudder_rad`." in text
    names = tmp_path / "names.toml"
    assert text.endswith(f"Next: auv-gym look {log} --vehicle slocum --mapping-out names.toml")
    assert main(["look", str(log), "--vehicle", "slocum", "--mapping-out", str(names)]) == 0
    assert said(capsys).endswith(f"edit {names}, then auv-gym look {log} --vehicle slocum --mapping {names}")
    names.write_text(names.read_text().replace('# "m_fin"', '"m_fin"'))
    assert main(["look", str(log), "--vehicle", "slocum", "--mapping", str(names)]) == 0
    assert said(capsys).endswith(f"auv-gym diagnose {log} --vehicle slocum --mapping {names} --out diagnosis")


def test_a_log_with_the_command_alone_is_judged_as_a_diagnosis_reads_it(tmp_path, capsys):
    t = np.arange(0.0, 1200.0, 4.0)
    columns = {"time_s": t, "heading_deg": 90.0 + 20.0 * np.sin(t / 60.0), "rudder_cmd_deg": 5.0 * np.sin(t / 30.0)}
    path = write(tmp_path / "log.csv", columns)
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert "Looks wrong" not in text
    assert "slocum none 2 channels" in text
    assert text.endswith(f"Next: auv-gym diagnose {path} --vehicle slocum --out diagnosis")
    path = write(tmp_path / "still.csv", columns | {"rudder_cmd_deg": 0.0 * t})
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    assert "Nothing excites the vehicle: rudder_rad is constant at 0 rad" in said(capsys)


def test_it_says_which_values_a_diagnosis_takes_for_no_readings(tmp_path, capsys):
    t = np.arange(0.0, 1200.0, 4.0)
    heading = np.round(90.0 + 20.0 * np.sin(t / 60.0), 3)
    heading[1::2] = heading[::2]
    heading[100:102] += 170.0  # one value of the sensor, which writes every other row
    path = write(tmp_path / "log.csv", {"time_s": t, "heading_deg": heading, "rudder_deg": 5.0 * np.sin(t / 30.0)})
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert "heading_rad repeats the last value in many rows, as slower sensors do" in text
    assert "heading_rad has a single spike at 400 s, which is ignored." in text


def test_all_presets_are_compared_without_a_vehicle(log, capsys):
    assert main(["look", str(log)]) == 0
    text = said(capsys)
    assert "npsauv" in text
    assert "mermaid" in text


def test_a_range_has_the_digits_that_tell_its_ends_apart(tmp_path, capsys):
    t = np.arange(100.0)
    path = write(tmp_path / "log.csv", {"time_s": t, "density_kgpm3": 1027.71 + 1e-3 * t, "salinity_psu": 35.0 + 0 * t})
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert "1027.7 to 1027.8 kg/m3" in text
    assert "35 to 35 psu" in text


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_it_draws_a_picture(log, tmp_path, capsys, ending):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    picture = tmp_path / f"log.{ending}"
    assert main(["look", str(log), "--vehicle", "slocum", "--picture", str(picture)]) == 0
    assert picture.stat().st_size > 2000
    assert f"Written to {picture}" in said(capsys)


@pytest.mark.parametrize(
    "options, words",
    [
        (["--vehicle", "sloccum"], "Did you mean 'slocum'"),
        (["--picture", "log.gif"], "written as .png, .svg or .pdf"),
        (["--mapping", "none.toml"], "Cannot read the mapping"),
        (["--picture", "no/a.png"], "--picture names the folder no, which does not exist: create it first."),
        (["--mapping-out", "log.csv/names.toml"], "Cannot write into log.csv: it is a file. Give another folder."),
    ],
)
def test_bad_options_are_refused(log, tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    assert main(["look", str(log), *options]) == 1
    assert words in " ".join(capsys.readouterr().err.split())
    assert sorted(tmp_path.iterdir()) == before


def test_names_from_a_file_are_shown_as_they_are(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text("time_s,heading_deg,[bold]x[/bold]\n" + "".join(f"{k},{k},{k}\n" for k in range(9)))
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    assert "[bold]x[/bold]" in capsys.readouterr().out.replace("\n", "")


def test_a_log_of_very_many_samples_is_to_be_thinned(tmp_path, capsys):
    t = 4.0 * np.arange(10_000)
    path = write(tmp_path / "log.csv", {"time_s": t, "heading_deg": t % 360, "rudder_deg": 1e-3 * t})
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert f"auv-gym diagnose {path} --vehicle slocum --resample 10 --out diagnosis" in text
    assert text.endswith("(without --resample its 10,000 samples every 4 s take long)")


@pytest.mark.parametrize("count, step", [(10_000, 0.1), (6001, 4.0)])
def test_a_log_that_a_diagnosis_thins_by_itself_needs_no_option(tmp_path, capsys, count, step):
    """slocum has a step of 4 s: a log at 0.1 s is brought to it, and 6000 steps of 4 s are not thinned by 4 s."""
    t = np.round(step * np.arange(count), 1)
    path = write(tmp_path / "log.csv", {"time_s": t, "heading_deg": t % 360, "rudder_deg": 1e-3 * t})
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    assert said(capsys).endswith(f"auv-gym diagnose {path} --vehicle slocum --out diagnosis")


def glider_log(path, heading=np.radians, rudder=0.3):
    """A table of 200 samples of a glider that turns about north."""
    k = np.arange(200)
    columns = {
        "time_s": 4.0 * k,
        "heading_rad": heading(20.0 * np.sin(0.05 * k)),
        "rudder_rad": rudder * np.cos(0.3 * k),
    }
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def test_columns_without_a_unit_are_told_in_one_line(tmp_path, capsys):
    t = np.arange(0.0, 400.0, 4.0)
    more = dict.fromkeys(("alpha", "beta", "gamma", "delta", "epsilon"), t)
    log = write(tmp_path / "log.csv", {"time_s": t, "heading_deg": t % 360, "rudder_deg": 0.02 * t, **more})
    line = "5 columns left out, since their units are not known: alpha, beta, gamma, delta, ..."
    assert main(["look", str(log), "--vehicle", "slocum"]) == 0
    assert line in said(capsys)
    assert main(["look", str(log), "--vehicle", "slocum", "--all"]) == 0
    assert "epsilon: left out, since its unit is not known." in said(capsys)


def test_vehicles_that_fit_equally_well_are_left_to_the_reader(tmp_path, capsys):
    assert main(["look", str(glider_log(tmp_path / "log.csv"))]) == 0
    text = said(capsys)
    assert "--vehicle NAME --out diagnosis, where NAME is your vehicle: " in text
    assert text.endswith("ganeshblue or ganeshblue_corrected or slocum")


def test_with_a_vehicle_it_says_what_this_one_needs(tmp_path, capsys):
    log = glider_log(tmp_path / "log.csv")
    assert main(["look", str(log), "--vehicle", "seaglider"]) == 0
    text = said(capsys)
    assert f"Next: auv-gym look {log} (this compares the log with all vehicles; seaglider needs depth_m, " in text
    assert "buoyancy_volume_m3 and pitch_rad, which the log does not have. If another column holds one of them" in text
    assert "no preset" not in text


def test_of_vehicles_that_match_alike_none_is_chosen_for_a_mapping(log, capsys):
    assert main(["look", str(log)]) == 0
    text = said(capsys)
    assert f"Next: auv-gym look {log} --vehicle NAME --mapping-out names.toml, where NAME is your vehicle: " in text
    assert text.endswith("ganeshblue or ganeshblue_corrected or slocum")


def test_a_table_that_is_no_log_is_to_get_a_time(tmp_path, capsys):
    path = write(tmp_path / "curve.csv", {"command": (0, 1, 2), "thrust_N": (0, 5, 9)})
    assert main(["look", str(path)]) == 0
    text = said(capsys)
    assert "What is missing: There is no column time_s" in text
    assert text.endswith(f"(--mapping-out names.toml writes one), then auv-gym look {path}")


@pytest.mark.parametrize("time", [{}, {"time_s": np.full(50, 5.0)}])
def test_a_log_without_a_time_is_not_compared_with_vehicles(tmp_path, capsys, time):
    k = np.arange(50)
    path = write(tmp_path / "log.csv", time | {"heading_rad": 0.01 * k, "rudder_rad": 0.1 * np.sin(k)})
    assert main(["look", str(path)]) == 0
    text = said(capsys)
    assert "log.csv: a table in text, 50 rows" in text
    assert "missing channels" not in text
    assert "Next: write a column time_s (s) into the file" in text


def test_a_log_without_values_is_to_be_exported_again(tmp_path, capsys):
    k = np.arange(50)
    columns = {"time_s": k} | {f"{name}_rad": np.full(50, np.nan) for name in ("heading", "rudder", "pitch", "roll")}
    path = write(tmp_path / "log.csv", columns | {"depth_m": np.full(50, np.nan), "u_mps": np.full(50, np.nan)})
    assert main(["look", str(path)]) == 0
    text = said(capsys)
    assert "And 1 more. Its columns are empty" in text
    assert text.endswith("Next: export the log again, or use another one")


@pytest.mark.parametrize("seconds, said_so", [(50.0, True), (90.0, False)])
def test_a_log_shorter_than_a_minute_is_remarked(tmp_path, capsys, seconds, said_so):
    t = np.arange(0.0, seconds, 0.05)
    angles = {f"{name}_rad": 0.2 * np.sin(t / 3.0 + k) for k, name in enumerate(("roll", "pitch", "heading"))}
    shares = {f"t{k}_share": 0.3 * np.sin(t / 2.0 + k) for k in range(1, 9)}
    path = write(tmp_path / "log.csv", {"time_s": t} | angles | shares)
    assert main(["look", str(path), "--vehicle", "bluerov2_heavy"]) == 0
    text = said(capsys)
    assert ("- The log is only 50 s long. Below one minute" in text) is said_so
    assert f"Next: auv-gym diagnose {path}" in text


def test_several_logs_are_refused(log, capsys):
    assert main(["look", str(log), str(log)]) == 1
    assert "look takes one log, got 2" in capsys.readouterr().err


def test_a_set_point_is_not_offered_for_a_measurement(tmp_path, capsys):
    k = np.arange(50)
    columns = {"time_s": k, "heading_cmd_rad": 0.01 * k, "rudder_rad": 0.1 * np.sin(k)}
    assert main(["look", str(write(tmp_path / "log.csv", columns)), "--vehicle", "slocum"]) == 0
    assert "looks like `heading_rad`" not in said(capsys)


def test_signs_factors_and_constants_of_a_mapping_are_shown(log, tmp_path, capsys):
    names = tmp_path / "names.toml"
    names.write_text(
        'm_fin = "-rudder_rad"\nvacuum_inHg = { to = "depth_m", factor = 0.1 }\nspeed_cmd_mps = 1.5\n',
    )
    assert main(["look", str(log), "--mapping", str(names)]) == 0
    text = said(capsys)
    assert "m_fin -rudder_rad 1" in text
    assert "vacuum_inHg 0.1 x depth_m" in text
    assert "Constant, as a mapping or the file states: speed_cmd_mps = 1.5 m/s" in text


def test_a_mapping_that_names_no_column_is_to_be_corrected(log, tmp_path, capsys):
    names = tmp_path / "names.toml"
    names.write_text('Hdg = "heading_deg"\n')
    assert main(["look", str(log), "--mapping", str(names)]) == 0
    text = said(capsys)
    assert "What is wrong: The mapping names the column 'Hdg'" in text
    assert text.endswith(f"Next: correct {names} as it says above, then auv-gym look {log} --mapping {names}")


def test_a_density_profile_is_for_another_option(tmp_path, capsys):
    path = write(tmp_path / "ctd.csv", {"pressure_dbar": (1, 2, 3), "density_kgpm3": (1025, 1026, 1027)})
    assert main(["look", str(path)]) == 0
    assert f"Next: auv-gym diagnose LOG --vehicle NAME --profile {path} --out diagnosis (if this is" in said(capsys)


def test_dates_of_which_the_order_is_not_known_are_to_be_written_anew(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text("Date,Heading\n" + "".join(f"10/03/2024 08:00:0{k},{k}\n" for k in range(9)))
    for options in ([], ["--mapping", str(tmp_path / "names.toml")]):
        (tmp_path / "names.toml").write_text('Date = "time_s"\n')
        assert main(["look", str(path), *options]) == 0
        text = said(capsys)
        assert "which number is the day and which the month is not known. Write them with the year first" in text
        assert text.endswith(" ".join([f"as it says above, then auv-gym look {path}", *options]))


def test_times_with_and_without_a_zone_are_to_be_written_anew(tmp_path, capsys):
    path = tmp_path / "log.csv"
    rows = (f"2024-03-10T08:00:{k:02d}{'Z' * (k % 2)},{k}\n" for k in range(50))
    path.write_text("time,heading_deg\n" + "".join(rows))
    assert main(["look", str(path)]) == 0
    assert f"Next: write the dates in the file as it says above, then auv-gym look {path}" in said(capsys)


def test_a_log_with_too_few_windows_is_not_to_be_diagnosed_alone(tmp_path, capsys):
    for rows, step in ((39, 4.0), (200, 4000.0)):
        k = np.arange(rows)
        turns = {"heading_deg": 20.0 * np.sin(0.05 * k), "rudder_rad": 0.3 * np.cos(0.3 * k)}
        log = write(tmp_path / "log.csv", {"time_s": step * k, **turns})
        assert main(["look", str(log), "--vehicle", "slocum"]) == 0
        text = said(capsys)
        assert "Looks wrong - A diagnosis needs at least 4 windows of 120 s" in text
        if rows == 39:
            assert f"Next: auv-gym diagnose {log} MORE --vehicle slocum --out diagnosis, where MORE are other" in text
        else:
            assert "check that times are in seconds." in text
            assert "Next: first correct what looks wrong, since a diagnosis would refuse this log." in text


def test_a_log_that_begins_at_the_surface_is_to_be_cut_there(tmp_path, capsys):
    k = np.arange(400)
    turns = {"heading_deg": 20.0 * np.sin(0.05 * k), "rudder_rad": 0.3 * np.cos(0.3 * k)}
    for surfaced, option in ((20, "--min-depth 10 "), (0, "")):
        depth = np.where(k < surfaced, 0.5, 50.0)
        log = write(tmp_path / "log.csv", {"time_s": 4.0 * k, "depth_m": depth, **turns})
        assert main(["look", str(log), "--vehicle", "slocum"]) == 0
        text = said(capsys)
        assert f"Next: auv-gym diagnose {log} --vehicle slocum {option}--out diagnosis" in text
        assert ("--min-depth 10 leaves out the surface" in text) == bool(surfaced)


def test_a_kind_that_leaves_out_the_surface_by_itself_needs_no_cut(tmp_path, capsys):
    log = dive_log(tmp_path / "log.csv", depth_m=lambda c: np.where(c["time_s"] < 100.0, 0.5, c["depth_m"]))
    assert main(["look", str(log), "--vehicle", "seaglider"]) == 0
    assert said(capsys).endswith(f"Next: auv-gym diagnose {log} --vehicle seaglider --out diagnosis")


@pytest.mark.parametrize("still", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_a_vehicle_with_a_thruster_for_each_output_that_moves_comes_first(tmp_path, capsys, still):
    t = np.arange(0.0, 60.0, 0.05)
    moved = {f"t{k}_us": np.where(t // k % 2 == 0.0, 1400.0, 1600.0) for k in range(1, 9 - still)}
    rest = {f"t{k}_us": 1500.0 + 0.0 * t for k in range(9 - still, 9)}
    log = write(tmp_path / "log.csv", {"time_s": t, "heading_rad": 0 * t, "depth_m": t, **moved, **rest})
    assert main(["look", str(log)]) == 0
    text = said(capsys)
    if still:
        assert 0 < text.index(" bluerov none") < text.index(" bluerov2 none") < text.index(" bluerov2_heavy none")
        assert f"Next: auv-gym diagnose {log} --vehicle bluerov " in text
    else:
        assert 0 < text.index(" bluerov2_heavy none. In another unit: t1_us, ") < text.index(" bluerov none")
        assert text.endswith(f"Next: auv-gym look {log} --vehicle bluerov2_heavy --mapping-out names.toml")


def test_gaps_and_units_of_one_are_told_plainly(tmp_path, capsys):
    t = np.r_[np.arange(0.0, 400.0, 4.0), np.arange(800.0, 1200.0, 4.0)]
    log = write(tmp_path / "log.csv", {"time_s": t, "heading_deg": t % 360, "t1_share": 0.001 * t})
    assert main(["look", str(log), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert "200 samples every 4 s in 2 segments, 13.2 min, gaps not counted." in text
    assert "0 to 1.196 Rule" in text.replace("─", "")


def test_a_unit_that_looks_wrong_is_to_be_corrected_before_a_diagnosis(tmp_path, capsys):
    log = glider_log(tmp_path / "log.csv", rudder=20.0)
    assert main(["look", str(log), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert 'it looks like degrees: map it to "rudder_deg".' in text
    first, then = (
        f"auv-gym look {log} --mapping-out names.toml",
        "--vehicle slocum --mapping names.toml --out diagnosis",
    )
    assert text.endswith(f"Next: {first}, correct in it what looks wrong, then auv-gym diagnose {log} {then}")


def test_a_column_left_out_is_not_said_to_look_like_itself(tmp_path, capsys):
    log = glider_log(tmp_path / "log.csv")
    log.write_text(log.read_text().replace("rudder_rad", "heading_cmd_rad"))
    table = log.read_text().splitlines()
    log.write_text("\n".join([table[0] + ",rudder_rad", *(row + ",x" for row in table[1:])]))
    assert main(["look", str(log), "--vehicle", "slocum"]) == 0
    assert "`rudder_rad` looks like" not in said(capsys)


def dive_log(path, **changes):
    """A table of a glider's dive to 200 m and back, within the volumes of a Seaglider alone of all presets."""
    t = np.arange(0.0, 4000.0, 10.0)
    down = t < 2000.0
    columns = {
        "time_s": t,
        "depth_m": np.where(down, 10.0 + 0.1 * t, 410.0 - 0.1 * t),
        "pitch_rad": np.where(down, -0.4, 0.4),
        "roll_rad": 0.2 * np.sin(t / 70.0),
        "buoyancy_volume_m3": np.where(down, -7.5e-4, -1e-4),
    }
    return write(path, columns | {name: change(columns) for name, change in changes.items()})


def test_a_channel_that_a_vehicle_needs_costs_samples_as_in_a_diagnosis(tmp_path, capsys):
    path = tmp_path / "log.csv"
    glider_log(path)
    lines = path.read_text().splitlines()
    where = lines[0].split(",").index("rudder_rad")
    for row in range(len(lines) // 3, len(lines)):
        cells = lines[row].split(",")
        cells[where] = "NaN"
        lines[row] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    assert main(["look", str(path), "--vehicle", "slocum"]) == 0
    text = said(capsys)
    assert "nothing requires it" not in text
    assert "samples (67 %) were dropped, where rudder_rad had no value" in text
    assert "slocum none" in text
    assert main(["look", str(path)]) == 0
    assert "nothing requires it" not in said(capsys)


def test_a_vehicle_that_has_no_use_for_the_motion_in_a_log_comes_later(tmp_path, capsys):
    log = dive_log(tmp_path / "log.csv", heading_rad=lambda c: 0.001 * c["time_s"])
    log.write_text(log.read_text().replace("buoyancy_volume_m3", "oil volume (m3)"))
    assert main(["look", str(log)]) == 0
    text = said(capsys)
    assert text.index(" seaglider buoyancy_volume_m3. `oil volume (m3)`") < text.index(" mermaid none 2 channels")
    assert text.endswith("where NAME is your vehicle: seaexplorer or seaglider or slocum_flight")
    float_log = write(tmp_path / "float.csv", {"time_s": (0, 9, 18), "depth_m": (1, 2, 4), "oil_volume_m3": (1, 2, 1)})
    assert main(["look", str(float_log)]) == 0
    text = said(capsys)
    assert text.index(" mermaid none 2 channels") < text.index(" seaglider buoyancy_volume_m3")


def test_channels_that_are_only_kept_are_marked_and_rules_numbered_as_in_the_docs(log, tmp_path, capsys):
    table = log.read_text().splitlines()
    others = "STW (kn),Prop (RPM),Temp (degC)"
    log.write_text("\n".join([f"{table[0]},{others}", *(f"{row},{k},{k},9" for k, row in enumerate(table[1:]))]))
    names = tmp_path / "names.toml"
    names.write_text('m_fin = "rudder_rad"\n')
    assert main(["look", str(log), "--vehicle", "slocum", "--mapping", str(names)]) == 0
    text = said(capsys)
    assert "m_fin rudder_rad 1 100" in text
    assert "heading_deg heading_rad 3 100" in text
    assert "STW (kn) stw_mps * 3 100" in text
    assert "Temp (degC) temperature_C * 3 100" in text
    assert "Rule 1: your mapping (1 column) Rule 3: " in text
    assert "* Kept in the record, but not an input or output of slocum." in text
    assert main(["look", str(log), "--mapping", str(names)]) == 0
    text = said(capsys)
    assert "Prop (RPM) propeller_rpm 3 100" in text  # of an AUV
    assert "STW (kn) stw_mps * 3 100" in text


def test_a_log_that_spikes_cut_is_not_to_be_diagnosed_with_others(tmp_path, capsys):
    log = dive_log(tmp_path / "log.csv", depth_m=lambda c: c["depth_m"] + 90.0 * (c["time_s"] % 90.0 == 80.0))
    assert main(["look", str(log), "--vehicle", "seaglider"]) == 0
    text = said(capsys)
    assert "Looks wrong - depth_m has 44 readings that jump by up to 89 m and back (the first at 80 s)." in text
    assert "Next: first correct what looks wrong, since a diagnosis would refuse this log." in text


def test_vehicles_that_would_refuse_the_log_are_not_named(tmp_path, capsys):
    log = dive_log(tmp_path / "log.csv")
    assert main(["look", str(log)]) == 0
    assert said(capsys).endswith(f"Next: auv-gym diagnose {log} --vehicle seaglider --out diagnosis")


def test_a_log_that_a_diagnosis_would_refuse_is_to_be_corrected_first(tmp_path, capsys):
    log = glider_log(tmp_path / "log.csv", rudder=0.0)
    for options in ([], ["--vehicle", "slocum"]):
        assert main(["look", str(log), *options]) == 0
        text = said(capsys)
        assert "Nothing excites the vehicle: rudder_rad is constant at 0 rad" in text
        assert "Next: first correct what looks wrong, since a diagnosis would refuse this log." in text
        assert "auv-gym diagnose" not in text
    turned = dive_log(tmp_path / "turned.csv", pitch_rad=lambda columns: -columns["pitch_rad"])
    assert main(["look", str(turned), "--vehicle", "seaglider"]) == 0
    text = said(capsys)
    assert "in inflections and stalls. Check signs and units of depth, pitch" in text
    assert f"auv-gym look {turned} --vehicle seaglider --mapping names.toml. Otherwise change the file" in text


def test_pitch_and_roll_that_look_exchanged_are_to_be_corrected_first(tmp_path, capsys):
    log = dive_log(tmp_path / "log.csv", pitch_rad=lambda c: c["roll_rad"], roll_rad=lambda c: c["pitch_rad"])
    assert main(["look", str(log), "--vehicle", "seaglider"]) == 0
    text = said(capsys)
    assert "they look exchanged. Exchange them in a mapping." in text
    assert "of the log is left out, since seaglider does not describe it" in text
    assert "--mapping-out names.toml, correct in it what looks wrong, then auv-gym look" in text
    names = tmp_path / "names.toml"
    names.write_text('pitch_rad = "roll_rad"\nroll_rad = "pitch_rad"\n')
    assert main(["look", str(log), "--vehicle", "seaglider", "--mapping", str(names)]) == 0
    assert "Looks wrong" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "vehicle, ending, values, factor, offset",
    [("bluerov2", "us", (1100.0, 1900.0), 0.0025, -3.75), ("bluerov", "share", (-1.0, 1.0), 400.0, 1500.0)],
)
def test_thruster_commands_in_another_unit_are_converted_by_the_mapping(
    tmp_path, capsys, vehicle, ending, values, factor, offset
):
    t = np.arange(0.0, 60.0, 0.05)
    made = {f"t{k}_{ending}": np.where(t // k % 2 == 0.0, *values) for k in range(1, 7)}
    log, names = (
        write(tmp_path / "log.csv", {"time_s": t, "heading_rad": 0 * t, "depth_m": 20.0 + t, **made}),
        "names.toml",
    )
    assert main(["look", str(log), "--vehicle", vehicle]) == 0
    text = said(capsys)
    assert f"In another unit: t1_{ending}, " in text
    assert text.endswith(f"Next: auv-gym look {log} --vehicle {vehicle} --mapping-out {names}")
    names = tmp_path / names
    assert main(["look", str(log), "--vehicle", vehicle, "--mapping-out", str(names)]) == 0
    assert (
        f"check in {names} that each output drives the thruster of its number, in its direction, then auv-gym look"
        in said(capsys)
    )
    other = "share" if ending == "us" else "us"
    line = f'"t6_{ending}" = {{ to = "t6_{other}", factor = {factor!r}, offset = {offset!r} }}'
    assert line in names.read_text().splitlines()
    assert main(["look", str(log), "--vehicle", vehicle, "--mapping", str(names)]) == 0
    text = said(capsys)
    assert "Looks wrong" not in text
    assert text.endswith(f"auv-gym diagnose {log} --vehicle {vehicle} --mapping {names} --out diagnosis")
