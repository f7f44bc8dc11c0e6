"""Logs of flying gliders, judged by the vertical velocity of steady flight.

Away from pumping and inflections, the vertical velocity of the model is compared with the differenced depth: as given,
with coefficients refitted, and with the named effects; other flight models are compared on the same samples.  Dives
that no fit has seen are judged, or parts of a log by vehicles that were fitted without them.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.cli.options.console import errors
from auv_gym.model import inputs_of
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.currents import dive_currents
from auv_gym.plant.flying import steered
from auv_gym.plant.record_check import described, needs_of
from auv_gym.plant.stated import vehicle_from_dive
from auv_gym.records.reading import find_log, open_log
from auv_gym.records.record import Record
from identification.diagnosis import Diagnosis, diagnose
from identification.diagnosis.log.parts import parts_of
from scripts.benchmarks.peers.environments import Peer, run
from scripts.real.constants import constants_of
from scripts.real.half_dives import depth_error, depth_error_of, interval_of, rms, rms_draws
from scripts.real.log import Error, Log, Places, bundled, kept

GLIDERFLIGHT = Peer("gliderflight", "1.2.1", "scripts.benchmarks.peers.run_gliderflight")
SIGNAL, UNIT = "vertical velocity", "cm/s"
# up, of the operators' hydrodynamic model; vert_speed_gsm uses the measured depth rate, and so predicts nothing
_OPERATORS = "vert_speed_mps"


def dive_of(file: str) -> str:
    """The number of a dive, from the file's name."""
    return str(int(Path(file).name.partition(".")[0].partition("_")[0][4:]))


def read_dives(log: Log, data: Path) -> tuple[Record, Plant]:
    """The dives of a Seaglider for the fit, and the glider according to the first of them."""
    plant = vehicle_from_dive(data / log.files[0], log.vehicle)
    return log.record(data, log.files, needs_of(plant)), plant


def read_flight(log: Log, data: Path) -> tuple[Record, Plant]:
    """A flight log, with the data of the science computer, and its glider."""
    plant = load_vehicle(log.vehicle)
    return log.record(data, _with_science(log.files), needs_of(plant)), plant


def diagnose_dives(log: Log, places: Places) -> dict[str, Any]:
    """The diagnosis of some dives of a Seaglider, judged on others beside the operators' own model, and currents."""
    record, plant = read_dives(log, places.data)
    found, needs = diagnose(record, plant, source=log.name), needs_of(plant)
    judged = described(plant, log.record(places.data, log.judged, needs))
    stages = [stage.plant for stage in (found.given, found.refitted, found.after)]
    errors = errors_of_dives(stages, judged)
    currents = []
    for file in log.judged:
        whole = described(plant, log.record(places.data, [file], needs))
        stated = open_log(places.data / file).attrs
        currents.append(
            {
                "dive": f"{log.name.partition(',')[0]}, {dive_of(file)}",
                "given": [(c.north, c.east) for c in dive_currents(found.given.plant, whole)],
                "after": [
                    (c.north, c.east, c.north_error, c.east_error)
                    for c in dive_currents(found.after.plant, whole, found.spread)
                ],
                "operators": [
                    stated[f"current_{way}_mps"] for way in ("north", "east") if f"current_{way}_mps" in stated
                ],
            }
        )
    return kept(found, errors=[vars(e) for e in errors], currents=currents, constants=constants_of(found))


def diagnose_flight(log: Log, places: Places) -> dict[str, Any]:
    """The diagnosis of a flight log, parts judged by vehicles fitted without them, and Slocums by gliderflight."""
    record, plant = read_flight(log, places.data)
    found = diagnose(record, plant, source=log.name, window=log.window)
    parts = parts_of(plant, found.record, len(found.windows))
    numbers = np.full(len(found.record), -1)
    for number, part in enumerate(parts):
        for piece in part:
            numbers[piece] = number
    stages = [
        100.0 * _unseen_error(stage.without, found.record, numbers)
        for stage in (found.given, found.refitted, found.after)
    ]
    others, settings = gliderflight_error(found, numbers, places.peers) if log.rival else (None, "")
    return kept(found, errors=[vars(Error(SIGNAL, UNIT, stages, others))], others=settings)


def diagnose_steered(log: Log, places: Places) -> dict[str, Any]:
    """The diagnosis of a flight log by a glider that its masses steer: the attitude is predicted, not an input."""
    plant = steered(load_vehicle(log.vehicle), None)
    return kept(diagnose(log.record(places.data, log.files, needs_of(plant)), plant, source=log.name))


def errors_of_dives(stages: Sequence[Plant], record: Record) -> list[Error]:
    """Errors of vertical velocity, with intervals, and of depth over half-dives, beside the operators' own model."""
    missed = [100.0 * velocity_errors(plant, record) for plant in stages]
    depth = [depth_error(plant, record) for plant in stages]
    others: tuple[float | None, float | None] = (None, None)
    if record.has(_OPERATORS):
        down = -record[_OPERATORS]
        missed.append(100.0 * (down - depth_rate(record)))
        others = rms(missed[-1][np.isfinite(missed[-1])]), depth_error_of(down, record, stages[0].settle)
    intervals = [interval_of(draws) for draws in rms_draws(missed, record)]
    sizes = [rms(m) for m in missed[: len(stages)]]
    return [Error(SIGNAL, UNIT, sizes, others[0], intervals), Error("depth over half-dives", "m", depth, others[1])]


def vertical_velocities(plant: Plant, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Vertical velocities of the model at measured depths, and of the differenced depth, m/s, at each sample."""
    family, inputs, depth = plant.family, inputs_of(plant, record), record["depth_m"]
    heated = family.actuators.index("temperature_C")
    view, slopes, found = family.view(plant.derived), np.empty(family.integrated), np.full(len(record), np.nan)
    between = {n: record[n] for n in family.interpolated if record.has(n)}
    for name, values in between.items():  # values at the sample itself
        inputs[:, family.inputs.index(name)] = values
    shaped, memory, z = np.empty(2), np.empty(2), np.zeros(family.integrated)
    for k in range(len(record)):
        memory[:] = inputs[k, :2]
        family.hooks.shape(inputs[k], memory, view, shaped)
        shaped[heated] = inputs[k, heated]
        z[0] = depth[k]
        family.hooks.derivative(z, shaped, inputs[k], view, slopes, np.empty(1))
        found[k] = slopes[0]
    return found, depth_rate(record)


def depth_rate(record: Record) -> np.ndarray:
    """The differenced depth, m/s, at each sample."""
    return np.concatenate([np.gradient(record["depth_m"][s], record.time[s]) for s in record.segments])


def velocity_errors(plant: Plant, record: Record) -> np.ndarray:
    """Vertical velocity of the model minus the differenced depth, m/s, at each sample."""
    model, logged = vertical_velocities(plant, record)
    return model - logged


def gliderflight_error(found: Diagnosis, numbers: np.ndarray, environments: Path) -> tuple[float | None, str]:
    """RMS error of gliderflight's steady model, cm/s, each part by one calibrated without it, and the calibrated set.

    The set of parameters is the one, of those that its runner tries, that is best on unseen parts.  numbers: the part
    of each row.  None if its environment does not exist.
    """
    if not GLIDERFLIGHT.python(environments).exists():
        errors.print(f"{GLIDERFLIGHT.title} is not in {environments}: give --make-peers to install it there.")
        return None, ""
    plant, record = found.given.plant, found.record
    density = (
        record["density_kgpm3"]
        if record.has("density_kgpm3")
        else np.full(len(record), plant.constants["density_kgpm3"])
    )
    columns = {
        "time": record.time,
        "pressure": density * 9.81 * record["depth_m"] / 1e5,  # bar
        "pitch": record["pitch_rad"],
        "buoyancy_change": 1e6 * record["buoyancy_volume_m3"],  # cm3
        "density": density,
        "dhdt": -depth_rate(record),  # up
        "part": numbers,
    }
    hull = plant.parameters.hull
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "log.npz", **columns)
        (Path(folder) / "start.json").write_text(json.dumps({"mg": hull.mass, "Vg": hull.volume}), encoding="utf-8")
        lines = list(run(GLIDERFLIGHT, Path(folder), environments, 1))
    best = min(lines, key=lambda line: line["rms"])
    return 100.0 * best["rms"], ", ".join(best["calibrated"])


def _unseen_error(plants: Sequence[Plant], record: Record, numbers: np.ndarray) -> float:
    """RMS of the vertical velocity, m/s, each part by its own plant."""
    missed = [velocity_errors(plant, record)[numbers == number] for number, plant in enumerate(plants)]
    return rms(np.concatenate(missed))


def _with_science(files: Sequence[str]) -> list[str]:
    """Files, and for those that dbdreader ships also the logs of the science computer, which has the CTD."""
    beside = [find_log(file).with_suffix(".ebd") for file in files if bundled(file)]
    return [*files, *(str(path) for path in beside if path.exists())]
