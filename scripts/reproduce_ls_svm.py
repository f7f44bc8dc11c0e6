"""LS-SVM models of the torpedo AUV's hull: learned from bang-bang runs, flown beside the vehicle.

    python -m scripts.reproduce_ls_svm --seeds 5 --out figures            some 3 min
    python -m scripts.reproduce_ls_svm --seeds 20 --noisy --jobs 2        some 60 min

Bang-bang fins of 8 deg from rest at 4 V, and at 3 to 5 V; then circles with dives at 3.5 and 4.5 V with fins of 5 and
10 deg, and S-plane control of speed, heading and depth. With --noisy also models of other kinds, from the same noisy
records.

Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, pages 68-76: table 3 and figures 9 to 16.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from auv_gym.writing import replacing
from identification.pages.drawing import require_render
from scripts.ls_svm.pictures import draw
from scripts.ls_svm.study import DATA, learned, noisy, over_seeds
from scripts.ls_svm.surrogates import attempt
from scripts.ls_svm.tables import circles_table, control_table, noisy_table, tuned_table


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print its tables, draw its pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="experiments (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="the first of them (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--noisy", action="store_true", help="noisy records and other methods too")
    parser.add_argument("--out", type=Path, help="folder for pictures and ls_svm.json; default: none")
    given = parser.parse_args(argv)
    if given.seeds < 1 or given.jobs < 1:
        parser.error(f"--seeds and --jobs need at least 1, got {given.seeds} and {given.jobs}")
    seeds = range(given.seed, given.seed + given.seeds)
    console = Console(highlight=False, width=max(Console().width, 150))
    try:
        if given.out is not None:
            require_render()
            given.out.mkdir(parents=True, exist_ok=True)
        clean = over_seeds(DATA, seeds, given.jobs)
        joint, separate = learned("4 V", given.seed), learned("4 V", given.seed, separate=True)
        for shown in (tuned_table(joint, separate), circles_table(clean), control_table(clean)):
            console.print(shown)
        rows = noisy(attempt, seeds, given.jobs) if given.noisy else []
        if rows:
            console.print(noisy_table(rows))
        failed = Counter(f"{r['data']}, {r['method']}: {r['failed']}" for r in rows if "failed" in r)
        for reason, count in failed.items():
            console.print(f"{reason}: {count} of {given.seeds}", markup=False)
        if given.out is not None:
            with replacing(given.out / "ls_svm.json") as new:
                new.write_text(json.dumps({"clean": clean, "noisy": rows}, indent=1))
            for path in draw(joint.model, given.out, f"from bang-bang fins at 4 V, seed {given.seed}"):
                console.print(f"Written to {path}", markup=False, soft_wrap=True)
    except (ValueError, OSError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
