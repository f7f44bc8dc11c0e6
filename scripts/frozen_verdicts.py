"""Frozen logs diagnosed again, and the changes of each case against its stored verdict.

    python -m scripts.frozen_verdicts FOLDER --out again
    python -m scripts.frozen_verdicts FOLDER --out again --baseline tests/frozen/verdicts.json
    python -m scripts.frozen_verdicts FOLDER --out again --write tests/frozen/verdicts.json

FOLDER holds a folder for each case with log.nc, vehicle.toml, frame.json and verdict.json. It may also hold
`truth/CASE/truth.json`, which shows which verdict is right. Without --baseline, verdict.json of each case is compared.
Changes are other verdicts, new or missing names, other ties, other remainders, and sizes that moved by more than a
tenth of their 95 % interval; the exit status is 1 if there are any. `--out` keeps the diagnoses: the same command
resumes a run that was stopped.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_gym.cli.options.console import errors, output, table
from auv_gym.vehicles.former import current_torpedo_path
from scripts.blind.diagnosing import diagnose_folder
from scripts.blind.scoring import score
from scripts.studies.runs import Failure, read_json, results_of, write_json

MOVED = 0.1  # share of a size's 95 % interval beyond which it counts as changed


@dataclass(frozen=True)
class Change:
    """A case before and now.

    changes: in words, empty if nothing has changed.  right: before and now, None if the truth is not available.
    """

    case: str
    vehicle: str
    before: str
    now: str
    changes: tuple[str, ...]
    right: tuple[bool, bool] | None


def brief(said: Mapping[str, Any]) -> dict[str, Any]:
    """The compared content of a diagnosis, given as its JSON: the verdict, effects with their intervals, and ties."""
    return {
        "verdict": said["verdict"],
        "effects": {e["path"]: [e["value"], *e["ci95"]] for e in said.get("effects", ())},
        "tied": sorted(sorted(group) for group in said.get("tied", ())),
        "unexplained": bool(said.get("unexplained")),
        "coefficients_wrong": sorted(
            c["path"] if isinstance(c, Mapping) else c for c in said.get("coefficients_wrong") or ()
        ),
        "seconds": said.get("seconds"),
    }


def renamed(told: Any) -> Any:
    """A stored brief with the present paths of parameters."""
    if isinstance(told, Mapping):
        return {current_torpedo_path(key): renamed(value) for key, value in told.items()}
    if isinstance(told, list):
        return [renamed(value) for value in told]
    return current_torpedo_path(told) if isinstance(told, str) else told


def changes_of(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, ...]:
    """The differences between two briefs, in words."""
    found = []
    if before["verdict"] != now["verdict"]:
        found.append(f"{before['verdict']} -> {now['verdict']}")
    if before["unexplained"] != now["unexplained"]:
        found.append("something is left" if now["unexplained"] else "nothing is left any more")
    old, new = before["effects"], now["effects"]
    found += [f"gone: {_short(path)}" for path in old if path not in new]
    found += [f"new: {_short(path)}" for path in new if path not in old]
    for path in old:
        if path in new and abs(new[path][0] - old[path][0]) > MOVED * (old[path][2] - old[path][1]):
            share = abs(new[path][0] - old[path][0]) / (old[path][2] - old[path][1])
            found.append(f"{_short(path)}: {old[path][0]:.4g} -> {new[path][0]:.4g} ({share:.1f} intervals)")
    if before["tied"] != now["tied"]:
        found += [f"tie gone: {_listed(group)}" for group in before["tied"] if group not in now["tied"]]
        found += [f"tie new: {_listed(group)}" for group in now["tied"] if group not in before["tied"]]
    return tuple(found)


def compare(folder: Path, case: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> Change:
    """The change of one case, with the correctness of both verdicts if its truth is available."""
    sealed, right = folder / "truth" / case / "truth.json", None
    if sealed.exists():
        truth = renamed(read_json(sealed))
        right = tuple(bool(score(_as_said(one), truth)["right"]) for one in (before, now))
    vehicle = next(
        (line for line in (folder / case / "vehicle.toml").read_text().splitlines() if line.startswith("name")), ""
    )
    name = vehicle.partition("=")[2].strip().strip('"')
    return Change(case, name, before["verdict"], now["verdict"], changes_of(before, now), right)


def run(folder: Path, cases: Sequence[str], out: Path, jobs: int) -> dict[str, dict[str, Any]]:
    """The brief of each case's diagnosis by today's code; each is stored in `out` as soon as it is ready."""
    kept = [out / f"{case}.json" for case in cases]
    found = dict(zip(cases, results_of(_brief_of, [(folder / case,) for case in cases], jobs, "cases", kept)))
    for case, result in found.items():
        if isinstance(result, Failure):
            raise ValueError(f"Case {case} could not be diagnosed: {result.reason}")
    return found


def _brief_of(folder: Path) -> dict[str, Any]:
    return brief(diagnose_folder(folder))


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose the cases and print the changes; return 1 if there are any."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="of the frozen cases")
    parser.add_argument("--out", type=Path, required=True, help="folder that keeps what was diagnosed")
    parser.add_argument("--baseline", type=Path, help="verdicts that --write wrote; default: each case's verdict.json")
    parser.add_argument("--write", type=Path, help="write the verdicts to this file, as a new baseline")
    parser.add_argument("--case", action="append", help="only these, such as 00012; may be repeated")
    parser.add_argument("--jobs", type=int, default=2, help="processes, 1 or more (default 2)")
    args = parser.parse_args(argv)
    if args.jobs < 1:
        parser.error(f"--jobs needs at least 1, got {args.jobs}")
    cases = sorted(path.parent.name for path in args.folder.glob("*/log.nc"))
    for case in args.case or ():
        if case not in cases:
            parser.error(f"{args.folder} has no case {case!r}; it has {', '.join(cases[:5])}, ...")
    cases = [case for case in cases if not args.case or case in args.case]
    if not cases:
        parser.error(f"{args.folder} holds no cases: give a folder of folders with log.nc, vehicle.toml and frame.json")
    stored = read_json(args.baseline) if args.baseline else {}
    before = {}
    for case in cases:
        own = args.folder / case / "verdict.json"
        if case in stored:
            before[case] = renamed(stored[case])
        elif not args.baseline and own.exists():
            before[case] = renamed(brief(read_json(own)))
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    args.out.mkdir(parents=True, exist_ok=True)
    now = run(args.folder, cases, args.out, args.jobs)
    made = [compare(args.folder, case, before[case], now[case]) for case in cases if case in before]
    _print(made, [case for case in cases if case not in before])
    if args.write:
        write_json(args.write, now)
    return int(any(change.changes for change in made))


def _print(made: Sequence[Change], missing: Sequence[str]) -> None:
    shown = table("Frozen logs, what has changed", "case!", "vehicle", "before", "now", "changes", "right before, now")
    for change in made:
        if change.changes:
            right = "" if change.right is None else ", ".join("yes" if one else "no" for one in change.right)
            shown.add_row(change.case, change.vehicle, change.before, change.now, "\n".join(change.changes), right)
    output.print(shown)
    same = sum(not change.changes for change in made)
    output.print(f"{same} of {len(made)} cases as before.")
    known = [change.right for change in made if change.right is not None]
    if known:
        output.print(
            f"Right before {sum(one for one, _ in known)}, now {sum(other for _, other in known)} of {len(known)}."
        )
    if missing:
        errors.print(f"Without a stored verdict, so not compared: {', '.join(missing)}.")


def _as_said(made: Mapping[str, Any]) -> dict[str, Any]:
    """A brief in the form of a diagnosis's JSON, for the scoring."""
    effects = [{"path": path, "value": v, "ci95": [low, high]} for path, (v, low, high) in made["effects"].items()]
    return {**made, "effects": effects}


def _listed(group: Sequence[str]) -> str:
    return " or ".join(map(_short, group))


def _short(path: str) -> str:
    return path.removeprefix("effects.")


if __name__ == "__main__":
    sys.exit(main())
