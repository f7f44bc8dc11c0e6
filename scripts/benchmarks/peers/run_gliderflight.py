"""gliderflight: its steady model calibrated on all parts of a log but one, and its error in that part.

It imports nothing else but numpy, so that it runs in an environment of its own.  The folder holds log.npz, with a row
for each sample and `part`, the part of each (-1: none), and start.json, with initial mass and volume.  It prints a line
of JSON for each set of parameters: what was calibrated, and the RMS error of the vertical velocity, m/s.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from gliderflight import SteadyStateCalibrate

SETS = (("mg", "Cd0"), ("mg", "Cd0", "epsilon"), ("mg", "Cd0", "ah"))


def unseen_error(
    data: dict[str, np.ndarray], part: np.ndarray, start: dict[str, float], names: tuple[str, ...]
) -> float:
    """RMS error of the vertical velocity over all parts, each by a model calibrated without it."""
    missed = []
    for number in range(part.max() + 1):
        model = SteadyStateCalibrate()
        model.define(Cd0=0.15, **start)
        model.set_input_data(**data)
        model.set_mask((part == number) | (part < 0))  # excluded samples
        model.calibrate(*names)
        found = model.solve(dict(data))
        missed.append((found.w - data["dhdt"])[part == number])
    return float(np.sqrt(np.mean(np.concatenate(missed) ** 2)))


def main() -> int:
    folder = Path(sys.argv[1])
    start = json.loads((folder / "start.json").read_text(encoding="utf-8"))
    with np.load(folder / "log.npz") as arrays:
        data = {name: arrays[name] for name in arrays.files}
    part = data.pop("part")
    for names in SETS:
        print(json.dumps({"calibrated": names, "rms": unseen_error(data, part, start, names)}), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
