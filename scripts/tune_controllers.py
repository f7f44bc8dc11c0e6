"""Tune the gains of PID and S-plane loops of presets by simulation for the least cost, and write them to a file.

    python -m scripts.tune_controllers --out gains.toml

The same seed gives the same file. `auv-gym tune` tunes other vehicles, against requirements.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from auv_gym.cli.options.console import progress_bar, table
from auv_gym.model import Diverged
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from controllers.autopilots import autopilot
from controllers.gains import Gains, read_gains, with_gains, write_gains
from controllers.trials.settling import step_response
from controllers.trials.trial import NOISE
from controllers.tuning.bench import Bench, bench_of, segments, tried
from controllers.tuning.kinds import KINDS
from controllers.tuning.spread import CHANGE
from controllers.tuning.tuning import BAND, EVALUATIONS, tuned
from identification.pages.drawing import shown_values

BESIDES = {"npsauv": (4.0,)}  # s, sample times besides a preset's own; that of npsauv is from paper 1
PUBLISHED = {("heu_torpedo", 0.1): ("pid", "s_plane")}  # the vehicle of table 4 of Xu et al. 2013


def _piloted() -> list[str]:
    """The presets with autopilots."""
    bodies = {name: load_vehicle(name).family.body for name in list_vehicles()}
    return [name for name, body in bodies.items() if body is None or body.piloted]


def main(argv: Sequence[str] | None = None) -> int:
    """Tune the gains of presets, write them into a file, and print their results."""
    parser = argparse.ArgumentParser(description="Tune the gains of PID and S-plane loops by simulation.")
    parser.add_argument("--vehicle", nargs="+", metavar="NAME", help="presets or vehicle files (default: all presets)")
    parser.add_argument("--dt", type=float, help="sample time, s (default: the vehicle's; npsauv also 4 s)")
    parser.add_argument("--seed", type=int, default=0, help="of noise and changed coefficients (default 0)")
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, help="of the cost, per loop (default 40)")
    parser.add_argument("--s-plane", action="store_true", help="S-plane loops too (default: those of heu_torpedo)")
    parser.add_argument("--out", type=Path, default=Path("gains.toml"), help="entries of others stay in it")
    given = parser.parse_args(argv)
    try:
        plants = [
            load_vehicle(name, dt=dt)
            for name in given.vehicle or _piloted()
            for dt in ([given.dt] if given.dt or given.vehicle else [None, *BESIDES.get(name, ())])
        ]
        kept = read_gains(given.out) if given.out.exists() else ()
        rows = []
        with progress_bar() as show:
            for i, plant in enumerate(plants):
                bench = _bench(plant, given.seed)
                laws = ("pid", "s_plane") if given.s_plane else PUBLISHED.get((plant.name, plant.dt), ("pid",))
                gains = tuned(
                    bench,
                    given.evaluations,
                    lambda share, text, i=i: show((i + share) / len(plants), text),
                    laws,
                )
                rows += _reached(bench, gains)
                kept = with_gains(kept, gains)
                write_gains(kept, given.out)
    except (ValueError, Diverged) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    Console(highlight=False).print(_reached_table(rows))
    print(f"Written to {given.out}", file=sys.stderr)
    return 0


def _bench(plant: Plant, seed: int) -> Bench:
    """The bench with every main coefficient 20 % up or down, whatever its uncertainty, as for the file of gains."""
    kind, rng = KINDS.of(plant.family), np.random.default_rng(seed)
    # some occur twice: the later one counts, and both are drawn
    paths = [*plant.family.coefficients, *(path for path in kind.besides if path in list_paths(plant))]
    plants = [plant]
    for side in (1.0, -1.0):
        factors = (1.0 + CHANGE * rng.choice([-1.0, 1.0], len(paths))).tolist()
        changed = {path: value_at(plant, path) * factor for path, factor in zip(paths, factors, strict=True)}
        offsets = {path: side * value for path, value in kind.offsets(plant).items()}
        plants.append(replace_at(plant, changed | offsets))
    return bench_of(plant, seed).with_plants(plants)


def _reached(bench: Bench, gains: Gains) -> list[tuple[str, ...]]:
    """The result of each loop on the vehicle itself, with noise, in the first step of its target; m, deg and m/s."""
    rows, last = [], len(bench.plants)
    bench = bench._replace(plants=(*bench.plants, bench.plants[0]), starts=(*bench.starts, bench.starts[0]))
    for law in gains.loops:
        controller = autopilot(bench.plants[0], law, gains=gains)
        for name in bench.trial.steps:
            run = tried(bench, last, controller, name)  # with held-out noise
            part, target = next(segments(run, name))
            size = target - float(run[name][part][0])
            step = step_response(run["time_s"][part], run[name][part], target, max(BAND * abs(size), NOISE[name]))
            shown, *others = shown_values(name, np.array([size, step.overshoot, step.swing])).tolist()
            settled = f"{step.settling_time:.1f}" if step.settling_time < inf else "never"
            rows.append(
                (gains.vehicle, f"{gains.dt:g}", law, name.replace("_rad", "_deg"), f"{shown:.2f}", settled)
                + tuple(f"{value:.2f}" for value in others)
            )
    return rows


def _reached_table(rows: Sequence[tuple[str, ...]]) -> Table:
    shown = table("", "vehicle!", "dt, s>", "kind!", "channel!", "step>", "settled, s>", "over>", "swing>")
    for row in rows:
        shown.add_row(*row)
    return shown


if __name__ == "__main__":
    sys.exit(main())
