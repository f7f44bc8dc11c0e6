"""Diagnoses of measured logs with defaults: verdict, names and error on unseen data, compared with other programs.

    python -m scripts.real_logs --data DIR
    python -m scripts.real_logs --data DIR --peers .peers --make-peers --only SG561

The logs of three Slocum gliders come with dbdreader; DIR has the others, and logs that are not there are left out. Each
result is a file under --out, and is computed only once (delete the file to repeat it). docs/real_logs.md and its
picture are written from all results there. --summary prints a short table instead.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from auv_gym.cli.options.console import errors, output
from auv_gym.writing import writable_folder, write_text
from scripts.benchmarks.peers.environments import make
from scripts.pages.marked import with_marked
from scripts.real.dives import GLIDERFLIGHT
from scripts.real.log import Log, Places
from scripts.real.logs import LOGS
from scripts.real.tables import figure, left_out, sheets, summary
from scripts.studies.harness import write_pictures
from scripts.studies.runs import Failure, read_json, results_of

PAGE = Path(__file__).parents[1] / "docs" / "real_logs.md"
PICTURE = "real_logs.png"


def result_of(log: Log, places: Places) -> dict:
    """The result of a log as plain data; raises ValueError if there is none."""
    return log.run(log, places)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of measured logs")
    parser.add_argument("--out", type=Path, default=Path("figures/real_logs"), help="folder of results (%(default)s)")
    parser.add_argument("--only", default="", help="logs whose name contains this")
    parser.add_argument("--page", type=Path, default=PAGE, help="page whose tables are written (%(default)s)")
    parser.add_argument("--summary", action="store_true", help="print the results in short, and diagnose nothing")
    parser.add_argument("--peers", type=Path, default=Path(".peers"), help="environments of others (%(default)s)")
    parser.add_argument("--make-peers", action="store_true", help="make the environment of gliderflight, with pip")
    args = parser.parse_args(argv)
    folder, failed = writable_folder(args.out), {}
    kept = {
        log.name: folder / f"{log.name.replace(':', '_').replace(', ', '_').replace(' ', '_')}.json" for log in LOGS
    }
    if not args.summary:
        if args.make_peers:
            make(args.peers, [GLIDERFLIGHT])
        places = Places(args.data, args.peers)
        for log in (one for one in LOGS if args.only in one.name):
            missing = [] if kept[log.name].exists() else log.missing(args.data)
            if missing:
                errors.print(f"{log.name} is left out: {missing[0]} is not in {args.data}.", markup=False)
                continue
            (result,) = results_of(result_of, [(log, places)], 1, log.name, [kept[log.name]])
            if isinstance(result, Failure):
                failed[log.name] = result.reason
                errors.print(f"{log.name} has no result: {result.reason}", markup=False)
    results = [(log, read_json(kept[log.name])) for log in LOGS if kept[log.name].exists()]
    if args.summary:
        output.print("\n".join(summary(results)), markup=False, soft_wrap=True)
        return 0
    if results:
        text = "\n".join(
            [*(sheet.markdown() for sheet in sheets(results)), "**Left out, cut or assumed**\n", *left_out(results)]
        )
        write_text(args.page, with_marked(args.page.read_text(encoding="utf-8"), "tables of real logs", text))
        pictures = write_pictures({PICTURE: lambda: figure(results)}, args.page.parent / "images")
        output.print(f"Written to {args.page} and {pictures[0]}", markup=False, soft_wrap=True)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
