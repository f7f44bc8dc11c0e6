"""The constants of a Seaglider by its operators' names: their units, and which of them a fit has freed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.vehicles.operators_constants import seaglider_constants
from scripts.real.constants import constants_of

STATED = {
    "sg_cal_mass": 54.5, "sg_cal_volmax": 53700.0, "sg_cal_vbdbias": 130.0, "sg_cal_rho0": 1027.5, "log_VBD_MIN": 600.0,
    "sg_cal_hd_a": 8.9e-4, "sg_cal_hd_b": 0.0224, "sg_cal_hd_c": 5.7e-6, "sg_cal_abs_compress": 1.5e-6,
    "log_VBD_MAX": 3960.0, "log_C_VBD": 2700.0, "log_VBD_CNV": -0.245296,
}  # fmt: skip


def diagnosis(*added, coefficients=()):
    """A diagnosis of a glider whose file states all constants but the thermal expansion."""
    values = seaglider_constants(STATED)
    plant = load_vehicle("seaglider")
    hull = replace(plant.parameters.hull, **{path.partition(".")[2]: value for path, value in values.items()})
    glider = replace(
        plant,
        parameters=replace(plant.parameters, hull=hull),
        notes={**plant.notes, **dict.fromkeys(values, "stated by p1.nc")},
    )
    return SimpleNamespace(given=SimpleNamespace(plant=glider), added=added, coefficients=coefficients)


def test_constants_have_the_operators_names_and_units():
    rows = {row["name"]: row for row in constants_of(diagnosis())}
    given = {name: row["given"] for name, row in rows.items()}
    assert given == pytest.approx(
        {
            "hd_a, 1/deg": 8.9e-4,
            "hd_b": 0.0224,
            "hd_c, 1/deg²": 5.7e-6,
            "volmax - vbdbias, cm³": 53570.0,
            "abs_compress, 1/dbar": 1.5e-6,
            "therm_expan, 1/K": 7.05e-5,
        }
    )
    assert [name for name, row in rows.items() if not row["stated"]] == ["therm_expan, 1/K"]
    assert {row["value"] for row in rows.values()} == {None}
    assert {row["ci95"] for row in rows.values()} == {None}


def test_what_the_fit_freed_has_its_value_and_interval():
    fitted = SimpleNamespace(path="hull.lift_1", value=np.degrees(1e-3), ci95=(np.degrees(8e-4), np.degrees(1.2e-3)))
    squeezed = SimpleNamespace(path="hull.compressibility", value=4e-10, ci95=(3e-10, 5e-10))
    found = diagnosis(
        SimpleNamespace(path="effects.volume.compressibility", coefficient=squeezed),
        SimpleNamespace(path="effects.volume.offset", coefficient=None, value=-4e-5, ci95=(-5e-5, -3e-5)),
        SimpleNamespace(path="effects.depth.lag", coefficient=None, value=3.0, ci95=(2.0, 4.0)),
        coefficients=(fitted,),
    )
    freed = {row["name"]: (row["value"], *row["ci95"]) for row in constants_of(found) if row["value"] is not None}
    assert list(freed) == ["hd_a, 1/deg", "volmax - vbdbias, cm³", "abs_compress, 1/dbar"]
    assert freed["hd_a, 1/deg"] == pytest.approx((1e-3, 8e-4, 1.2e-3))
    assert freed["volmax - vbdbias, cm³"] == pytest.approx((53530.0, 53520.0, 53540.0))
    assert freed["abs_compress, 1/dbar"] == pytest.approx((4e-6, 3e-6, 5e-6))
