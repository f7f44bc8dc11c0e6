import numpy as np
import pytest

from auv_gym.channels import depth_from_pressure
from auv_gym.records import seawater
from auv_gym.records.attitude import QUATERNION, QUATERNION_ENU_FLU
from auv_gym.records.completing import completed, hydrography
from auv_gym.records.streams import Stream

T = np.arange(5.0)


def stream(**values):
    return Stream(T, {name: np.broadcast_to(np.asarray(v, dtype=float), T.shape) for name, v in values.items()})


def complete(*streams, **constants):
    notes = []
    found, derived = completed(streams, constants, notes)
    return {name: values for s in found for name, values in s.values.items()}, derived, notes


def test_magnetic_headings_become_true_by_a_stated_or_logged_variation():
    stated, derived, notes = complete(stream(heading_magnetic_rad=1.0), magnetic_variation_rad=0.1)
    assert stated["heading_rad"] == pytest.approx(1.1)
    assert "stated variation of 5.7 deg" in derived["heading_rad"]
    logged, derived, _ = complete(stream(heading_magnetic_rad=1.0, magnetic_variation_rad=[0.1, 0.1, np.nan, 0.2, 0.2]))
    assert logged["heading_rad"] == pytest.approx([1.1, 1.1, 1.15, 1.2, 1.2])
    assert "logged variation" in derived["heading_rad"]
    assert notes == []


def test_without_a_variation_the_heading_is_said_to_be_magnetic():
    values, derived, notes = complete(stream(heading_magnetic_rad=1.0))
    assert values["heading_rad"] == pytest.approx(1.0)
    assert derived["heading_rad"] == "the magnetic heading, uncorrected"
    assert "magnetic_variation_deg = " in notes[0]


def test_what_was_measured_is_not_replaced():
    q = dict(zip(QUATERNION, (1.0, 0.0, 0.0, 0.0)))
    values, derived, _ = complete(stream(heading_rad=2.0, depth_m=7.0, pressure_dbar=100.0, **q))
    assert values["heading_rad"] == pytest.approx(2.0)
    assert values["depth_m"] == pytest.approx(7.0)
    assert set(derived) == {"roll_rad", "pitch_rad"}


def test_ros_attitudes_become_ours_and_give_the_angles():
    values, derived, _ = complete(stream(**dict(zip(QUATERNION_ENU_FLU, (1.0, 0.0, 0.0, 0.0)))))
    assert np.degrees(values["heading_rad"]) == pytest.approx(90.0)
    assert set(QUATERNION) <= set(values)
    assert not set(QUATERNION_ENU_FLU) & set(values)
    assert "ENU" in derived["attitude"]


def test_depth_follows_from_pressure_with_the_latitude_that_is_known():
    pytest.importorskip("gsw", reason="the extra `seawater` is not installed")
    plain, derived, _ = complete(stream(pressure_dbar=1000.0))
    assert plain["depth_m"] == pytest.approx(float(depth_from_pressure(1000.0)))
    assert "45 deg" in derived["depth_m"]
    polar, derived, _ = complete(stream(pressure_dbar=1000.0), stream(latitude_rad=np.radians(70.0)))
    assert polar["depth_m"] == pytest.approx(float(seawater.depth(1000.0, 70.0)))
    assert derived["depth_m"] == "pressure of sea water at 70.0 deg of latitude, TEOS-10"
    assert polar["depth_m"][0] < plain["depth_m"][0] - 1.0  # gravity is stronger there


def test_without_gsw_depth_is_that_of_middle_latitudes_and_says_so(monkeypatch):
    def absent(*_):
        raise ValueError("gsw is not installed")

    monkeypatch.setattr(seawater, "depth", absent)
    monkeypatch.setattr(seawater, "density", absent)
    notes = []
    ctd = stream(pressure_dbar=1000.0, salinity_psu=35.0, temperature_C=10.0)
    values, derived, _ = complete(ctd, latitude_rad=1.0)
    assert values["depth_m"] == pytest.approx(float(depth_from_pressure(1000.0)))
    assert "the extra seawater does better" in derived["depth_m"]
    assert hydrography(values, [ctd], {}, notes) == {}
    assert len(notes) == 1
    assert "in the clone of auv-gym: pip install '.[seawater]'" in notes[0]
    assert hydrography(complete(stream(pressure_dbar=1000.0))[0], [ctd], {}, notes) == {}
    assert len(notes) == 1  # nothing that it could be worked out from


def test_density_follows_from_a_ctd():
    pytest.importorskip("gsw", reason="the extra `seawater` is not installed")
    ctd = {name: np.full(3, value) for name, value in CTD.items()}
    found = hydrography(ctd, [], {}, [])
    salinity = seawater.practical_salinity(4.0, 10.0, 500.0)
    assert found["salinity_psu"] == pytest.approx(float(salinity))
    assert found["density_kgpm3"] == pytest.approx(float(seawater.density(salinity, 10.0, 500.0, None, None)))
    baltic = {"latitude_rad": np.radians(60.0), "longitude_rad": np.radians(20.0)}
    placed = hydrography(ctd, [], baltic, [])
    assert placed["density_kgpm3"][0] != found["density_kgpm3"][0]
    assert hydrography({**ctd, "salinity_psu": np.full(3, 35.0), "density_kgpm3": np.full(3, 1030.0)}, [], {}, []) == {}


def test_where_pressure_was_not_logged_it_is_that_of_the_depth():
    pytest.importorskip("gsw", reason="the extra `seawater` is not installed")
    ctd = {name: np.full(3, value) for name, value in CTD.items()}
    place = {"latitude_rad": np.radians(60.0)}
    deep = {**ctd, "depth_m": seawater.depth(ctd.pop("pressure_dbar"), 60.0)}
    without = {name: values for name, values in deep.items() if name != "pressure_dbar"}
    for name, values in hydrography(without, [], place, []).items():
        np.testing.assert_allclose(values, hydrography(deep, [], place, [])[name], rtol=1e-9)
    salinity = {**without, "salinity_psu": np.full(3, 35.0)}
    found = hydrography(salinity, [], {}, [])
    assert list(found) == ["density_kgpm3"]
    shallow = hydrography({**salinity, "depth_m": np.zeros(3)}, [], {}, [])
    assert found["density_kgpm3"][0] - shallow["density_kgpm3"][0] == pytest.approx(2.2, abs=0.1)  # kg/m3, of 500 dbar


CTD = {"conductivity_Spm": 4.0, "temperature_C": 10.0, "pressure_dbar": 500.0}
