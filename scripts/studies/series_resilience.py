"""Resilience of a series of missions to a kill halfway, and to the death of a worker of a cluster.

    python -m scripts.studies.series_resilience --missions 40

Each series runs as a command of its own, as a user would run it. All of them must leave the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.changes.series import LEAST, MISSIONS
from identification.experiments.heading_control import closed_loop
from scripts.studies.harness import Found, Option, Sheet, Study

VEHICLE, GROWS, BY = "slocum", "effects.rudder.offset", 0.04  # rad, over the series
PARTS = {
    "kill": "killed halfway with SIGKILL, workers and all, and resumed",
    "dask": "on a Dask scheduler with two worker processes, one killed halfway",
}
PATIENCE = 1800.0  # s, time limit of a series


def attempt(part: str, seed: int, missions: int, duration: float) -> dict[str, Any]:
    """The findings of a part; `same`: whether its files equal those of an undisturbed series in one process."""
    with tempfile.TemporaryDirectory(prefix="auv-gym-") as name:
        folder = Path(name)
        logs = dives(folder, seed, missions, duration)
        _followed(logs, folder / "one")
        undisturbed = hashes(folder / "one")
        disturbed = {"kill": _killed, "dask": _clustered}[part](logs, folder / part)
        return {"files": len(undisturbed), **disturbed, "same": hashes(folder / part) == undisturbed}


def dives(folder: Path, seed: int, missions: int, duration: float) -> list[str]:
    """Logs of a glider whose rudder offset grows from log to log."""
    plant, files = load_vehicle(VEHICLE), []
    for k in range(missions):
        flown = replace_at(plant, GROWS, BY * k / missions)
        files.append(str(folder / f"dive{k:03d}.nc"))
        closed_loop(flown, rng=np.random.default_rng([seed, k]), duration=duration).save(files[-1])
    return files


def command(logs: Sequence[str], out: Path, *options: str) -> list[str]:
    """The command of a series."""
    given = ["compare-missions", *logs, "--series", "--vehicle", VEHICLE, "--out", str(out)]
    return [sys.executable, "-m", "auv_gym.cli", *given, *options]


def hashes(out: Path) -> dict[str, str]:
    """The hash of each file of a series."""
    files = (path for path in out.rglob("*") if path.is_file())
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def _followed(logs: Sequence[str], out: Path, *options: str) -> None:
    subprocess.run(command(logs, out, *options), check=True, stdout=subprocess.DEVNULL, timeout=PATIENCE)


def _killed(logs: Sequence[str], out: Path) -> dict[str, Any]:
    process = subprocess.Popen(command(logs, out, "--jobs", "2"), start_new_session=True, stdout=subprocess.DEVNULL)
    wait(lambda: _written(out) >= len(logs) // 2 or process.poll() is not None)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    code = process.wait()
    before = {path: path.stat().st_mtime_ns for path in (out / MISSIONS).glob("*.json")}
    _followed(logs, out, "--jobs", "2")
    kept = sum(path.stat().st_mtime_ns == then for path, then in before.items())
    return {"exit_code": code, "after": len(before), "kept": kept}


def _clustered(logs: Sequence[str], out: Path) -> dict[str, Any]:
    with cluster(2) as (address, workers):
        given = command(logs, out, "--scheduler", address)
        process = subprocess.Popen(given, stdout=subprocess.DEVNULL)
        wait(lambda: _written(out) >= len(logs) // 2 or process.poll() is not None)
        at = _written(out)
        workers[0].kill()
        return {"killed_after": at, "exit_code": process.wait(PATIENCE)}


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """The address of a Dask scheduler on the loopback interface, and its workers, without nannies to restart them."""
    with tempfile.TemporaryDirectory(prefix="auv-gym-") as folder:
        told = Path(folder) / "scheduler.json"
        dask = [sys.executable, "-m", "dask"]
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        quiet["env"] = {**os.environ, "PYTHONPATH": os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")])}
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(told)]
        started = [subprocess.Popen([*dask, "scheduler", *options], **quiet)]
        try:
            wait(lambda: told.is_file() and told.stat().st_size > 0)
            address = json.loads(told.read_text(encoding="utf-8"))["address"]
            options = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
            started += [subprocess.Popen([*dask, "worker", address, *options], **quiet) for _ in range(workers)]
            yield address, started[1:]
        finally:
            for process in started:
                process.terminate()
            for process in started:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(10)
                process.kill()


def wait(ready: Callable[[], bool]) -> None:
    """Wait until something is ready; raises ValueError if it takes longer than `PATIENCE`."""
    deadline = time.monotonic() + PATIENCE
    while not ready():
        if time.monotonic() > deadline:
            raise ValueError(f"Nothing came within {PATIENCE:g} s: try fewer or shorter runs.")
        time.sleep(0.05)


def _written(out: Path) -> int:
    return len(list((out / MISSIONS).glob("*.json")))


def sheets(found: Found) -> list[Sheet]:
    """The findings of each part."""
    rows = [[PARTS[part], what, str(value)] for part in found.runs for what, value in found.of(part)[0].items()]
    title = f"A series of {found.options['missions']} missions"
    return [Sheet("resilience", title, ("series", "what", "value>"), rows)]


def good(found: Found) -> bool:
    """Whether all files are the same, and no stored result was computed again."""
    results = [found.of(part)[0] for part in found.runs]
    return all(one["same"] and one.get("kept") == one.get("after") for one in results)


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(PARTS),
    sheets,
    seeds=None,
    one_of="part",
    options={
        "missions": Option(40, "of the series; halfway has to lie inside", least=LEAST),
        "duration": Option(520.0, "length of a mission, s", least=400.0),
    },
    good=good,
    doing="series",
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
