"""What a campaign survives: how much two jobs gain over one, a kill halfway, and a worker of a cluster that dies.

    python -m scripts.studies.campaign_resilience --runs 200

Each campaign is a command of its own, as a user would give it; all of them have to leave the same records.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from identification.campaign.index import RUNS, read_index
from scripts.studies.harness import Found, Option, Sheet, Study

_FILE = """
name = "resilience"
seeds = {runs}

[vehicle]
preset = "heu_torpedo"

[experiment]
kind = "env"
id = "Depth"
duration_s = {duration}
start = {{ depth_m = 15.0 }}
targets = {{ depth_m = [[0, 15.0], [60, 18.0]] }}

[controller]
kind = "pid"

[[excitation]]
kind = "prbs"
at = "stern_plane_rad"
amplitude = 0.05
clock_s = 2.0

[sensors]
depth.noise = 0.05
"""
PARTS = {
    "jobs": "two jobs",
    "kill": "killed halfway with SIGKILL, workers and all, and resumed",
    "dask": "on a Dask scheduler with two worker processes, one killed halfway",
}
PATIENCE = 1800.0  # s, for a campaign


def attempt(part: str, seed: int, runs: int, duration: float) -> dict[str, Any]:
    """What a part found; `same`: its records are those of the campaign that one job performed undisturbed."""
    with tempfile.TemporaryDirectory(prefix="auv-gym-") as name:
        folder = Path(name)
        file = folder / "resilience.toml"
        file.write_text(_FILE.format(runs=runs, duration=duration), encoding="utf-8")
        one_job_s = _timed(file, folder / "one", "--jobs", "1")
        hashes = _hashes(folder / "one")
        performed = {"jobs": _doubled, "kill": _killed, "dask": _clustered}[part]
        return {"one_job_s": one_job_s, **performed(file, folder / part, runs, hashes)}


def _doubled(file: Path, out: Path, runs: int, hashes: dict[str, str]) -> dict[str, Any]:
    return {"two_jobs_s": _timed(file, out, "--jobs", "2"), "same": _hashes(out) == hashes}


def _killed(file: Path, out: Path, runs: int, hashes: dict[str, str]) -> dict[str, Any]:
    process = subprocess.Popen(_command(file, out, "--jobs", "2"), start_new_session=True)
    wait(lambda: _written(out) >= runs // 2 or process.poll() is not None)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in (out / RUNS).glob("*.nc")}
    seconds = _timed(file, out, "--jobs", "2")
    kept = sum(path.stat().st_mtime_ns == then for path, then in before.items())
    return {"after": len(before), "kept": kept, "resumed_s": seconds, "same": _hashes(out) == hashes}


def _clustered(file: Path, out: Path, runs: int, hashes: dict[str, str]) -> dict[str, Any]:
    with cluster(2) as (address, workers):
        begin = time.perf_counter()
        process = subprocess.Popen(_command(file, out, "--scheduler", address))
        wait(lambda: _written(out) >= runs // 2 or process.poll() is not None)
        at = _written(out)
        workers[0].kill()
        code = process.wait(PATIENCE)
    rows = read_index(out)
    return {
        "killed_after": at,
        "s": time.perf_counter() - begin,
        "exit_code": code,
        "twice": len(rows) - len({row.id for row in rows}),
        "same": _hashes(out) == hashes,
    }


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """The address of a Dask scheduler on the loopback, and its worker processes, without nannies to restart them."""
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


def _command(file: Path, out: Path, *options: str) -> list[str]:
    return [sys.executable, "-m", "auv_gym.cli", "campaign", str(file), "--out", str(out), "--only", "runs", *options]


def _timed(file: Path, out: Path, *options: str) -> float:
    begin = time.perf_counter()
    subprocess.run(_command(file, out, *options), check=True, stdout=subprocess.DEVNULL, timeout=PATIENCE)
    return time.perf_counter() - begin


def wait(ready: Callable[[], bool]) -> None:
    """Wait until something is ready; raises ValueError where it takes longer than `PATIENCE`."""
    deadline = time.monotonic() + PATIENCE
    while not ready():
        if time.monotonic() > deadline:
            raise ValueError(f"Nothing came within {PATIENCE:g} s: try fewer or shorter runs.")
        time.sleep(0.05)


def _written(out: Path) -> int:
    return len(list((out / RUNS).glob("*.nc")))


def _hashes(out: Path) -> dict[str, str]:
    return {row.id: row.sha256 for row in read_index(out)}


def sheets(found: Found) -> list[Sheet]:
    """What each part found."""
    rows = [
        [PARTS[part], what, f"{value:.2f}" if isinstance(value, float) else str(value)]
        for part in found.runs
        for what, value in found.of(part)[0].items()
    ]
    return [Sheet("resilience", f"Campaigns of {found.options['runs']} runs", ("campaign", "what", "value>"), rows)]


def good(found: Found) -> bool:
    """Whether all records are the same, nothing that was kept was done again, and no run was done twice."""
    results = [found.of(part)[0] for part in found.runs]
    return all(one["same"] and one.get("kept") == one.get("after") and not one.get("twice") for one in results)


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(PARTS),
    sheets,
    seeds=None,
    one_of="part",
    options={
        "runs": Option(200, "of a campaign; halfway has to lie inside", least=4),
        "duration": Option(200.0, "length of a run, s", least=1.0),
    },
    good=good,
    doing="campaigns",
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
