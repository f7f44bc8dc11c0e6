"""The control case of Xu et al. 2013 on `heu_torpedo`: surge, heading and depth under S-plane, PID and GPC.

    python -m scripts.reproduce_s_plane --out figures

Surge from rest to 1.5 m/s; heading to 50 deg for 40 s, then back to 0; depth from 5 m to 10 m for 40 s, then back to
5 m; the last two at the speed of 3.5 V. Each run holds the other two channels with the same autopilot. Every seed
draws a current, and noise for all sensors; the three controllers meet the same ones. What is judged is the true motion.

Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, section 5.3, table 4, figures 11 to 16.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, pi, radians
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from auv_gym.channels import channel
from auv_gym.envs.task_env import TaskEnv
from auv_gym.model import Model
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import find_cruise
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from controllers.autopilots import autopilot
from controllers.trials.settling import Step, step_response
from identification.experiments.driving import Run, drive

VEHICLE = "heu_torpedo"
VOLTAGE = 3.5  # V, of the runs in heading and depth
CONTROLLERS = {"S-plane": "s_plane", "PID": "pid", "GPC": "gpc"}
CURRENT, UPDRAUGHT = 0.2, 0.03  # m/s, the fastest current that is drawn, horizontally and vertically
NOISE = {  # standard deviations of the sensors
    "depth": 0.02,  # m
    "compass": radians(0.5),
    "inclinometer": radians(0.2),
    "gyros": radians(0.2),  # rad/s
    "dvl_water": 0.02,  # m/s
}
BAND = 0.05  # of a step, either side of the target
BEND = 1e-9


@dataclass(frozen=True)
class Case:
    """A run: the channel that steps, the steps (time s, value) from a first value, and its length, s."""

    title: str
    channel: str
    first: float
    steps: tuple[tuple[float, float], ...]
    duration: float

    @property
    def legs(self) -> list[tuple[float, float, float]]:
        """Begin and end, s, and target of each step."""
        ends = [time for time, _ in self.steps[1:]] + [self.duration]
        return [(time, end, value) for (time, value), end in zip(self.steps, ends, strict=True)]


CASES = (
    Case("surge", "u_mps", 0.0, ((0.0, 1.5),), 40.0),
    Case("heading", "heading_rad", 0.0, ((0.0, radians(50.0)), (40.0, 0.0)), 80.0),
    Case("depth", "depth_m", 5.0, ((0.0, 10.0), (40.0, 5.0)), 80.0),
)


def speed_at(voltage: float, plant: Plant) -> float:
    """The steady forward speed at a voltage, m/s."""
    return find_cruise(replace_at(plant, "parts.propeller.design", voltage)).speed


def fly(case: Case, kind: str, seed: int | None, model: Model | None = None) -> Run:
    """The run of a case under a controller; seed None: without current and noise; model: in the vehicle's place."""
    plant = load_vehicle(VEHICLE)
    cruise = speed_at(VOLTAGE, plant)
    effects = {}
    if seed is not None:
        rng = np.random.default_rng(seed)
        speed, course = CURRENT * np.sqrt(rng.random()), rng.uniform(-pi, pi)
        effects = {"effects.current.north": speed * np.cos(course), "effects.current.east": speed * np.sin(course)}
        effects["effects.current.down"] = rng.uniform(-UPDRAUGHT, UPDRAUGHT)
        effects |= {f"effects.sampling.{sensor}.noise": value for sensor, value in NOISE.items()}
    env = TaskEnv(
        "Depth",
        plant,
        effects={name: float(value) for name, value in effects.items()},
        actions=("rudder_rad", "stern_plane_rad", "propeller_V"),
        duration=case.duration,
        model=model,
    )
    steady = {"depth_m": 5.0, "heading_rad": 0.0, "u_mps": cruise}
    targets = {name: ((0.0, value),) for name, value in steady.items()} | {case.channel: case.steps}
    start = {**steady, case.channel: case.first}
    return drive(env, autopilot(plant, kind), seed=0 if seed is None else seed, targets=targets, start=start)


def responses(case: Case, run: Run) -> list[Step]:
    """How the true motion followed each step."""
    time, values = run.truth.time, run.truth[case.channel]
    found, before = [], case.first
    for begin, end, target in case.legs:
        leg = (time >= begin - BEND) & (time < end - BEND)
        # the step is counted from the target before it, which the vehicle need not have reached to the last digit
        shown = values[leg].copy()
        shown[0] = before
        found.append(step_response(time[leg], shown, target, BAND * abs(target - before)))
        before = target
    return found


def tracking(case: Case, run: Run) -> float:
    """Root mean square difference of the true motion from its target, in the channel's unit."""
    time, values = run.truth.time, run.truth[case.channel]
    wanted = np.select(
        [time >= begin - BEND for begin, _, _ in reversed(case.legs)], [v for _, _, v in reversed(case.legs)]
    )
    return float(np.sqrt(np.mean((values - wanted) ** 2)))


def one(case: Case, name: str, seed: int) -> list[dict]:
    """A row for each step of a run."""
    run = fly(case, CONTROLLERS[name], seed)
    if run.reason:
        return [{"case": case.title, "controller": name, "seed": seed, "failed": run.reason}]
    rms, rows, before = tracking(case, run), [], case.first
    for (_, _, target), step in zip(case.legs, responses(case, run), strict=True):
        row = {"case": case.title, "controller": name, "seed": seed, "from": before, "to": target, "rms": rms}
        rows.append(row | step._asdict())
        before = target
    return rows


def study(seeds: Sequence[int], jobs: int, tell=None) -> list[dict]:
    """The rows of all cases, controllers and seeds."""
    work = [(case, name, seed) for case in CASES for name in CONTROLLERS for seed in seeds]
    rows: list[dict] = []
    with Parallel(jobs, return_as="generator") as pool:
        for found in pool(delayed(one)(*job) for job in work):
            rows += found
            if tell:
                tell(1.0 / len(work))
    return rows


def table(rows: Sequence[Mapping]) -> Table:
    """Settling, overshoot and tracking by step and controller: median over the seeds, and the worst."""
    shown = Table(
        title=f"Settling within {BAND:.0%} of the step; median (worst) over seeds",
        box=SIMPLE_HEAD,
        title_justify="left",
    )
    for name in ("step", "controller", "settling, s", "overshoot, %", "rms error of the run", "not settled"):
        shown.add_column(name, justify="left" if name in ("step", "controller") else "right", no_wrap=True)
    for case in CASES:
        unit, factor = ("deg", 180.0 / pi) if channel(case.channel).unit == "rad" else (channel(case.channel).unit, 1.0)
        before = case.first
        for _, _, target in case.legs:
            for name in CONTROLLERS:
                own = [r for r in rows if r["case"] == case.title and r["controller"] == name]
                mine = [r for r in own if r.get("to") == target]
                failed = sum("failed" in r for r in own)
                label = f"{case.title} {factor * before:g} to {factor * target:g} {unit}"
                if not mine:
                    shown.add_row(label, name, "-", "-", "-", f"{failed} runs cut short")
                    continue
                settling = np.array([r["settling_time"] for r in mine])
                over = np.array([100.0 * r["overshoot"] / abs(target - before) for r in mine])
                rms = factor * np.array([r["rms"] for r in mine])
                late = int(np.sum(~np.isfinite(settling)))
                shown.add_row(
                    label,
                    name,
                    f"{_middle(settling)} ({_number(settling.max())})",
                    f"{np.median(over):.1f} ({over.max():.1f})",
                    f"{np.median(rms):.3g} ({rms.max():.3g}) {unit}",
                    f"{late + failed} of {len(mine) + failed}",
                )
            before = target
        shown.add_section()
    return shown


def _middle(values: np.ndarray) -> str:
    return _number(float(np.sort(values)[values.size // 2]))


def _number(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "never"


def draw(out: Path, seed: int) -> Path:
    """Figures 11 to 16 of the paper in one: what each case measured and commanded under each controller."""
    from identification.pages.drawing import require_render

    require_render()
    from matplotlib.figure import Figure

    commands = {"u_mps": "propeller_V", "heading_rad": "rudder_rad", "depth_m": "stern_plane_rad"}
    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    axes = figure.subplots(len(CASES), 2, squeeze=False)
    for row, case in zip(axes, CASES, strict=True):
        for name, kind in CONTROLLERS.items():
            run = fly(case, kind, seed)
            for ax, source, what in ((row[0], run.truth, case.channel), (row[1], run.record, commands[case.channel])):
                _line(ax, source, what, name)
        scale = 180.0 / pi if channel(case.channel).unit == "rad" else 1.0
        times = [case.legs[0][0]] + [t for begin, end, _ in case.legs for t in (begin, end)]
        values = [case.first] + [v for _, _, target in case.legs for v in (target, target)]
        row[0].plot(times, scale * np.array(values), "k--", linewidth=1.0, label="target")
        if case.channel == "depth_m":
            row[0].invert_yaxis()
        row[0].legend(loc="best", fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("time, s")
    figure.suptitle(f"{VEHICLE}: current and sensor noise, seed {seed}")
    path = out / "control_case.png"
    with replacing(path) as new:
        figure.savefig(new, dpi=110, format="png")
    return path


def _line(ax, record: Record, name: str, label: str) -> None:
    known = channel(name)
    angle = known.unit == "rad"
    ax.plot(record.time, record[name] * (180.0 / pi if angle else 1.0), linewidth=1.0, label=label)
    ax.set_ylabel(f"{known.label}, {'deg' if angle else known.unit}")
    ax.grid(alpha=0.3)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print its table, draw the figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="runs of each case and controller (default 20)")
    parser.add_argument("--seed", type=int, default=0, help="the first of them")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--out", type=Path, help="folder for control_case.png and control_case.json")
    args = parser.parse_args(argv)
    if args.seeds < 1:
        parser.error(f"--seeds needs at least 1, got {args.seeds}")
    errors = Console(stderr=True)
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as bar:
        task = bar.add_task("flying", total=1.0)
        rows = study(range(args.seed, args.seed + args.seeds), args.jobs, lambda share: bar.advance(task, share))
    output = Console(width=max(Console().width, 110), highlight=False)
    output.print(table(rows))
    if args.out is not None:
        args.out.mkdir(parents=True, exist_ok=True)
        with replacing(args.out / "control_case.json") as new:
            new.write_text(json.dumps([{k: v if v != inf else None for k, v in r.items()} for r in rows], indent=1))
        output.print(str(draw(args.out, args.seed)), soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
