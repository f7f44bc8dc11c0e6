"""The examples run from top to bottom, and their notebooks are what their scripts say."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.notebooks import EXAMPLES, notebook_of

SCRIPTS = sorted(EXAMPLES.glob("*.py"))
LEAVES = {
    "campaign": {"campaign.png"},
    "diagnosis": {"log_and_model.png", "result"},
    "environment_loop": {"environment_loop.png"},
    "policy": {"policies", "policy.png"},
    "predictive_control": {"predictive_control.png"},
}
# blocks of the tutorials on campaigns and diagnoses are run, too; of the environment loop the notebook is run below
SLOW = {"policy", "campaign", "diagnosis", "environment_loop", "predictive_control"}
named = pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
run = [pytest.param(path, marks=[pytest.mark.slow] * (path.stem in SLOW), id=path.stem) for path in SCRIPTS]


@pytest.mark.parametrize("script", run)
def test_it_runs_and_leaves_its_picture(script, tmp_path):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    if "import casadi" in script.read_text():
        pytest.importorskip("casadi", reason="the extra `casadi` is not installed")
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, script], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == LEAVES[script.stem]
    assert all(path.is_dir() or path.stat().st_size > 10_000 for path in tmp_path.iterdir())


@named
def test_its_notebook_is_in_step(script):
    pytest.importorskip("jupytext", reason="the extra `test` is not installed")
    assert script.with_suffix(".ipynb").read_text() == notebook_of(script), "Run: python -m scripts.notebooks"


def test_there_is_no_other_notebook():
    assert [path.with_suffix(".py") for path in sorted(EXAMPLES.glob("*.ipynb"))] == SCRIPTS


@pytest.mark.slow
def test_a_notebook_runs(tmp_path):
    """One is enough: all come from scripts that are run."""
    nbclient = pytest.importorskip("nbclient", reason="the extra `test` is not installed")
    nbformat = pytest.importorskip("nbformat", reason="the extra `test` is not installed")
    pytest.importorskip("ipykernel", reason="the extra `test` is not installed")
    copied = Path(shutil.copy(EXAMPLES / "environment_loop.ipynb", tmp_path))
    book = nbformat.read(copied, as_version=4)
    nbformat.validate(book)
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    printed = "".join(out.get("text", "") for cell in book.cells for out in cell.get("outputs", []))
    assert "PID" in printed
    assert (tmp_path / "environment_loop.png").exists()
