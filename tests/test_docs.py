"""Every block of code in README.md and docs/ runs, and prints what the page says that it prints."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from auv_gym.cli import main
from auv_gym.plant import load_vehicle
from auv_gym.rl.hyperparameters import checked
from identification.campaign.file.reading import read_campaign
from tests.markdown_blocks import Block, blocks_of

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
WIDTH = 100
# Run uncompiled, in a process of their own: nothing else has their vehicle, and compiling it takes a minute.
PLAIN = ("docs/guides/add_a_part.md",)

BLOCKS = {str(page.relative_to(ROOT)): blocks_of(page.read_text()) for page in PAGES}
RUN = [name for name, blocks in BLOCKS.items() if any(b.runs and not b.slow for b in blocks)]
SLOW = [name for name, blocks in BLOCKS.items() if any(b.runs and b.slow for b in blocks)]
TOML = [(name, b) for name, blocks in BLOCKS.items() for b in blocks if b.kind == "toml"]

YAML = [(name, b) for name, blocks in BLOCKS.items() for b in blocks if b.kind == "yaml"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder as a reader of the page would have it, with the repository's scripts beside."""
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    import matplotlib

    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("auv_gym.cli.options.console.output.width", WIDTH)
    monkeypatch.setattr("auv_gym.cli.options.console.errors.width", WIDTH)
    (tmp_path / "scripts").symlink_to(ROOT / "scripts")
    return tmp_path


@pytest.mark.parametrize("page", [str(page.relative_to(ROOT)) for page in PAGES])
def test_pages_install_from_a_clone_since_no_index_has_the_package(page):
    assert re.findall(r"pip install.*auv-gym.*", (ROOT / page).read_text()) == []


# what these two run, tests of the command line run, too
LONG = ("docs/tutorials/campaign.md", "docs/tutorials/log_and_model.md")


@pytest.mark.parametrize("page", [pytest.param(p, marks=[pytest.mark.slow] if p in LONG else []) for p in RUN])
def test_blocks_run(page, folder):
    run_page(page, [block for block in BLOCKS[page] if not block.slow])


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW)
def test_slow_blocks_run(page, folder):
    run_page(page, BLOCKS[page])


@pytest.mark.parametrize("page, block", [pytest.param(p, b, id=f"{p}:{b.line}") for p, b in TOML])
def test_settings_are_valid(page, block, tmp_path):
    """A campaign is read as one, a vehicle as one; what belongs into another file is TOML at least."""
    content = tomllib.loads(block.text)
    assert content
    file = tmp_path / "block.toml"
    file.write_text(block.text)
    if "experiment" in content:
        assert read_campaign(file).name == content["name"]
    elif "family" in content:
        assert load_vehicle(file).name == content["name"]


@pytest.mark.parametrize("page, block", [pytest.param(p, b, id=f"{p}:{b.line}") for p, b in YAML])
def test_hyperparameters_are_valid(page, block):
    yaml = pytest.importorskip("yaml", reason="the extra `rl` is not installed")
    for name, values in yaml.safe_load(block.text).items():
        assert checked(values, name).n_timesteps > 0


def test_what_is_not_run_says_why():
    """Only what installs, learns for minutes, or needs a file that is not here."""
    unrun = {name: [b.mark for b in blocks if b.mark.startswith("not run")] for name, blocks in BLOCKS.items()}
    reasons = {mark.removeprefix("not run: ") for marks in unrun.values() for mark in marks}
    writes = "writes to the reader's folder of data sets"
    assert reasons <= {
        "installs",
        "needs your log",
        "needs the extra rl and minutes",
        "needs a package installed",
        writes,
    }
    assert sum(len(marks) for marks in unrun.values()) < 0.2 * sum(b.runs for bs in BLOCKS.values() for b in bs)


def test_every_block_of_code_has_a_language_that_is_checked():
    known = {"setup", "python", "sh", "toml", "yaml", "text", "diff"}
    assert [(name, b.line, b.kind) for name, blocks in BLOCKS.items() for b in blocks if b.kind not in known] == []


def test_the_architecture_names_files_that_there_are():
    kept = ("auv_gym", "controllers", "identification", "scripts", "docs", "examples", "tests")
    files = [path for folder in kept for path in (ROOT / folder).rglob("*")] + list(ROOT.glob("*"))
    paths = [path.relative_to(ROOT).as_posix() + "/" * path.is_dir() for path in files]
    named = set(re.findall(r"`([\w./-]+(?:\.(?:pyi?|toml|md)|/))`", (ROOT / "docs/architecture.md").read_text()))
    assert len(named) > 100
    assert sorted(name for name in named if not any(f"/{path}".endswith(f"/{name}") for path in paths)) == []


def run_page(page: str, blocks: list[Block]) -> None:
    """Run blocks in order in one namespace; compare what they print."""
    if any(block.kind == "diff" for block in blocks):
        run_edited(page, blocks)
        return
    if page in PLAIN:
        run_plain(page, blocks)
        return
    names: dict = {"__name__": "__main__"}
    for block in blocks:
        if block.title:
            Path(block.title).write_text(block.text)
        if not block.runs:
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            if block.kind == "sh":
                for command in block.commands:
                    run_command(command, f"{page}:{block.line}")
            else:
                source = "\n" * block.line + block.text
                exec(compile(source, str(ROOT / page), "exec"), names)
        if block.printed is not None:
            assert lines_of(printed.getvalue()) == lines_of(block.printed), f"{page}:{block.line} prints something else"


def run_edited(page: str, blocks: list[Block]) -> None:
    """Make the page's changes in a copy of the package, and run its Python there."""
    shutil.copytree(ROOT / "auv_gym", "auv_gym", ignore=shutil.ignore_patterns("__pycache__"))
    for block in blocks:
        if block.kind == "diff":
            file = Path(block.title)
            rows = block.text.splitlines(keepends=True)
            old, new = ("".join(row[1:] for row in rows if row[0] in signs) for signs in (" -", " +"))
            assert file.read_text().count(old) == 1, f"{page}:{block.line} does not fit {file}"
            file.write_text(file.read_text().replace(old, new))
    run_plain(page, blocks)


def run_plain(page: str, blocks: list[Block]) -> None:
    """Write the files of a page, run its Python in a process of its own, uncompiled, and compare what it prints."""
    for block in blocks:
        if block.title and block.kind != "diff":
            Path(block.title).write_text(block.text)
    python = [block for block in blocks if block.kind == "python" and block.runs]
    paths = os.pathsep.join((str(Path.cwd()), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": paths, "AUV_GYM_JIT": "0"}
    code = "".join(block.text for block in python)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, f"{page}: {done.stderr}"
    assert lines_of(done.stdout) == lines_of("".join(block.printed or "" for block in python)), done.stdout


def run_command(command: str, where: str) -> None:
    words = shlex.split(command)
    assert words[0] == "auv-gym", f"{where}: only auv-gym is run, got {command!r}: mark the block `not run: WHY`."
    assert main(words[1:]) == 0, f"{where}: {command}"


def lines_of(text: str) -> list[str]:
    """Lines without trailing blanks and empty ones; seconds that something took are left out."""
    lines = [re.sub(r"in \d+(\.\d+)? s\b", "in ... s", line.rstrip()) for line in text.splitlines()]
    return [line for line in lines if line]
