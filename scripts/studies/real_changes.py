"""Changes between measured missions, and of the current during the log of a torpedo.

    python -m scripts.studies.real_changes --data DIR
    python -m scripts.studies.real_changes --data DIR --only MERMAID

The logs are those of `scripts.real_logs`; nothing is tuned for them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from time import perf_counter

import numpy as np

from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.changes.missions import compare_missions
from identification.changes.series import sizes_of
from identification.changes.wording import summary
from identification.deciding import SURPRISE
from identification.diagnosis.wording import interval, quantity
from scripts.real.log import Log
from scripts.real.logs import LOGS

_CURRENT = ("effects.current.north", "effects.current.east")
_VT690 = ("effects.dvl_ground.bias_w", "effects.load.net_buoyancy")  # what the whole log names


def _log(name: str) -> Log:
    return next(log for log in LOGS if log.name == name)


def _read(log: Log, data: Path) -> tuple[Record, Plant]:
    plant = load_vehicle(log.vehicle)  # registers its channels
    return log.record(data, log.files), plant


def dives_in_two(name: str, data: Path) -> list[str]:
    """The earlier half of a record's dives against the later one."""
    record, plant = _read(_log(name), data)
    half = record.segments[len(record.segments) // 2].start
    early = np.arange(len(record)) < half
    return summary(compare_missions(record.select(early), record.select(~early), plant))


def two_logs(before: str, after: str, data: Path) -> list[str]:
    """One log against another one of the same vehicle."""
    (one, plant), (other, _) = _read(_log(before), data), _read(_log(after), data)
    return summary(compare_missions(one, other, plant))


def currents(name: str, beside: Sequence[str], parts: int, data: Path) -> list[str]:
    """The current in each of a log's parts of equal time, each fitted alone, beside the names of the whole log."""
    record, plant = _read(_log(name), data)
    edges, lines = np.linspace(record.time[0], record.time[-1], parts + 1), []
    for k, (begin, end) in enumerate(pairwise(edges), 1):
        own = record.select((record.time >= begin) & (record.time <= end))
        sizes = sizes_of(own, plant, [*_CURRENT, *beside], False)
        told = []
        for path in _CURRENT:
            value, error = sizes[path]
            limits = (value - SURPRISE * error, value + SURPRISE * error)
            told.append(f"{path.rpartition('.')[2]} {quantity(value, 'm/s')} ({interval(limits, 'm/s')})")
        lines.append(f"part {k} of {parts}: {', '.join(told)}")
    return lines


CASES: dict[str, Callable[[Path], list[str]]] = {
    "MERMAID, free drift: first dives against the last ones": lambda data: dives_in_two("MERMAID, free drift", data),
    "MERMAID, fixed point: first dives against the last ones": lambda data: dives_in_two("MERMAID, fixed point", data),
    "VT 690: current by quarters": lambda data: currents("VT 690", _VT690, 4, data),
    "BlueROV: 4 April against 18 April 2016": lambda data: two_logs(
        "BlueROV, test1_roll_pitch", "BlueROV, pitch_roll_1", data
    ),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of measured logs")
    parser.add_argument("--only", default="", help="cases whose name contains this")
    asked = parser.parse_args()
    for name, work in CASES.items():
        if asked.only not in name:
            continue
        begin = perf_counter()
        try:
            lines = work(asked.data)
        except (ValueError, OSError) as error:
            lines = [f"no result: {error}"]
        print(f"{name} ({perf_counter() - begin:.0f} s)", *(f"  {line}" for line in lines), sep="\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
