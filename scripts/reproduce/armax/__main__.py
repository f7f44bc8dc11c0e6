"""Geng and Zhao 2012, from the records of their experiment to predictive control of depth on the identified model.

    python -m scripts.reproduce.armax --out vertical_plane

Takes the records of `scripts/campaigns/vertical_plane.toml` from the folder, or performs missing runs, and prints and
draws:

- the orders that criteria choose (figures 2 and 3);
- the coefficients of the models with 7 and 8 parameters, next to table 2;
- how well free runs fit other data, pitch and depth differences (figures 11 and 12), also over further seeds, next to
  the limits set by the true linear form, the rounding of the readings and the number of parameters;
- GPC of depth on the identified models against GPC on the true linear form, all on the true vehicle.

The vehicle of the paper is not named; this is NPS AUV II.

Source: Geng and Zhao 2012, ICMIC, Wuhan, pp. 624-629, sections III to VI.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from auv_gym.channels import set_point_of
from auv_gym.cli.options.console import progress_bar
from auv_gym.model import Model
from auv_gym.models.linear.differences import rate_of, with_differences
from auv_gym.records.record import Record
from identification.pages.model_figures import rollout_figure
from scripts.reproduce.armax.models import DEPTH, PITCH, free_run
from scripts.reproduce.armax.records import VERIFY, records_of
from scripts.reproduce.armax.study import CONTROLLING, TAKEN, Progress, Records, Study, as_json, reached, study
from scripts.reproduce.armax.tables import sheets, verdict
from scripts.studies.harness import WIDTH, positive, write_pictures, write_sheets
from scripts.studies.runs import write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print and draw it; return 1 if the chosen model misses a target on the campaign's own seeds."""
    given = _parser().parse_args(argv)
    try:
        with progress_bar() as progress:
            progress(0.0, "the experiment")
            records = records_of(given.out, given.seed, given.jobs)
            further = _further(given.out, given.seed, given.seeds, given.jobs, progress)
            found = study(records, further, given.search, range(given.seed, given.seed + given.runs), progress)
            progress(1.0, "drawing")
            written = write_sheets(sheets(found), given.out) + write_pictures(_pictures(found, records), given.out)
        write_json(given.out / "armax.json", as_json(found))
    except (ValueError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    output = Console(width=max(Console().width, WIDTH), highlight=False)
    for sheet in sheets(found):
        output.print(sheet.printable())
    for line in (*verdict(found), *map(str, written), str(given.out / "armax.json")):
        output.print(line, soft_wrap=True)
    return int(not reached(row.fit for row in found.rows if row.model == TAKEN and row.fresh))


def _pictures(found: Study, records: Records) -> dict[str, Callable[[], Figure]]:
    fitted, fresh = sorted({seed for seed, _ in records})[:2]
    models = {name: found.fits[name, str(fitted)].model for name in CONTROLLING}
    return {
        "figures_11_and_12.png": lambda: verification_figure(models, records[fresh, VERIFY]),
    }


def verification_figure(models: Mapping[str, Model], record: Record) -> Figure:
    """Figures 11 and 12: pitch and depth differences of free runs over data that no fit has seen."""
    runs = {name: with_differences(free_run(model, record)[0], DEPTH) for name, model in models.items()}
    # the pitch set point of the depth loop is not needed here
    measured = with_differences(record.without([set_point_of(PITCH)]), DEPTH)
    return rollout_figure(measured, runs, (PITCH, rate_of(DEPTH)), "measured")


def _further(out: Path, seed: int, count: int, jobs: int, progress: Progress) -> Iterable[Records]:
    """Records of further seeds, two at a time, each pair in a folder of its own."""
    pairs = max(count + 1, 0) // 2
    for k in range(1, pairs + 1):
        progress(0.5 + 0.3 * (k - 1) / pairs, f"further seeds: {2 * k} of {2 * pairs}")
        yield records_of(out / "further" / str(seed + 2 * k), seed + 2 * k, jobs)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="folder of the campaign, which goes on, and of all results",
    )
    parser.add_argument("--seed", type=int, default=0, help="added to the campaign's seeds; first of control")
    parser.add_argument("--seeds", type=int, default=20, help="further seeds for the spread, in pairs (default 20)")
    parser.add_argument("--runs", type=positive, default=10, help="seeds of each controller (default 10)")
    parser.add_argument(
        "--search", choices=("armax", "arx"), default="armax", help="method of the search of orders; arx is quick"
    )
    parser.add_argument("--jobs", type=positive, default=2, help="processes of the campaign (default 2)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
