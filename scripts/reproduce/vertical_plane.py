"""The experiment of Geng and Zhao 2012 from its campaign file, with figures 5 to 10 of the paper drawn from it.

    python -m scripts.reproduce.vertical_plane --out vertical_plane

Runs `scripts/campaigns/vertical_plane.toml` (or goes on with it), says how far depth and pitch went, and draws the bow
and stern planes, pitch and depth of the 600 s that identify (figures 5 to 8) and the planes of the 800 s that verify (9
and 10), for the first seed and the second. The vehicle of the paper is not named; this is NPS AUV II.

Source: Geng and Zhao 2012, ICMIC, Wuhan, pp. 624-629, section V.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from auv_gym.cli import main as auv_gym
from auv_gym.records.record import Record
from identification.campaign.file.reading import read_campaign
from identification.campaign.index import Row, read_index, run_file
from identification.campaign.running.conduct import conduct
from scripts.studies.harness import positive, write_pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILE = Path(__file__).parents[1] / "campaigns" / "vertical_plane.toml"
LENGTH = "experiment.duration_s"
IDENTIFY, VERIFY = 600.0, 800.0  # s
DEPTH, DEPTH_LIMIT, PITCH_LIMIT = 50.0, 10.0, 5.0  # m, m, deg
PANELS = (
    ("5", IDENTIFY, "bow_plane_rad", "bow plane, deg"),
    ("6", IDENTIFY, "stern_plane_rad", "stern plane, deg"),
    ("7", IDENTIFY, "pitch_rad", "pitch, deg"),
    ("8", IDENTIFY, "depth_m", "depth from 50 m, m"),
    ("9", VERIFY, "bow_plane_rad", "bow plane, deg"),
    ("10", VERIFY, "stern_plane_rad", "stern plane, deg"),
)


def records_of(
    folder: Path, seed: int = 0, jobs: int = 1, progress: Callable[[float, str], object] = lambda share, text: None
) -> dict[tuple[int, float], Record]:
    """The campaign's records by seed and length, s; runs that the folder lacks are performed.

    seed: added to the seeds of the campaign.  Raises ValueError if a run did not go as planned.
    """

    def told(done: int, total: int, failed: int, text: str) -> None:
        progress(done / max(total, 1), text)

    rows = conduct(read_campaign(FILE, seed), folder, jobs=jobs, progress=told).rows
    failed = [row for row in rows if not row.usable]
    if failed:
        raise ValueError(
            f"Needed all runs of {FILE.name}, got {len(failed)} that did not go as planned, the first {failed[0].id}: "
            f"{failed[0].status}, {failed[0].reason}. Delete its file in {folder} and run again."
        )
    return {(row.seed, row.cell[LENGTH]): Record.load(row.path(folder)) for row in rows}


def shown(record: Record, name: str) -> np.ndarray:
    """A channel as the figures have it: angles in deg, depth from where it is held."""
    return record[name] - DEPTH if name == "depth_m" else np.degrees(record[name])


def excursions(rows: Sequence[Row], folder: Path) -> list[tuple[str, float, float, float]]:
    """For each run: what it is, the largest depth from where it is held, m, the largest pitch, deg, guarded share."""
    found = []
    for row in rows:
        record = Record.load(run_file(folder, row.id))
        pitch, depth = np.abs(shown(record, "pitch_rad")).max(), np.abs(shown(record, "depth_m")).max()
        what = f"{row.cell[LENGTH]:g} s, seed {row.seed}"
        found.append((what, float(depth), float(pitch), float(record["envelope_flag"].mean())))
    return found


def figure(records: dict[float, Record]) -> Figure:
    """The figures, each in a panel of one picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    for axes, (number, length, name, label) in zip(figure.subplots(3, 2).flat, PANELS, strict=True):
        record = records[length]
        values = shown(record, name)
        held = name.endswith("plane_rad")
        axes.plot(record.time, values, drawstyle="steps-post" if held else "default", linewidth=0.9)
        limit = {"pitch_rad": PITCH_LIMIT, "depth_m": DEPTH_LIMIT}.get(name)
        if limit is not None:
            for side in (-limit, limit):
                axes.axhline(side, color="0.5", linestyle="--", linewidth=0.8)
        if name == "depth_m":
            axes.invert_yaxis()
        what = "identification" if length == IDENTIFY else "verification"
        axes.set_title(f"Fig. {number}: {what}", fontsize=10)
        axes.set_ylabel(label)
        axes.set_xlabel("time, s")
    figure.suptitle("npsauv, vertical plane: PRBS at both planes and the set point, samples of 4 s; dashed: limits")
    return figure


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign, print the excursions, draw the figures; 1 if a limit was broken."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the campaign; figures_5_to_10.png goes there"
    )
    parser.add_argument("--seed", type=int, default=0, help="added to the seeds of the campaign (default 0)")
    parser.add_argument("--jobs", type=positive, default=2, help="processes (default 2)")
    parser.add_argument("--runs-only", action="store_true", help="no fits and no report")
    args = parser.parse_args(argv)
    only = ["--only", "runs"] if args.runs_only else []
    done = auv_gym(
        ["campaign", str(FILE), "--out", str(args.out), "--jobs", str(args.jobs), "--seed", str(args.seed), *only]
    )
    if done:
        return done
    output, rows = Console(highlight=False), read_index(args.out)
    broken = False
    for what, depth, pitch, guarded in excursions(rows, args.out):
        broken |= depth > DEPTH_LIMIT or pitch > PITCH_LIMIT
        output.print(f"{what}: depth within {depth:.1f} m, pitch within {pitch:.1f} deg; guard acted {guarded:.1%}")
    seeds = dict(zip((IDENTIFY, VERIFY), sorted({row.seed for row in rows}), strict=True))
    records = {
        length: Record.load(run_file(args.out, row.id))
        for row in rows
        for length, seed in seeds.items()
        if row.cell[LENGTH] == length and row.seed == seed
    }
    (path,) = write_pictures({"figures_5_to_10.png": lambda: figure(records)}, args.out)
    output.print(str(path), soft_wrap=True)
    return int(broken)


if __name__ == "__main__":
    sys.exit(main())
