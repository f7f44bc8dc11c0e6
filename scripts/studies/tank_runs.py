"""A BlueROV2 Heavy in a tank under motion capture, on a tether: fitted on one run, judged on the other.

    python -m scripts.studies.tank_runs --data DIR --out tank

DIR has `bluerov2_heavy/bluerov2_mocap_2runs.csv`.  What was logged are the axes of a joystick; each thruster gets the
sum of those that it serves, with the sign that its place gives it, as ArduSub's frame "vectored, 6 DOF" has it.  A grey
box fits the coefficients of a first fit, and then the pull and the drag of a tether beside them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_gym.channels import channel
from auv_gym.cli.options.console import errors, output
from auv_gym.model import Diverged
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.thrusters import AXES, Thrusters, find_thrusters
from auv_gym.records.record import Record
from auv_gym.writing import replacing, writable_folder
from identification.diagnosis.wording import interval, quantity
from identification.fit.greybox import GreyBox
from identification.fit.validation import free_runs
from scripts.studies.harness import Sheet

FILE = Path("bluerov2_heavy", "bluerov2_mocap_2runs.csv")
HORIZONS = (3.0, 10.0)  # s
JUDGED = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
HEADS = ("fitted on, judged on", "run, s>", "signal", "as given, %>", "refitted, %>", "with a tether, %>", "samples>")
TETHER = tuple(f"effects.load.tether_{name}" for name in ("north", "east", "down", "drag"))
_COLUMNS = {"north_m": "x_m", "east_m": "y_m", "heading_rad": "yaw_rad"} | {
    name: name for name in ("roll_rad", "pitch_rad", *JUDGED)
}
_DEPTH = 2.0  # m, where a run begins: only changes were logged
_JUMP = 1.0  # rad between samples: a heading on its way through half a turn was interpolated between both ends


def tank_record(rows: np.ndarray, thrusters: Thrusters, name: str) -> Record:
    """A run as a record with thruster commands.

    rows: of the table, a structured array.  Samples whose heading lies between both ends of its range are left out.
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


def fit_percents(plant: Plant, record: Record, horizon: float) -> dict[str, tuple[float, int]]:
    """Of each signal, fit percent of free runs over so many s and samples; NaN where runs do not stay finite.

    Starts are fitted to a settling time of a fifth of that before.
    """
    windows = record.windows(1.2 * horizon)
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            scores = free_runs(plant, record, windows, 0.2 * horizon).scores(record)
    except Diverged:
        return dict.fromkeys(JUDGED, (np.nan, 0))
    return {name: (scores[name].fit_percent, scores[name].samples) for name in JUDGED}


def fit_rows(words: str, stages: Sequence[Plant], judged: Record) -> list[list[str]]:
    """What the table says of vehicles by a run that none of them has seen."""
    rows = []
    for horizon in HORIZONS:
        percents = [fit_percents(plant, judged, horizon) for plant in stages]
        for name in JUDGED:
            values = [f"{each[name][0]:.0f}" for each in percents]
            rows.append([words, f"{horizon:g}", channel(name).label, *values, str(percents[0][name][1])])
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of measured logs")
    parser.add_argument("--out", type=Path, required=True, help="folder for tank_runs.md")
    args = parser.parse_args(argv)
    folder, plant = writable_folder(args.out), load_vehicle("bluerov2_heavy")
    if not (args.data / FILE).exists():
        errors.print(f"Nothing to do: {FILE} is not in {args.data}.")
        return 1
    table = np.genfromtxt(args.data / FILE, delimiter=",", names=True, dtype=None, encoding="utf-8")
    thrusters = find_thrusters(plant)
    runs = [tank_record(table[table["run"] == name], thrusters, name) for name in np.unique(table["run"])]
    rows, said = [], []
    for fitted, judged in ((runs[0], runs[1]), (runs[1], runs[0])):
        words = f"{fitted.attrs['source'][-4:]} on {judged.attrs['source'][-4:]}"
        errors.print(words)
        coefficients = plant.family.coefficients
        fits = [GreyBox(plant, free).fit(fitted) for free in (coefficients, (*coefficients, *TETHER))]
        rows += fit_rows(words, [plant, *(fit.model for fit in fits)], judged)
        said += [
            f"{words}: `{e.path}` {quantity(e.value, e.unit)} ({interval(e.ci95, e.unit)})\n" for e in fits[1].estimates
        ]
    text = Sheet("tank_runs", "Free runs in the run that was not fitted", HEADS, rows).markdown() + "\n".join(
        ["", *said]
    )
    with replacing(folder / "tank_runs.md") as aside:
        aside.write_text(text, encoding="utf-8")
    output.print(text, markup=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
