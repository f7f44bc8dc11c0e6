"""Mutation tests: whether the tests notice when a rule by which a diagnosis names an effect is removed.

    python -m scripts.mutants

A mutant is one change of one file, in a copy of the tree in a temporary folder. There the test that guards the rule is
run; `mutants.toml` lists the mutants. The program prints the test that noticed each mutant, and exits with 1 if any
mutant survives.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from auv_gym.cli.options.console import table

TREE = Path(__file__).parents[1]
LEFT_BEHIND = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "site", "shared", "demo-output")
LIST = Path(__file__).with_suffix(".toml")
WIDTH = 210  # columns that the table needs
# slow tests, too, in one process, up to the first failure
OPTIONS = ("-m", "", "-n", "0", "-x", "-q", "-rfE", "-p", "no:cacheprovider")
LIMIT = 900  # s for the tests of one mutant; those of the first one compile


@dataclass(frozen=True)
class Mutant:
    """A change that a test must notice: in a file, one text replaced by another.  test: the one that must fail."""

    name: str
    file: str
    old: str
    new: str
    test: str


@dataclass(frozen=True)
class Outcome:
    """The first test that noticed a mutant, or "" if it survived."""

    mutant: Mutant
    killed_by: str


def main(argv: Sequence[str] | None = None) -> int:
    """Run the mutants and print the table; return 1 if any survives."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", metavar="NAME", help="this mutant; may be given several times")
    given = parser.parse_args(argv)
    mutants = listed(LIST)
    names = [m.name for m in mutants]
    unknown = [name for name in given.only or () if name not in names]
    if unknown:
        print(f"Error: no mutant is called {', '.join(unknown)}; there are: {'; '.join(names)}.", file=sys.stderr)
        return 2
    chosen = [m for m in mutants if not given.only or m.name in given.only]
    try:
        outcomes = study(TREE, chosen, lambda text: print(text, file=sys.stderr, flush=True))
    except (ValueError, subprocess.TimeoutExpired) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 2
    survivors = sum(not o.killed_by for o in outcomes)
    shown = table(f"{len(outcomes)} mutants, {survivors} survived", "mutant!", "file!", "noticed by!")
    for outcome in outcomes:
        shown.add_row(outcome.mutant.name, outcome.mutant.file, outcome.killed_by.rpartition("/")[2] or "SURVIVED")
    Console(highlight=False, width=max(Console().width, WIDTH)).print(shown)
    return 1 if survivors else 0


def listed(file: Path) -> list[Mutant]:
    """The mutants of a TOML file."""
    return [Mutant(**entry) for entry in tomllib.loads(file.read_text(encoding="utf-8"))["mutant"]]


def study(tree: Path, mutants: Sequence[Mutant], told: Callable[[str], None]) -> list[Outcome]:
    """The outcome of each mutant of a tree; told: called with the progress.

    Raises ValueError if a text does not occur exactly once, a mutant is not valid Python, or a test fails without any
    mutant.
    """
    changed = [mutated(tree, m) for m in mutants]
    outcomes = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Path(folder) / "tree"
        shutil.copytree(tree, copy, ignore=LEFT_BEHIND)
        told("the tests without any mutant")
        failed = first_failure(copy, sorted({m.test for m in mutants}))
        if failed:
            raise ValueError(f"The tests must pass before any mutant, but {failed} fails: mend it first.")
        for number, (mutant, text) in enumerate(zip(mutants, changed, strict=True), 1):
            with replaced(copy / mutant.file, text):
                outcomes.append(Outcome(mutant, first_failure(copy, [mutant.test])))
            told(f"{number} of {len(mutants)}, {mutant.name}: {outcomes[-1].killed_by or 'SURVIVED'}")
    return outcomes


def mutated(tree: Path, mutant: Mutant) -> str:
    """The text of the mutant's file with its change; raises ValueError if that cannot be made."""
    text = (tree / mutant.file).read_text(encoding="utf-8")
    count = text.count(mutant.old)
    if count != 1:
        raise ValueError(
            f"The mutant {mutant.name!r} needs its text exactly once in {mutant.file}, found it {count} times: "
            f"{mutant.old!r}."
        )
    text = text.replace(mutant.old, mutant.new)
    try:
        compile(text, mutant.file, "exec")
    except SyntaxError as error:
        raise ValueError(f"The mutant {mutant.name!r} is no Python, line {error.lineno}: {error.msg}.") from None
    return text


@contextmanager
def replaced(file: Path, text: str) -> Iterator[None]:
    """Give a file another text until the end of the block."""
    before = file.read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    try:
        yield
    finally:
        file.write_text(before, encoding="utf-8")


def first_failure(tree: Path, tests: Sequence[str]) -> str:
    """The first of the tests that fails in a tree, or "" if none does; raises ValueError if they cannot be run."""
    # no bytecode is written: for a text of the same length and the same second, the old bytecode would be run
    settings = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", *OPTIONS, *tests]
    done = subprocess.run(command, cwd=tree, env=settings, capture_output=True, text=True, timeout=LIMIT, check=False)
    failed = re.search(r"^(?:FAILED|ERROR) ([^\s\[]+)", done.stdout, re.MULTILINE)
    if done.returncode == 0:
        return ""
    if done.returncode != 1 or failed is None:
        raise ValueError(f"The tests {', '.join(tests)} could not be run: {(done.stdout + done.stderr)[-2000:]}")
    return failed[1]


if __name__ == "__main__":
    sys.exit(main())
