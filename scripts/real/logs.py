"""The measured logs that `python -m scripts.real_logs` diagnoses, where they come from, and what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from scripts.real.dives import diagnose_dives, diagnose_flight, diagnose_steered, dive_of
from scripts.real.log import Log
from scripts.real.tank import diagnose_run

_SLOCUM = "the package `dbdreader` ships it (L. Merckelbach)"
_NO_HEADING = "nobody has published a model of this glider's heading"
_SHIPPED = (
    ("ammonite", f"Slocum, Mediterranean, January 2008, one dive to 608 m; {_SLOCUM}", None),
    ("amadeus", f"Slocum, German Bight, July 2014, 70 min of yos to 40 m; {_SLOCUM}", 240.0),
    ("sebastian", f"Slocum, German Bight, July 2014, 70 min of yos to 40 m; {_SLOCUM}", 240.0),
)
_FLOAT = "float P0051 of the project MERMAID, 2020; from `oseanfro/automaid`"
_PUMP = "the pump's rate, to about 2 % (the makers); how much oil the bypass and the valve let in is not known"
_DRIFT, _PROFILES = "mermaid/free_drift_dives.csv", "mermaid/ctd_profiles_1dbar.csv"
_BLUEROV = (
    "BlueROV of 2016, six T200 thrusters, telegraph signals in open loop; from `MrEkelund/ExjobbROV`, a master's thesis"
)
_THESIS = (
    "estimates of the thesis: linear damping in roll 0.9 to 2.6 and in yaw 1.0 to 2.9 kg m^2/s, centre of buoyancy 1.1 "
    "to 6.1 cm up; thruster 6 hardly rolls the vehicle, and a model without its lever arm fits better; the attitude of "
    "the on-board filter does not agree with the gyros"
)
_FITS = {"roll rate": 100.0 - 40.27, "pitch rate": 100.0 - 43.96, "yaw rate": 100.0 - 58.09}
_THEIRS = "the thesis, on its validation log: 15 s from one fitted start"
_TANK = "BlueROV2 Heavy in a tank under motion capture, 27 May 2025; from `SAABmarine-MEX/saabmarineMEX_learning`"
_BENZON = (
    "coefficients of von Benzon et al. (2022) for a vehicle of this type, which are the preset; a tether is attached"
)
# SEA035.10.gli.sub, which has no number, is a copy of .014
_MISSION = tuple(f"seaexplorer/SEA035.10.gli.sub.{k:03d}" for k in range(1, 49))
_OPERATORS = "the operators' hydrodynamic model (`vert_speed` in the files); its constants may come from these dives"


def _bag(name: str, *signals: str, rivals: bool = True, source: str = _BLUEROV) -> Log:
    """A log of the BlueROV of 2016, at about the rate of its thruster commands."""
    return Log(
        f"BlueROV, {name.split('_2016')[0]}",
        "bluerov",
        (f"bluerov2016/{name}.bag",),
        source,
        _THESIS,
        step=0.05,
        horizons=(2.0, 3.0),
        signals=signals,
        rivals=_FITS if rivals else {},
        rival=_THEIRS if rivals else "",
    )


def _dives(glider: str, names: Sequence[str], source: str, known: str) -> list[Log]:
    """Logs with every other dive fitted and the rest judged, and the reverse."""
    files = [f"seaglider/{name}" for name in names]
    halves = tuple(files[0::2]), tuple(files[1::2])
    return [
        Log(
            f"{glider}, {', '.join(map(dive_of, fitted))} on {', '.join(map(dive_of, judged))}",
            "seaglider",
            fitted,
            source,
            known,
            judged=judged,
            least_depth=30.0,
            rival=_OPERATORS,
            run=diagnose_dives,
        )
        for fitted, judged in (halves, halves[::-1])
    ]


def _tank(fitted: str, judged: str) -> Log:
    """One run of the BlueROV2 Heavy fitted, and the other judged."""
    return Log(
        f"BlueROV2 Heavy, {fitted} on {judged}",
        "bluerov2_heavy",
        ("bluerov2_heavy/bluerov2_mocap_2runs.csv",),
        _TANK,
        _BENZON,
        horizons=(3.0, 10.0),
        signals=("u_mps", "v_mps", "w_mps"),
        rival="the preset as given",
        run=partial(diagnose_run, fitted=fitted, judged=judged),
    )


LOGS = (
    *(Log(f"slocum:{n}", "slocum", (f"slocum:{n}",), told, _NO_HEADING, least_depth=10.0) for n, told, _ in _SHIPPED),
    *(
        Log(
            f"slocum:{name}, flight",
            "slocum_flight",
            (f"slocum:{name}",),
            told,
            "the polar of Merckelbach et al. (2010); this glider's mass and volume are not known",
            least_depth=10.0,
            window=window,
            signals=("depth_m",),
            rival="`gliderflight` 1.2.1, calibrated on the other parts",
            run=diagnose_flight,
        )
        for name, told, window in _SHIPPED
    ),
    Log("MERMAID, free drift", "mermaid", (_DRIFT,), f"{_FLOAT}; nine dives to 2000 m", _PUMP),
    Log(
        "MERMAID, free drift, density known",
        "mermaid",
        (_DRIFT,),
        "the same dives, with the density that the float's CTD measured",
        _PUMP,
        profile=_PROFILES,
    ),
    Log(
        "MERMAID, fixed point",
        "mermaid",
        ("mermaid/fixed_point_february_dives.csv",),
        f"{_FLOAT}; twelve dives to 73 m",
        f"its GPS position is the same for days, so a line probably holds it; {_PUMP}",
    ),
    Log(
        "VT 690",
        "vt690",
        ("auv690/auv690_2022-07-28_part1_10Hz.csv",),
        "torpedo of 2.2 m near the surface, 28 July 2022; from `ECE-MDE/AUV-Fault-Detection`",
        "the operators' model, from CFD and a towing tank, is the preset; a regression of its Doppler log gives a "
        "current of 0.2 m/s to the east",
        least_depth=1.5,
        signals=("heading_rad", "depth_m"),
    ),
    _bag("pitch_roll_1_2016-04-18-13-11-33", "p_radps", "q_radps"),
    _bag("test1_roll_pitch_2016-04-04-15-11-53", "p_radps", "q_radps"),
    _bag("yaw_1_2016-04-18-13-44-26", "r_radps"),
    _bag("test1_t1_lock_t2_2016-04-04-14-24-09", "p_radps", "q_radps", "r_radps"),
    _bag(
        "sinDepthA03F01_2016-05-25-09-38-17",
        "p_radps",
        "q_radps",
        "r_radps",
        rivals=False,
        source="the same vehicle; its depth follows a sine, and controllers hold the attitude",
    ),
    _tank("3dof", "6dof"),
    _tank("6dof", "3dof"),
    *_dives(
        "SG561",
        [f"p561000{k}.nc" for k in (2, 3, 4, 5)],
        "Seaglider, Lofoten, 2016, to 97 and 307 m; from `iop-apl-uw/basestation3`",
        "the operators' constants (`sg_cal_`), compressibility 1.55e-10 1/Pa",
    ),
    *_dives(
        "SG171",
        [f"p1710{k}.nc" for k in (100, 101, 102, 103)],
        "Seaglider, 2024, to 506 m; from `iop-apl-uw/basestation3`",
        "the operators' constants (`sg_cal_`)",
    ),
    *_dives(
        "SG005",
        ["p0050003_20080606.nc", "p0050004_20080607.nc"],
        "Seaglider, 2008; from `ocean-uhh/seagliderOG1`",
        "the operators' constants (`sg_cal_`), without compressibility and expansion",
    ),
    Log(
        "SEA035, mission 10",
        "seaexplorer",
        _MISSION,
        "SeaExplorer, 48 files without a CTD; from `c-proof/pyglider`",
        "nothing; the polar of the preset was fitted to half of this log",
        least_depth=10.0,
        signals=("depth_m",),
        run=diagnose_flight,
    ),
    Log(
        "SEA035, steered",
        "seaexplorer",
        _MISSION,
        "the same 48 files, with the positions of the masses as inputs instead of the attitude",
        "nothing; the relation of the preset between masses, attitude and turn was fitted to half of this log, too",
        least_depth=10.0,
        run=diagnose_steered,
    ),
)
