"""Depth, density and salinity of sea water by TEOS-10, computed by the package gsw (the extra `seawater`).

Without it, or without a latitude, `auv_gym.channels.depth_from_pressure` gives the depth within 0.3 %.
Source: IOC, SCOR and IAPSO 2010, The international thermodynamic equation of seawater - 2010, Manuals and Guides 56.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.extra import how_to_install


def depth(pressure: np.ndarray | float, latitude: np.ndarray | float) -> np.ndarray:
    """Depth, m, positive down, of a sea pressure, dbar, at a latitude, deg."""
    return -np.asarray(_gsw().z_from_p(pressure, latitude), dtype=float)


def pressure(depth: np.ndarray | float, latitude: np.ndarray | float) -> np.ndarray:
    """Sea pressure, dbar, at a depth, m, positive down, at a latitude, deg."""
    return np.asarray(_gsw().p_from_z(-np.asarray(depth, dtype=float), latitude), dtype=float)


def density(
    salinity: np.ndarray | float,
    temperature: np.ndarray | float,
    pressure: np.ndarray | float,
    latitude: np.ndarray | float | None = None,
    longitude: np.ndarray | float | None = None,
) -> np.ndarray:
    """In-situ density, kg/m3.

    salinity: practical.  temperature: in situ, degC.  pressure: sea pressure, dbar.  latitude, longitude: deg; without
    them, the composition of reference sea water is assumed, with an error of up to 0.02 kg/m3 in the open ocean.
    """
    gsw = _gsw()
    if latitude is None or longitude is None:
        absolute = gsw.SR_from_SP(salinity)
    else:
        absolute = gsw.SA_from_SP(salinity, pressure, longitude, latitude)
    return np.asarray(gsw.rho(absolute, gsw.CT_from_t(absolute, temperature, pressure), pressure), dtype=float)


def practical_salinity(
    conductivity: np.ndarray | float, temperature: np.ndarray | float, pressure: np.ndarray | float
) -> np.ndarray:
    """Practical salinity from conductivity, S/m, in-situ temperature, degC, and sea pressure, dbar."""
    return np.asarray(
        _gsw().SP_from_C(10.0 * np.asarray(conductivity, dtype=float), temperature, pressure), dtype=float
    )


def _gsw() -> Any:
    try:
        import gsw
    except ImportError as error:
        raise ValueError(
            "Depth, density and salinity of sea water need the package gsw, which is not installed; "
            f"{how_to_install('seawater')}."
        ) from error
    return gsw
