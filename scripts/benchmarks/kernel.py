"""Speed and accuracy of kernel regression, compared with scikit-learn, on the forces on a torpedo's hull.

Each package runs every section in a process of its own, on the same arrays; ours needs none of the others.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.cli.options.console import steps_bar, table
from auv_gym.physics.polynomials import TERMS
from auv_gym.plant import load_vehicle
from identification.kernel_machines.fixed_size import FixedSize
from identification.kernel_machines.regression import LsSvmRegression
from scripts.benchmarks.hybrid import hybrid_rows
from scripts.benchmarks.peers.environments import (
    KERNEL_OURS,
    KERNEL_PEERS,
    Peer,
    add_peer_arguments,
    make,
    run,
    wide_console,
)

VEHICLE = "heu_torpedo"
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
SPREADS = np.array([0.25, 0.1, 0.1, 0.1, 0.15, 0.2])  # of u v w p q r about MIDDLE, m/s and rad/s
MIDDLE = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0])
NOISE = 0.05  # of each force's spread
FRESH = 2000
PENALTY, SIGMA = 1e3, 6.0  # near the best for 2000 samples with this noise
FLYING_PENALTY, FLYING_SIGMA = 1e7, 20.0
GRID = {"penalties": [1e1, 1e2, 1e3, 1e4, 1e5], "sigmas": [2.0, 4.0, 6.0, 9.0, 13.0]}
SIZES = (50, 100, 256, 500, 1000)


@dataclass(frozen=True)
class Section:
    """A table of the benchmark: its name, its title, the measured rows, and its columns.

    measure: arguments to rows.  columns: key of a row to heading and format.
    """

    name: str
    title: str
    measure: Callable[[argparse.Namespace], list[dict[str, Any]]]
    columns: Mapping[str, tuple[str, str]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    add_peer_arguments(parser)
    parser.add_argument("--samples", type=int, default=2000, help="to learn from (default: %(default)s)")
    parser.add_argument("--long", type=int, default=100_000, help="samples of a long record (default: %(default)s)")
    parser.add_argument("--size", type=int, default=256, help="centres of fixed-size machines (default: %(default)s)")
    parser.add_argument(
        "--only", nargs="+", choices=[section.name for section in SECTIONS], help="sections (default: all)"
    )


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """The rows of every section, and what could not be measured."""
    if min(arguments.samples, arguments.long) < 20 or arguments.threads < 1 or arguments.size < 2:
        raise ValueError(
            f"--samples and --long need 20 or more, --size 2, --threads 1, got {arguments.samples}, {arguments.long}, "
            f"{arguments.size} and {arguments.threads}."
        )
    if arguments.make_peers:
        make(arguments.peers, KERNEL_PEERS)
    wanted = [section for section in SECTIONS if section.name in (arguments.only or [one.name for one in SECTIONS])]
    rows = {}
    with steps_bar(len(wanted)) as advance:
        for section in wanted:
            advance(section.name)
            rows[section.name] = section.measure(arguments)
    missing = [peer.title for peer in KERNEL_PEERS if not peer.python(arguments.peers).exists()]
    return {"threads": arguments.threads, "sections": rows, "not_installed": missing}


def show(numbers: Mapping[str, Any]) -> None:
    """Print every section's table, and what is missing from them."""
    console = wide_console()
    for section in SECTIONS:
        if section.name not in numbers["sections"]:
            continue
        shown = table(section.title, *(heading for heading, _ in section.columns.values()))
        for row in numbers["sections"][section.name]:
            shown.add_row(
                *(
                    form.format(row[key]) if row.get(key) is not None else "-"
                    for key, (_, form) in section.columns.items()
                )
            )
        console.print(shown)
        for row in numbers["sections"][section.name]:
            if "failed" in row:
                console.print(f"Failed: {row['method']}: {row['failed']}", markup=False)
    console.print(
        f"Six forces over six velocities of {VEHICLE}, {100.0 * NOISE:g} % noise; errors: root mean square on fresh "
        f"data without noise, over its spread. C {PENALTY:g} and sigma {SIGMA:g} where none are tuned. "
        f"Threads of linear algebra: {numbers['threads']}. Times: to learn, and to predict one row and 10000; solved: "
        "systems of all samples; peak: memory."
    )
    if numbers["not_installed"]:
        console.print(f"Not installed: {', '.join(numbers['not_installed'])}; --make-peers installs them.")


def forces(velocities: np.ndarray) -> np.ndarray:
    """Forces of the polynomials of VEHICLE's hull at u v w p q r, (n, 6), N and N m."""
    hull = load_vehicle(VEHICLE).hull
    of = dict(zip("uvwpqr", velocities.T))
    products = [of[t[0]] * np.abs(of[t[0]]) if "_" in t else np.prod([of[s] for s in t], axis=0) for t in TERMS]
    coefficients = [[getattr(getattr(hull, axis), term) for term in TERMS] for axis in AXES]
    return np.transpose(products) @ np.transpose(coefficients)


def samples(count: int, seed: int) -> dict[str, np.ndarray]:
    """Noisy x and y to learn from, and noise-free fresh_x and fresh_y to judge by."""
    rng = np.random.default_rng(seed)
    x, fresh = (MIDDLE + SPREADS * rng.normal(size=(n, 6)) for n in (count, FRESH))
    y = forces(x)
    noisy = y + NOISE * y.std(axis=0) * rng.normal(size=y.shape)
    return {"x": x, "y": noisy, "fresh_x": fresh, "fresh_y": forces(fresh)}


def _beside_others(section: str, count: Callable[[argparse.Namespace], int]) -> Callable[..., list[dict[str, Any]]]:
    """A measurement of a section by every available package, each in a process of its own."""

    def measured(arguments: argparse.Namespace) -> list[dict[str, Any]]:
        jobs = {"section": section, "penalty": PENALTY, "sigma": SIGMA, "size": arguments.size, **GRID}
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "jobs.json").write_text(json.dumps(jobs), encoding="utf-8")
            np.savez(folder / "data.npz", **samples(count(arguments), 0))
            present = [peer for peer in (KERNEL_OURS, *KERNEL_PEERS) if peer.python(arguments.peers).exists()]
            return [row for peer in present for row in _of_peer(peer, folder, arguments)]

    return measured


def _of_peer(peer: Peer, folder: Path, arguments: argparse.Namespace) -> list[dict[str, Any]]:
    rows = []
    try:
        for line in run(peer, folder, arguments.peers, arguments.threads):
            rows.append({**line, "ours": peer.ours, "method": f"{peer.name} {line['method']}"})
    except ValueError as error:
        rows.append({"method": peer.title, "ours": peer.ours, "failed": str(error)})
    return rows


def _sizes(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Errors of fixed-size machines over that of the machine of all samples, with the same C and sigma."""
    data = samples(arguments.samples, 0)
    spread = data["fresh_y"].std(axis=0)

    def error(settings: LsSvmRegression | FixedSize, **options: Any) -> float:
        away = settings.fit(data["x"], data["y"], **options)(data["fresh_x"]) - data["fresh_y"]
        return float(np.sqrt(np.mean((away / spread) ** 2)))

    full = error(LsSvmRegression(PENALTY, SIGMA))
    return [
        {"size": size, "error_percent": 100.0 * errors[0], "farthest": errors[0] / full, "entropy": errors[1] / full}
        for size in SIZES
        if size < arguments.samples
        for errors in [
            [
                error(FixedSize(PENALTY, SIGMA, size, "farthest")),
                error(FixedSize(PENALTY, SIGMA, size, "entropy"), rng=np.random.default_rng(0)),
            ]
        ]
    ]


def _hybrid(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Steps of environments with hull machines learned without noise, so that they move as the vehicle does."""
    data = samples(arguments.samples, 0)
    full = LsSvmRegression(FLYING_PENALTY, FLYING_SIGMA).fit(data["x"], forces(data["x"]))
    small = FixedSize(FLYING_PENALTY, FLYING_SIGMA, arguments.size).fit(data["x"], forces(data["x"]))
    # the machines learn the given hull's forces, which are minus C(v)v + D(v)v
    machines = [replace(one, coefficients=-one.coefficients, bias=-one.bias) for one in (full, small)]
    return hybrid_rows(load_vehicle(VEHICLE), *machines)


_MACHINE = {
    "method": ("method!", "{}"),
    "learn_s": ("s>", "{:.2f}"),
    "cpu_s": ("CPU s>", "{:.2f}"),
    "row_us": ("one row, us>", "{:.1f}"),
    "rows_ms": ("10000, ms>", "{:.0f}"),
    "error_percent": ("error, %>", "{:.3f}"),
}
_TUNED = {"solved": ("solved>", "{}"), "loss": ("loss>", "{:.4f}")}
_MEMORY = {"peak_mb": ("peak, MB>", "{:.0f}")}
_STEP = {
    "hull": ("hull!", "{}"),
    "step_us": ("a step, us>", "{:.1f}"),
    "many_us": ("one of many on all cores, us>", "{:.2f}"),
}
_SIZE = {
    "size": ("centres>", "{}"),
    "error_percent": ("error, %>", "{:.3f}"),
    "farthest": ("over the full machine's, farthest>", "{:.3f}"),
    "entropy": ("entropy>", "{:.3f}"),
}
# The tables of the benchmark, in this order: add an entry for another table.
SECTIONS: Sequence[Section] = (
    Section("machines", "Fit and prediction", _beside_others("machines", lambda a: a.samples), _MACHINE),
    Section("tuning", "Tuning and fit", _beside_others("tuning", lambda a: a.samples), {**_MACHINE, **_TUNED}),
    Section("sizes", "Fixed size beside all samples", _sizes, _SIZE),
    Section("long", "A long record", _beside_others("long", lambda a: a.long), {**_MACHINE, **_TUNED, **_MEMORY}),
    Section("hybrid", "A step of an environment", _hybrid, _STEP),
)
