"""How often diagnoses are right about logs whose truth is sealed: logs are drawn, diagnosed blindly, and scored.

Case k of a seed is the same in any run with the same sampling, except for families and kinds that are drawn only if
they are asked for. `--out` keeps logs, truths, diagnoses and scores; the same command with the same folder resumes a
run that was stopped.

In cases of the kinds `one_pushed` and `none_pushed`, unrecorded accelerations with correlation times of 5 to 120 s make
the free runs of the true vehicle err by as much as the noise of the leading sensor. Logs with `--sampling realistic`
begin and end at arbitrary times and have a gap, quantised readings, sensors of several rates, and outages.

    python -m scripts.blind_benchmark --cases 300 --jobs 2 --out blind
    python -m scripts.blind_benchmark --cases 20 --kind outside --family torpedo --out blind
    python -m scripts.blind_benchmark --cases 20 --family rov --family rov_attitude --out blind_rov
    python -m scripts.blind_benchmark --cases 20 --kind one_pushed --kind none_pushed --out blind_pushed
    python -m scripts.blind_benchmark --cases 20 --sampling realistic --out blind_realistic
    python -m scripts.blind_benchmark --first 200 --cases 100 --out blind
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from auv_gym.cli.options.console import errors, output
from scripts.blind.cases import FAMILIES, KINDS, Case, Undrawn, draw, sketch
from scripts.blind.sampling import EVEN, REALISTIC
from scripts.blind.scoring import score_folders
from scripts.blind.sealing import log_folder, seal, sealed_case, truth_folder
from scripts.blind.tables import misses_table, shares_tables, summary
from scripts.studies.runs import Failure, read_json, results_of, write_json

TIMEOUT = 300.0  # s
_ROOT = Path(__file__).resolve().parents[1]


def chosen(
    seed: int,
    cases: int,
    kinds: Sequence[str] | None,
    families: Sequence[str] | None,
    first: int = 0,
    sampling: str = EVEN,
) -> list[Case]:
    """The first `cases` cases of a seed, from number `first` on, that are of these kinds and families.

    Families that are not drawn by default are used in rotation, and so are the kinds if one of them is not.
    Raises ValueError if there are no cases of a kind and a family.
    """
    asked = [name for name in families or () if not FAMILIES[name].drawn]
    turns = list(kinds or ()) if any(KINDS[kind] == 0.0 for kind in kinds or ()) else []
    found, number = [], first
    while len(found) < cases:
        family = asked[number % len(asked)] if asked else ""
        kind = turns[number // max(len(asked), 1) % len(turns)] if turns else ""
        case = sketch(seed, number, family, kind, sampling)
        if (not kinds or case.kind in kinds) and (not families or case.family in families):
            found.append(case)
        number += 1
    return found


def run_case(case: Case, out: Path, timeout: float = TIMEOUT) -> dict[str, Any]:
    """The score of a case: drawn and sealed, diagnosed by a process that gets only the log's folder, then scored.

    Existing files in the folders are reused.  Raises ValueError if they are of another case with this number.
    """
    log, truth = log_folder(out, case.number), truth_folder(out, case.number)
    if not (truth / "truth.json").exists():
        seal(draw(case), out)
    elif sealed_case(truth) != case:
        raise ValueError(f"{truth} has a case of other kinds, families or sampling: choose another folder (--out).")
    if not (log / "diagnosis.json").exists():
        reason = _diagnose(log, timeout)
        if reason:
            return score_folders(log, truth, {"verdict": reason})
    return score_folders(log, truth, read_json(log / "diagnosis.json"))


def _diagnose(log: Path, timeout: float) -> str:
    """Run the process; return why there is no diagnosis, or ""."""
    command = [sys.executable, "-m", "scripts.blind.diagnosing", str(log.resolve())]
    try:
        done = subprocess.run(command, cwd=_ROOT, timeout=timeout, capture_output=True, text=True, check=False)
    except subprocess.TimeoutExpired:
        return "timeout"
    if done.returncode:
        (log / "crash.txt").write_text(done.stderr)
        return "crash"
    return ""


def run(cases: Sequence[Case], out: Path, jobs: int = 1, timeout: float = TIMEOUT) -> list[dict[str, Any]]:
    """The scores of these cases, in their order; each is stored in `out` as soon as it is ready.

    A case that cannot be drawn is left out with a message.
    """
    scores = []
    for found in results_of(_kept_score, [(case, out, timeout) for case in cases], jobs, "cases"):
        if isinstance(found, Failure):
            raise ValueError(found.reason)
        if "undrawn" in found:
            errors.print(found["undrawn"])
        else:
            scores.append(found)
    return scores


def _kept_score(case: Case, out: Path, timeout: float) -> dict[str, Any]:
    try:
        score = run_case(case, out, timeout)
    except Undrawn as error:
        return {"undrawn": str(error)}
    write_json(out / "scores" / f"{case.number:05d}.json", score)
    return score


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=300, help="how many (default 300)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (default 0)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--kind", action="append", choices=tuple(KINDS), help="only these; may be repeated")
    parser.add_argument("--family", action="append", choices=tuple(FAMILIES), help="only these; may be repeated")
    parser.add_argument("--sampling", choices=(EVEN, REALISTIC), default=EVEN, help=f"of the logs (default {EVEN})")
    parser.add_argument("--out", type=Path, required=True, help="folder of logs, truths, diagnoses and scores")
    parser.add_argument("--timeout", type=float, default=TIMEOUT, help=f"s for a diagnosis (default {TIMEOUT:g})")
    parser.add_argument("--json", type=Path, help="write shares and scores to this file as well")
    args = parser.parse_args(argv)
    if args.cases < 1 or args.first < 0 or args.jobs < 1 or not args.timeout > 0.0:
        parser.error("--cases, --jobs and --timeout must be positive, --first not negative")
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    out = args.out / f"seed_{args.seed}"
    (out / "scores").mkdir(parents=True, exist_ok=True)
    try:
        cases = chosen(args.seed, args.cases, args.kind, args.family, args.first, args.sampling)
        scores = run(cases, out, args.jobs, args.timeout)
    except ValueError as error:
        parser.error(str(error))
    for made in (*shares_tables(scores), misses_table(scores)):
        output.print(made)
    if len(scores) < len(cases):
        output.print(f"{len(cases) - len(scores)} of {len(cases)} cases could not be made.")
    if args.json:
        write_json(args.json, {"shares": summary(scores), "scores": scores})
    return 0


if __name__ == "__main__":
    sys.exit(main())
