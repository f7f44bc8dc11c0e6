"""Geng and Zhao 2012 from the records of their experiment to predictive control of depth on the identified model.

    python -m scripts.reproduce_armax --out vertical_plane

Takes the records of `scripts/campaigns/vertical_plane.toml` from the folder, or performs the runs that it lacks, and
prints and draws:

- what criteria choose as orders (figures 2 and 3);
- the coefficients of the model with 7 and 8 parameters beside table 2;
- how free runs fit other data, pitch and depth differences (figures 11 and 12), over further seeds too, beside what the
  true linear form, the rounding of the readings and the number of parameters allow;
- GPC of depth on the identified models against GPC on the true linear form, all on the true vehicle.

The vehicle of the paper is not named; this is NPS AUV II.

Source: Geng and Zhao 2012, ICMIC, Wuhan, pp. 624-629, sections III to VI.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console

from auv_gym.cli.options.console import progress_bar
from auv_gym.writing import replacing
from scripts.armax.study import FLOWN, TAKEN, Progress, Records, Study, as_json, reached, study
from scripts.armax.tables import tables, verdict
from scripts.reproduce_vertical_plane import VERIFY, records_of


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print and draw it; 1 if the model taken misses a target on the campaign's own seeds."""
    given = _parser().parse_args(argv)
    try:
        if min(given.seeds, given.jobs, given.runs - 1) < 0 or given.jobs < 1:
            raise ValueError(
                f"Needed --seeds from 0, --runs and --jobs from 1, got {given.seeds}, {given.runs} and {given.jobs}."
            )
        with progress_bar() as progress:
            progress(0.0, "the experiment")
            records = records_of(given.out, given.seed, given.jobs)
            found = study(
                records,
                _further(given.out, given.seed, given.seeds, given.jobs, progress),
                given.search,
                range(given.seed, given.seed + given.runs),
                progress,
            )
            progress(1.0, "drawing")
            pictures = _draw(found, records, given.out)
        with replacing(given.out / "armax.json") as new:
            new.write_text(json.dumps(as_json(found), indent=1), encoding="utf-8")
    except (ValueError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps(as_json(found), indent=1))
    else:
        output = Console(width=max(Console().width, 130), highlight=False)
        for shown in tables(found):
            output.print(shown)
        for line in verdict(found):
            output.print(line, soft_wrap=True)
        for path in (*pictures, given.out / "armax.json"):
            output.print(str(path), soft_wrap=True)
    return int(not reached(row.fit for row in found.rows if row.model == TAKEN and row.fresh))


def _draw(found: Study, records: Records, out: Path) -> list[Path]:
    from identification.pages.drawing import require_render
    from scripts.armax.pictures import draw_control, draw_orders, draw_verification

    require_render()
    fitted, fresh = sorted({seed for seed, _ in records})[:2]
    models = {name: found.fits[name, str(fitted)].model for name in FLOWN}
    return [
        draw_orders(found.search, out / "figures_2_and_3.png"),
        draw_verification(models, records[fresh, VERIFY], out / "figures_11_and_12.png"),
        draw_control(found.motions, out / "depth_control.png"),
    ]


def _further(out: Path, seed: int, count: int, jobs: int, progress: Progress) -> Iterable[Records]:
    """Records of further seeds, two at a time, each pair in a folder of its own."""
    pairs = (count + 1) // 2
    for k in range(1, pairs + 1):
        progress(0.5 + 0.3 * (k - 1) / pairs, f"further seeds: {2 * k} of {2 * pairs}")
        yield records_of(out / "further" / str(seed + 2 * k), seed + 2 * k, jobs)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the campaign, which goes on; pictures and armax.json too"
    )
    parser.add_argument("--seed", type=int, default=0, help="added to the campaign's seeds; first that is flown")
    parser.add_argument("--seeds", type=int, default=20, help="further seeds for the spread, in pairs (default 20)")
    parser.add_argument("--runs", type=int, default=10, help="seeds that each controller flies (default 10)")
    parser.add_argument(
        "--search", choices=("armax", "arx"), default="armax", help="method of the search of orders; arx is quick"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes of the campaign (default 2)")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    return parser


if __name__ == "__main__":
    sys.exit(main())
