import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.records.reading import read_record
from auv_gym.records.slocum import LOGS, bundled_slocum_log, glide_speed, read_slocum

needs_dbdreader = pytest.mark.skipif(
    importlib.util.find_spec("dbdreader") is None, reason="the extra `slocum` is absent"
)


@pytest.fixture(scope="module")
def ammonite():
    return read_slocum(bundled_slocum_log("ammonite"))


@needs_dbdreader
def test_ammonite_is_read_whole(ammonite):
    assert set(ammonite.names) == {
        "heading_rad", "pitch_rad", "roll_rad", "depth_m", "rudder_rad", "heading_cmd_rad", "rudder_cmd_rad", "u_mps",
    }  # fmt: skip
    assert len(ammonite) == 1531
    assert ammonite.sample_interval == pytest.approx(4.0, abs=0.01)
    assert ammonite.duration_s == pytest.approx(1.8 * 3600, rel=0.05)
    assert ammonite["depth_m"].max() == pytest.approx(608, abs=1)
    assert ammonite.attrs["start_epoch_s"] == pytest.approx(1201598347.6, abs=0.1)  # 29 January 2008, 09:19 UTC
    assert np.abs(np.diff(ammonite["heading_rad"])).max() < np.pi


@needs_dbdreader
def test_the_row_of_before_the_log_is_gone(ammonite):
    assert np.diff(ammonite.time).max() < 20.0  # the old row lies 25 s before the first cycle
    assert ammonite.time[0] == 0.0


@needs_dbdreader
def test_the_rudder_leads_the_yaw_rate_in_ammonite(ammonite):
    deep = ammonite.select(ammonite["depth_m"] > 10)
    rate = np.diff(deep["heading_rad"]) / np.diff(deep.time)
    assert np.corrcoef(rate, deep["rudder_rad"][:-1])[0, 1] > 0.9


@needs_dbdreader
def test_speed_is_plausible_and_says_that_it_is_derived(ammonite):
    speed = ammonite.select(ammonite["depth_m"] > 10)["u_mps"]
    assert 0.3 < np.median(speed) < 0.7
    assert "depth rate" in ammonite.attrs["derived"]


@given(speed=st.floats(0.1, 0.9), slope=st.floats(0.2, 0.6))
def test_glide_speed_finds_the_speed_of_a_made_dive(speed, slope):
    t = np.arange(0, 2000, 4.0)
    pitch = np.where(t < 1000, -slope, slope)
    depth = 5 + np.concatenate([[0], np.cumsum(-speed * np.sin(pitch[:-1]) * 4.0)])
    found = glide_speed(t, depth, pitch)
    assert found is not None
    away = np.abs(t - 1000) > 20  # the 30 s around the inflexion mix both slopes
    assert found[away] == pytest.approx(speed, rel=1e-6)
    assert np.all((found >= 0.05) & (found <= 1.0))


def test_glide_speed_is_none_where_nothing_glides():
    t = np.arange(0, 400, 4.0)
    assert glide_speed(t, np.zeros(100), np.zeros(100)) is None
    assert glide_speed(t, np.full(100, np.nan), np.full(100, 0.4)) is None


@needs_dbdreader
def test_reading_by_name(ammonite):
    r = read_record("slocum:ammonite", required=["heading_rad", "rudder_rad"])
    assert np.array_equal(r["heading_rad"], ammonite["heading_rad"])
    with pytest.raises(ValueError, match=r"no log 'amonite'\. Did you mean 'ammonite'"):
        read_record("slocum:amonite")
    with pytest.raises(ValueError, match="leave it out"):
        read_record("slocum:ammonite", {"m_fin": "rudder_rad"})


@needs_dbdreader
@pytest.mark.parametrize("name", ["amadeus", "sebastian"])
def test_logs_that_need_a_sensor_list(name, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    if not (bundled_slocum_log(name).parent / "cac" / "468fd1be.cac").is_file():
        with pytest.raises(ValueError, match=r"needs the sensor list 468fd1be\.cac.*cache_dir.*pip download"):
            read_slocum(bundled_slocum_log(name))
    else:
        r = read_slocum(bundled_slocum_log(name))
        assert r.duration_s == pytest.approx(70 * 60, rel=0.1)
        assert 30 < r["depth_m"].max() < 45


@needs_dbdreader
def test_nothing_is_written_outside_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    before = sorted(bundled_slocum_log("ammonite").parent.rglob("*"))
    read_slocum(bundled_slocum_log("ammonite"))
    assert list(tmp_path.iterdir()) == []
    assert sorted(bundled_slocum_log("ammonite").parent.rglob("*")) == before


@needs_dbdreader
@pytest.mark.parametrize("cut", [0, 5, 300, 5_000, 62_000, 84_500, 100_001, 200_000, 313_620])
def test_a_log_that_is_cut_short_is_refused(tmp_path, cut):
    path = tmp_path / "cut.mbd"
    path.write_bytes(bundled_slocum_log("ammonite").read_bytes()[:cut])
    with pytest.raises(ValueError, match=r"cut short|no Slocum log|damaged") as caught:
        read_slocum(path)
    assert str(path) in str(caught.value)


@needs_dbdreader
@pytest.mark.parametrize("where", [150_000, 250_000])
def test_a_log_with_damage_inside_is_refused(tmp_path, where):
    whole = bytearray(bundled_slocum_log("ammonite").read_bytes())
    whole[where : where + 400] = np.random.default_rng(3).bytes(400)
    path = tmp_path / "bad.mbd"
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=r"is damaged in its cycle|is cut short in its cycle"):
        read_slocum(path)


@needs_dbdreader
@pytest.mark.parametrize("shipped, message", [("02450137.tcd", "decompress"), ("01600000.ecd", "flight log")])
def test_compressed_logs_are_opened(shipped, message):
    path = bundled_slocum_log("ammonite").parent / shipped
    if not path.is_file():
        pytest.skip(f"this dbdreader lacks {shipped}")
    with pytest.raises(ValueError, match=rf"{message}|sensor list"):
        read_slocum(path)


@needs_dbdreader
def test_paths_that_do_not_fit(tmp_path):
    with pytest.raises(ValueError, match="There is no file"):
        read_slocum(tmp_path / "none.dbd")
    with pytest.raises(ValueError, match="There is no folder"):
        read_slocum(bundled_slocum_log("ammonite"), cache_dir=tmp_path / "none")
    (tmp_path / "text.dbd").write_text("time_s,depth_m\n")
    with pytest.raises(ValueError, match="is no Slocum log"):
        read_record(tmp_path / "text.dbd")


def test_without_dbdreader_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install auv-gym\[slocum\]"):
        bundled_slocum_log("ammonite")
    (tmp_path / "x.dbd").write_bytes(b"dbd_label")
    with pytest.raises(ValueError, match=r"pip install auv-gym\[slocum\]"):
        read_slocum(tmp_path / "x.dbd")


@needs_dbdreader
def test_dbdreader_is_not_imported_here(ammonite):
    assert len(ammonite) > 0
    read = "from auv_gym.records import slocum; import sys; slocum.read_slocum(slocum.bundled_slocum_log('ammonite'))"
    done = subprocess.run(
        [sys.executable, "-c", read + "; print('dbdreader' in sys.modules)"], capture_output=True, text=True
    )
    assert done.stdout.strip() == "False", done.stderr
    assert all(Path(name).suffix in (".mbd", ".dbd") for name in LOGS.values())
