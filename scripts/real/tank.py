"""A BlueROV2 Heavy in a tank under motion capture, on a tether: diagnosed on one run, judged on the other.

The log has the axes of a joystick; each thruster gets the sum of those that it serves, with the sign of its position,
as in ArduSub's frame "vectored, 6 DOF".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.plant import load_vehicle
from auv_gym.plant.thrusters import AXES, Thrusters, find_thrusters
from auv_gym.records.record import Record
from identification.diagnosis import diagnose
from scripts.real.log import Log, Places, fit_percents, kept

JUDGED = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
_COLUMNS = {"north_m": "x_m", "east_m": "y_m", "heading_rad": "yaw_rad"} | {
    name: name for name in ("roll_rad", "pitch_rad", *JUDGED)
}
_DEPTH = 2.0  # m, assumed initial depth: only changes were logged
_JUMP = 1.0  # rad between samples: a heading that crossed half a turn was interpolated between both ends


def diagnose_run(log: Log, places: Places, fitted: str, judged: str) -> dict[str, Any]:
    """The diagnosis of one run, and fit percents of free runs in the other; runs by the endings of their names."""
    plant = load_vehicle(log.vehicle)
    runs = runs_of(places.data / log.files[0], find_thrusters(plant))
    one, other = (next(run for name, run in runs.items() if name.endswith(end)) for end in (fitted, judged))
    found = diagnose(one, plant, source=log.name)
    stages = [[stage.plant] for stage in (found.given, found.refitted, found.after)]
    fits = {}
    for horizon in log.horizons:
        windows = [other.windows(1.2 * horizon)]  # the starts are fitted to an additional fifth before it
        fits[f"{horizon:g}"] = fit_percents(stages, other, windows, 0.2 * horizon, JUDGED)
    return kept(found, fits=fits)


def runs_of(file: Path, thrusters: Thrusters) -> dict[str, Record]:
    """The runs of a table as records, by name."""
    table = np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8")
    return {
        str(name): tank_record(table[table["run"] == name], thrusters, str(name)) for name in np.unique(table["run"])
    }


def tank_record(rows: np.ndarray, thrusters: Thrusters, name: str) -> Record:
    """A run as a record with thruster commands.

    rows: of the table, a structured array.  Samples whose heading was interpolated across half a turn are left out.
    """
    step = np.abs(np.diff(rows["yaw_rad"], prepend=rows["yaw_rad"][0], append=rows["yaw_rad"][-1]))
    rows = rows[~((step[:-1] > _JUMP) & (step[1:] > _JUMP))]
    axes = [rows["cmd_heave_down_norm" if axis == "heave" else f"cmd_{axis}_norm"] for axis in AXES]
    shares = np.abs(thrusters.wrench).max(axis=1, keepdims=True)
    commands = np.clip((thrusters.wrench / shares).T @ axes, -1.0, 1.0)
    channels = {name: rows[column] for name, column in _COLUMNS.items()} | {"depth_m": rows["z_m"] + _DEPTH}
    channels["heading_rad"] = np.unwrap(channels["heading_rad"])
    channels |= dict(zip(thrusters.channels, commands, strict=True))
    return Record.from_arrays(rows["time_s"], channels, attrs={"source": name})
