"""Depth, density and salinity of sea water against the check values published with TEOS-10."""

import sys

import numpy as np
import pytest

from auv_gym.channels import depth_from_pressure
from auv_gym.records import seawater

# The example that the pages of the GSW functions share (www.teos-10.org/pubs/gsw/html), with their check values.
PRESSURE = np.array([10.0, 50.0, 125.0, 250.0, 600.0, 1000.0])
TEMPERATURE = np.array([28.7856, 28.4329, 22.8103, 10.2600, 6.8863, 4.4036])
SALINITY = np.array([34.5487, 34.7275, 34.8605, 34.6810, 34.5680, 34.5600])
LATITUDE, LONGITUDE = 4.0, 188.0
DEPTHS = [9.9445834469453, 49.7180897012550, 124.2726219409978, 248.4700576548589, 595.8253480356214, 992.0919060719987]
DENSITIES = [1021.839935738108, 1022.262457966867, 1024.427195413316, 1027.790152759127, 1029.837779000189,
             1032.002453224572]  # fmt: skip
SALINITIES = [20.009869599086951, 20.265511864874270, 22.981513062527689, 31.204503263727982, 34.032315787432829,
              36.400308494388170]  # fmt: skip


def test_depth_has_the_published_values():
    pytest.importorskip("gsw")
    assert seawater.depth(PRESSURE, LATITUDE) == pytest.approx(DEPTHS, abs=1e-8)


def test_density_has_the_published_values():
    pytest.importorskip("gsw")
    found = seawater.density(SALINITY, TEMPERATURE, PRESSURE, LATITUDE, LONGITUDE)
    # theirs begin with absolute salinity and conservative temperature rounded to 1e-4, worth 1e-4 kg/m3
    assert found == pytest.approx(DENSITIES, abs=2e-4)
    assert seawater.density(SALINITY, TEMPERATURE, PRESSURE) == pytest.approx(DENSITIES, abs=0.02)


def test_salinity_has_the_published_values():
    pytest.importorskip("gsw")
    conductivity = 0.1 * SALINITY  # their example uses these numbers as mS/cm
    assert seawater.practical_salinity(conductivity, TEMPERATURE, PRESSURE) == pytest.approx(SALINITIES, abs=1e-9)


def test_the_fallback_for_depth_agrees_as_far_as_it_says():
    pytest.importorskip("gsw")
    pressure = np.array([10.0, 100.0, 1000.0, 6000.0])
    # at 45 degrees what remains is Saunders' parabola, fitted to within 0.3 m down to 10 km
    assert depth_from_pressure(pressure) == pytest.approx(seawater.depth(pressure, 45.0), abs=0.3, rel=5e-4)
    for latitude in (0.0, 90.0):  # "within 0.3 %", rounded
        assert depth_from_pressure(pressure) == pytest.approx(seawater.depth(pressure, latitude), rel=3.1e-3)


def test_missing_values_stay_missing():
    pytest.importorskip("gsw")
    assert np.isnan(seawater.density([35.0, np.nan], [5.0, 5.0], [100.0, 100.0], 60.0, -8.0)).tolist() == [False, True]
    assert np.isnan(seawater.depth([np.nan, 10.0], 60.0)).tolist() == [True, False]


def test_without_gsw_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "gsw", None)
    for ask in (
        lambda: seawater.depth(10.0, 45.0),
        lambda: seawater.density(35.0, 5.0, 10.0),
        lambda: seawater.practical_salinity(4.0, 10.0, 10.0),
    ):
        with pytest.raises(ValueError, match=r"gsw, which is not installed; .*: pip install '\.\[seawater\]'"):
            ask()
