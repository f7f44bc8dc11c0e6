"""The common frame of studies: from data and a function of case and seed to a command line, tables and pictures.

    python -m scripts.studies.NAME --seeds 20 --jobs 2 --out FOLDER

With --out, every finished run is a file in FOLDER/runs, and the same command resumes a study that was stopped. Tables
are written as results.md and CSV files, pictures as PNG. Without --out, the tables are printed and nothing is stored.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from auv_gym.cli.options.console import table
from auv_gym.model import Diverged
from auv_gym.writing import replacing, writable_folder, write_text
from scripts.studies.runs import Failure, read_json, results_of, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 150  # least width of tables, columns
KEPT = "study.json"


@dataclass(frozen=True)
class Option:
    """A setting that affects the results of a study, beside case and seed.

    least: of a number.  several: whether it is a list of values.
    """

    default: Any
    help: str
    choices: tuple[str, ...] | None = None
    least: float | None = None
    several: bool = False


@dataclass(frozen=True)
class Sheet:
    """A table of text; heads as in `auv_gym.cli.options.console.table`; an empty row begins a section.

    name: of its CSV file.  printed: whether it is also printed and included in results.md.
    """

    name: str
    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    printed: bool = True

    def printable(self) -> Table:
        shown = table(escape(self.title), *self.heads)
        for row in self.rows:
            if row:
                shown.add_row(*(escape(cell) for cell in row))
            else:
                shown.add_section()
        return shown

    def markdown(self) -> str:
        marks = ["--:" if head.endswith(">") else "---" for head in self.heads]
        lines = [self._names(), marks, *(row for row in self.rows if row)]
        cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in line] for line in lines]
        return f"**{self.title}**\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in cells) + "\n"

    def csv(self) -> str:
        text = StringIO()
        csv.writer(text, lineterminator="\n").writerows([self._names(), *(row for row in self.rows if row)])
        return text.getvalue()

    def _names(self) -> list[str]:
        return [head.rstrip(">!").replace("\n", " ") for head in self.heads]


@dataclass(frozen=True)
class Found:
    """The findings of a study: results by case and seed, as plain data, and the options that they depend on.

    failed: by case and seed, why a run has no result.
    """

    runs: Mapping[str, Mapping[int, Any]]
    options: Mapping[str, Any]
    failed: Mapping[tuple[str, int], str] = field(default_factory=dict)
    folder: Path | None = None

    def of(self, case: str) -> list[Any]:
        """The results of a case, in the order of the seeds."""
        return list(self.runs.get(case, {}).values())


def _every(case: str, seeds: Sequence[int]) -> Sequence[int]:
    return seeds


def _nothing(found: Found) -> list[str]:
    return []


def _good(found: Found) -> bool:
    return True


@dataclass(frozen=True)
class Study:
    """The definition of a study.

    about: the docstring of its module.  attempt: the result of a case and seed, with the options by name, as plain data
    (also dataclasses and arrays); ValueError or Diverged says why there is none.  one_of: the command-line name of a
    case, "" if it cannot be chosen; usual: the default cases, else all; any_case: whether names outside `cases` may be
    given.  seeds: default number; None: nothing is random.  seeds_of: those of a case.
    pictures: by file name.  good: whether the findings are as expected, else the program returns 1.  facts:
    dependencies of the results beside the options.  keeps: whether runs write files of their own; `attempt` is then
    given the folder, as `out`.
    """

    about: str
    attempt: Callable[..., Any]
    cases: Sequence[str]
    sheets: Callable[[Found], Sequence[Sheet]]
    seeds: int | None = 1
    first_seed: int = 0
    one_of: str = "case"
    usual: Sequence[str] | None = None
    any_case: bool = False
    seeds_of: Callable[[str, Sequence[int]], Sequence[int]] = _every
    options: Mapping[str, Option] = field(default_factory=dict)
    remarks: Callable[[Found], list[str]] = _nothing
    pictures: Callable[[Found], Mapping[str, Callable[[], Figure]]] | None = None
    good: Callable[[Found], bool] = _good
    facts: Mapping[str, Any] = field(default_factory=dict)
    keeps: bool = False
    doing: str = "runs"

    def find(
        self,
        seeds: Sequence[int],
        cases: Sequence[str] | None = None,
        *,
        jobs: int = 1,
        out: Path | None = None,
        **options: Any,
    ) -> Found:
        """Run what is not stored in `out`; raises ValueError if that holds another study, or if all runs failed."""
        chosen = {name: option.default for name, option in self.options.items()} | options
        for name, option in self.options.items():
            given = chosen[name] if option.several else [chosen[name]]
            if option.least is not None and not all(value >= option.least for value in given):
                raise ValueError(f"--{name} needs {option.least:g} or more, got {', '.join(map(str, given))}.")
        tasks = [(case, seed) for case in self._chosen(cases) for seed in self.seeds_of(case, seeds)]
        kept = None
        if out is not None:
            begin(out, {"study": self.about.partition("\n")[0], "options": chosen, **self.facts})
            kept = [out / "runs" / f"{quote(case, safe=' ,()=+')} seed {seed}.json" for case, seed in tasks]
        told = chosen | ({"out": out} if self.keeps else {})
        results = results_of(partial(self.attempt, **told), tasks, jobs, self.doing, kept)
        runs: dict[str, dict[int, Any]] = {}
        failed = {}
        for (case, seed), result in zip(tasks, results, strict=True):
            if isinstance(result, Failure):
                failed[case, seed] = result.reason
            else:
                runs.setdefault(case, {})[seed] = result
        if tasks and not runs:
            raise ValueError("No run has a result. " + " ".join(dict.fromkeys(failed.values())))
        return Found(runs, chosen, failed, out)

    def _chosen(self, cases: Sequence[str] | None) -> Sequence[str]:
        """The cases of these names or patterns, by default all; raises if there is none."""
        found: dict[str, None] = {}
        for name in self.usual or self.cases if cases is None else cases:
            matching = [case for case in self.cases if fnmatchcase(case, name)] or [name] * self.any_case
            if not matching:
                raise ValueError(f"No {self.one_of} is called {name!r}; there are: {'; '.join(self.cases)}.")
            found |= dict.fromkeys(matching)
        return list(found)

    def main(self, argv: Sequence[str] | None = None) -> int:
        """Run the study, print its tables, write them and its pictures; return 1 if something failed or is not good."""
        given = vars(self._parser().parse_args(argv))
        first, seeds = given.pop("seed", 0), given.pop("seeds", 1)
        jobs, out = given.pop("jobs"), given.pop("out")
        cases = given.pop("cases", None)
        console, written = Console(highlight=False, width=max(Console().width, WIDTH)), []
        try:
            found = self.find(range(first, first + seeds), cases, jobs=jobs, out=out, **given)
            sheets = self.sheets(found)
            for sheet in sheets:
                if sheet.printed:
                    console.print(sheet.printable())
            for line in self.remarks(found):
                console.print(line, markup=False, soft_wrap=True)
            if out is not None:
                written = write_sheets(sheets, out)
                written += write_pictures(self.pictures(found), out) if self.pictures is not None else []
        except (ValueError, OSError, ImportError, Diverged) as error:
            print(f"Error: {error}", file=sys.stderr)
            return 1
        for path in written:
            console.print(f"Written to {path}", markup=False, soft_wrap=True)
        for (case, seed), reason in found.failed.items():
            console.print(f"{case}, seed {seed}: {reason}", markup=False, soft_wrap=True)
        return int(bool(found.failed) or not self.good(found))

    def _parser(self) -> argparse.ArgumentParser:
        parser = argparse.ArgumentParser(description=self.about, formatter_class=argparse.RawDescriptionHelpFormatter)
        if self.seeds is not None:
            parser.add_argument(
                "--seeds", type=positive, default=self.seeds, help="runs of a case (default %(default)s)"
            )
            parser.add_argument(
                "--seed", type=int, default=self.first_seed, help="the first of them (default %(default)s)"
            )
        parser.add_argument("--jobs", type=positive, default=1, help="processes (default %(default)s)")
        parser.add_argument("--out", type=Path, required=self.keeps, help="folder that keeps runs, tables and pictures")
        if self.one_of:
            usual = "all" if self.usual is None else "; ".join(self.usual)
            words = f"names or patterns such as '*' ({'; '.join(self.cases)}; default: {usual})".replace("%", "%%")
            parser.add_argument(f"--{self.one_of}", dest="cases", nargs="+", metavar="NAME", help=words)
        for name, option in self.options.items():
            kind = None if option.default is None or option.choices else type(_first(option.default))
            parser.add_argument(
                f"--{name.replace('_', '-')}",
                type=kind or (str if option.choices else float),
                default=option.default,
                choices=option.choices,
                nargs="+" if option.several else None,
                help=f"{option.help} (default %(default)s)",
            )
        return parser


def _first(value: Any) -> Any:
    return value[0] if isinstance(value, (list, tuple)) else value


def positive(text: str) -> int:
    """A positive count from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"needs a whole number of at least 1, got {text}")
    return int(text)


def begin(out: Path, facts: Mapping[str, Any]) -> None:
    """Record the dependencies of the results in the folder; raises if it holds results with other settings."""
    writable_folder(out / "runs")
    wanted = json.loads(json.dumps(facts))
    if not (out / KEPT).is_file():
        write_json(out / KEPT, wanted)
    elif read_json(out / KEPT) != wanted:
        raise ValueError(
            f"{out} holds results of a study with other settings (see {KEPT} there): give another --out, or the same "
            "settings."
        )


def write_sheets(sheets: Sequence[Sheet], out: Path) -> list[Path]:
    """Write results.md and a CSV file for each table; return the files."""
    texts = {"results.md": "\n".join(sheet.markdown() for sheet in sheets if sheet.printed)}
    texts |= {f"{sheet.name}.csv": sheet.csv() for sheet in sheets}
    for name, text in texts.items():
        write_text(out / name, text)
    return [out / name for name in texts]


def write_pictures(pictures: Mapping[str, Callable[[], Figure]], out: Path) -> list[Path]:
    """Draw pictures into a folder by their file names; return the files.  Raises ImportError without matplotlib."""
    from identification.pages.drawing import STYLE, require_render

    require_render()
    from matplotlib import rc_context

    out.mkdir(parents=True, exist_ok=True)
    for name, draw in pictures.items():
        with rc_context(STYLE), replacing(out / name) as new:
            draw().savefig(new, format="png", dpi=110, facecolor="white", pil_kwargs={"optimize": True})
    return [out / name for name in pictures]
