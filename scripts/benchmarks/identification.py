"""Speed and accuracy of linear identification on two known systems, compared with other packages on the same arrays.

Each package runs in a process of its own. The others have an environment of their own each, since ours needs none of
them.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table
from scipy.signal import dlsim, lfilter

from scripts.benchmarks.peers.environments import OURS, PEERS, Peer, add_peer_arguments, make, run, wide_console
from scripts.benchmarks.systems import (
    SYSTEMS,
    clean,
    coefficient_error,
    fit_percent,
    largest_pole_error,
    measured,
)

FRESH_SAMPLES = 2000
TITLES = {
    "armax": "ARMAX of orders 4, 4, 2; coloured noise, 10 %",
    "state_space": "Three states, 2 inputs, 2 outputs; noise on outputs, 10 %, and states",
}
ERRORS = {
    "armax": {"error_abc": "error of a, b, c", "error_ab": "error of a, b"},
    "state_space": {"pole_error": "largest pole error"},
}
_QUANTITIES = {"ms": "ms", "fit_percent": "fit, %"}
_FORMS = {"ms": "{:.1f}", "fit_percent": "{:.2f}"}
_TIE = 0.01  # relative difference of medians from which another package counts as ahead


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    add_peer_arguments(parser)
    parser.add_argument("--seeds", type=int, default=20, help="records of each length (default: %(default)s)")
    parser.add_argument(
        "--samples", type=int, nargs="+", default=[1000, 10_000], help="lengths of records (default: 1000 10000)"
    )
    parser.add_argument(
        "--budget", type=float, default=120.0, help="s, after which a method gets no more seeds (default: %(default)g)"
    )


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Rows of every method on both systems, what could not be measured, and where another package is ahead."""
    if min(arguments.seeds, arguments.threads, *arguments.samples) < 1 or not arguments.budget > 0.0:
        raise ValueError(
            f"--seeds, --samples, --threads and --budget need more than 0, got {arguments.seeds}, "
            f"{' '.join(map(str, arguments.samples))}, {arguments.threads} and {arguments.budget:g}."
        )
    if arguments.make_peers:
        make(arguments.peers)
    present = [peer for peer in (OURS, *PEERS) if peer.python(arguments.peers).exists()]
    rows: dict[str, list[dict[str, Any]]] = {system: [] for system in SYSTEMS}
    failed: list[dict[str, str]] = []
    with tempfile.TemporaryDirectory() as name, Progress(transient=True, console=Console(stderr=True)) as progress:
        folder = Path(name)
        write_jobs(folder, arguments.samples, arguments.seeds, arguments.budget)
        for peer in present:
            task = progress.add_task(peer.title, total=None)
            lines = []
            try:
                for line in run(peer, folder, arguments.peers, arguments.threads):
                    lines.append(line)
                    progress.update(task, total=lines[0]["fits"], advance=_done(line))
            except ValueError as error:
                failed.append({"peer": peer.title, "method": "all", "error": str(error)})
            progress.update(task, visible=False)
            for system in SYSTEMS:
                rows[system] += _rows(peer, system, [line for line in lines if line.get("system") == system])
            failed += [
                {"peer": peer.title, "method": f"{line['method']}, N {line['samples']}", "error": line["error"]}
                for line in lines
                if "error" in line
            ]
    numbers: dict[str, Any] = {
        "samples": arguments.samples,
        "seeds": arguments.seeds,
        "threads": arguments.threads,
        "measured": [peer.title for peer in present],
        "systems": rows,
        "not_installed": [peer.title for peer in PEERS if peer not in present],
        "failed": failed,
    }
    sides = {row["ours"] for found in rows.values() for row in found}
    leading = [lead for system in SYSTEMS for lead in leads(system, rows[system])]
    return {**numbers, "compared": len(sides) == 2, "ahead_of_ours": leading}


def leads(system: str, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The quantities in which a peer's method is ahead of the best of ours of the same kind, over the same records.

    ahead_on: on how many of them.  Accuracy is also compared over all kinds together, as "any kind"; time is not, since
    the least accurate methods are the fastest.
    """
    found = []
    for kind in ("any kind", *dict.fromkeys(row["kind"] for row in rows)):
        among = [row for row in rows if kind in ("any kind", row["kind"])]
        for column in columns(system, rows):
            if kind == "any kind" and column[0] == "ms":
                continue
            ours, others = (
                [row for row in among if row["ours"] is side and values(row, column).size] for side in (True, False)
            )
            ahead = []
            for row in others if ours else ():
                theirs = values(row, column)
                mine = min((values(one, column)[: theirs.size] for one in ours), key=lambda of: loss(of, column))
                theirs = theirs[: mine.size]
                if loss(theirs, column) < (1.0 - _TIE) * loss(mine, column):
                    won = np.count_nonzero(theirs > mine if column[0] == "fit_percent" else theirs < mine)
                    ahead.append((loss(theirs, column), row, theirs, mine, int(won)))
            if ahead:
                _, row, theirs, mine, won = min(ahead, key=lambda lead: lead[0])
                found.append(
                    {
                        "system": system,
                        "kind": kind,
                        "quantity": column[0],
                        "samples": column[1],
                        "peer": f"{row['peer']} {row['method']}",
                        "theirs": float(np.median(theirs)),
                        "ours": float(np.median(mine)),
                        "records": theirs.size,
                        "ahead_on": won,
                    }
                )
    return found


def columns(system: str, rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, int]]:
    """Quantity and record length of each column of a system's table."""
    lengths = {int(samples) for row in rows for samples in row["by_samples"]}
    return [(quantity, n) for quantity in (*_QUANTITIES, *ERRORS[system]) for n in sorted(lengths)]


def values(row: Mapping[str, Any], column: tuple[str, int]) -> np.ndarray:
    """The values of a row in a column, one for each record, from the first on."""
    return np.array(row["by_samples"].get(str(column[1]), {}).get(column[0], []))


def loss(found: np.ndarray, column: tuple[str, int]) -> float:
    """The median of a column's values, as a number that should be small; for a fit, its difference from 100."""
    return float(np.median(100.0 - found if column[0] == "fit_percent" else found))


def show(numbers: Mapping[str, Any]) -> None:
    """Print both tables, what is missing from them, and where another package is ahead."""
    console = wide_console()
    for system, rows in numbers["systems"].items():
        if rows:
            console.print(_table(system, rows))
    console.print(
        f"Medians over {numbers['seeds']} records (fewer: in brackets), threads: {numbers['threads']}. The fit is that "
        "of a free run on fresh data without noise. [bold]*[/bold]: best of its kind.\n"
        f"Measured: {', '.join(numbers['measured'])}."
    )
    if numbers["not_installed"]:
        console.print(f"Not installed: {', '.join(numbers['not_installed'])}; --make-peers installs them.")
    for failure in numbers["failed"]:
        console.print(f"Failed: {failure['peer']}, {failure['method']}: {failure['error']}", markup=False)
    for lead in numbers["ahead_of_ours"]:
        quantity = (_QUANTITIES | ERRORS[lead["system"]])[lead["quantity"]]
        console.print(
            f"Not first: {lead['system'].replace('_', ' ')}, {lead['kind']}, {quantity}, N {lead['samples']}: "
            f"{lead['peer']} {lead['theirs']:.4g}, ours {lead['ours']:.4g}; ahead on {lead['ahead_on']} of "
            f"{lead['records']} records."
        )
    if numbers["compared"] and not numbers["ahead_of_ours"]:
        console.print("Ours is first wherever another package is measured.")


def write_jobs(folder: Path, lengths: Sequence[int], seeds: int, budget_s: float) -> None:
    """Write the input of the runners: the settings, and the arrays of every record."""
    jobs = {"samples": lengths, "seeds": seeds, "budget_s": budget_s}
    (folder / "jobs.json").write_text(json.dumps(jobs), encoding="utf-8")
    for system in SYSTEMS:
        for samples in lengths:
            for seed in range(seeds):
                signals = measured(system, samples, seed)
                np.savez(folder / f"{system}_{samples}_{seed}.npz", u=signals.u, y=signals.y)


def _done(line: Mapping[str, Any]) -> int:
    return int("seconds" in line or "error" in line) + line.get("left", 0)


def _rows(peer: Peer, system: str, lines: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A row for each method: by length of record, each quantity of every record."""
    rows: dict[str, dict[str, Any]] = {}
    for line in lines:
        if "model" in line:
            row = rows.setdefault(
                line["method"],
                {
                    "peer": peer.name,
                    "ours": peer.ours,
                    "method": line["method"],
                    "kind": line["kind"],
                    "by_samples": {},
                },
            )
            of_length = row["by_samples"].setdefault(str(line["samples"]), {})
            times = {"ms": 1e3 * line["seconds"], "cpu_ms": 1e3 * line["cpu_s"]}
            for quantity, found in (times | score(system, line["model"], line["seed"])).items():
                of_length.setdefault(quantity, []).append(found)
    return list(rows.values())


def score(system: str, model: Mapping[str, Any], seed: int) -> dict[str, float]:
    """The error of a model against the truth, and its fit on fresh data from rest, for any package."""
    fresh = clean(system, FRESH_SAMPLES, seed)
    offset_u, offset_y = (np.asarray(model.get(key, 0.0)) for key in ("offset_u", "offset_y"))
    if system == "armax":
        a, b = np.asarray(model["a"]), np.asarray(model["b"])
        intercept = np.full(FRESH_SAMPLES, a.sum() * offset_y - b.sum() * offset_u)
        simulated = np.asarray(lfilter(b, a, fresh.u[:, 0])) + np.asarray(lfilter([1.0], a, intercept))
        errors = {"error_ab": coefficient_error(a[1:], b[1:])}
        if "c" in model:
            errors["error_abc"] = coefficient_error(a[1:], b[1:], model["c"][1:])
        return {"fit_percent": fit_percent(fresh.y, simulated[:, None]), **errors}
    a, b, c = (np.asarray(model[key]) for key in "abc")
    d = np.asarray(model.get("d", np.zeros((c.shape[0], b.shape[1]))))
    steady = np.linalg.lstsq(np.eye(len(a)) - a, -b @ np.broadcast_to(offset_u, b.shape[1]), rcond=None)[0]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable model scores -inf
        fit = fit_percent(fresh.y, dlsim((a, b, c, d, 1.0), fresh.u - offset_u, x0=steady)[1] + offset_y)
    return {"fit_percent": fit, "pole_error": largest_pole_error(a)}


def _table(system: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """A system's rows by kind, the best of each kind marked."""
    shown = columns(system, rows)
    lengths = " / ".join(dict.fromkeys(str(samples) for _, samples in shown))
    table = Table(title=f"{TITLES[system]}; N {lengths}")
    table.add_column("method", no_wrap=True)
    quantities = _QUANTITIES | ERRORS[system]
    for name in quantities.values():
        table.add_column(name, justify="right", no_wrap=True)
    for kind in dict.fromkeys(row["kind"] for row in rows):
        table.add_section()
        table.add_row(f"[italic]{kind}[/italic]")
        among = [row for row in rows if row["kind"] == kind]
        for row in among:
            name = escape(f"{row['peer']} {row['method']}")
            cells = [
                " / ".join(_cell(row, among, column) for column in shown if column[0] == quantity)
                for quantity in quantities
            ]
            table.add_row(f"  [bold]{name}[/bold]" if row["ours"] else f"  {name}", *cells)
    return table


def _cell(row: Mapping[str, Any], among: Sequence[Mapping[str, Any]], column: tuple[str, int]) -> str:
    """A row's median, marked if it is the best of those over as many records."""
    found = values(row, column)
    if not found.size:
        return "-"
    every = [values(other, column) for other in among]
    most = max(of.size for of in every)
    text = _FORMS.get(column[0], "{:.4f}").format(np.median(found))
    if found.size < most:
        return f"{text} ({found.size})" if column[0] == "ms" else text
    best = min(loss(of, column) for of in every if of.size == most)
    return f"[bold]*{text}[/bold]" if loss(found, column) == best else text
