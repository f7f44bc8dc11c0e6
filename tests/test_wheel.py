"""The wheel: what is in it, and that it works where the source tree is not."""

import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("auv_gym", "controllers", "identification")
DATA = (".toml", ".html", ".pyi", ".yml")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    pytest.importorskip("hatchling", reason="the extra `test` is not installed")
    out = tmp_path_factory.mktemp("dist")
    make = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", make, str(out)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The Python of a new environment with the wheel in it; what the wheel needs it finds where this Python has it."""
    folder = tmp_path_factory.mktemp("clean")
    venv.create(folder)
    python = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check", "install", "-q"]
    subprocess.run([*pip, "--no-deps", "--no-index", wheel], check=True, capture_output=True, env=clean(folder))
    # A path in a .pth file comes last, and .pth files there are not read: an editable auv_gym there is not seen.
    theirs = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        check=True,
        capture_output=True,
        text=True,
    )
    (Path(theirs.stdout.strip()) / "needed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def clean(folder: Path) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return kept | {"AUV_GYM_CACHE": str(folder / "compiled"), "COLUMNS": "120"}


def run(python: Path, *words: str, jit: bool = False) -> str:
    """What a program of the new environment prints, in a folder of its own."""
    folder = python.parents[1]
    environment = clean(folder) | {"AUV_GYM_JIT": str(int(jit))}
    done = subprocess.run(
        [python.parent / words[0], *words[1:]], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_it_holds_every_module_preset_and_template(wheel):
    inside = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix == ".py" or path.suffix in DATA or path.name == "py.typed"
    }
    assert {f"{package}/py.typed" for package in PACKAGES} <= wanted
    assert "auv_gym/vehicles/presets/slocum.toml" in wanted
    assert wanted - inside == set()
    assert "auv_gym_autoload.pth" in inside
    assert not any(name.startswith(("tests", "scripts", "docs", "examples")) for name in inside)


def test_gymnasium_finds_the_environments_without_an_import(installed):
    code = (
        "import gymnasium; env = gymnasium.make('auv_gym/Depth-v0'); print(len(env.reset(seed=0)[0]));"
        "import auv_gym; print(auv_gym.__file__)"
    )
    size, file = run(installed, "python", "-c", code).split()
    assert size == "6"
    assert Path(file).is_relative_to(installed.parents[1])


def test_the_command_lists_what_there_is(installed):
    text = run(installed, "auv-gym", "list")
    assert all(name in text for name in ("slocum", "remus100", "effects.rudder.offset", "heading_rad", "grey_box"))


def test_it_exports(installed):
    assert "Written to remus100.sdf" in run(installed, "auv-gym", "export", "remus100", "--to", "sdf")


def test_the_citation_is_of_this_version():
    """What Citation File Format 1.2.0 requires, and the version of the package."""
    yaml = pytest.importorskip("yaml", reason="the extra `rl` is not installed")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["cff-version"] == "1.2.0"
    assert citation["authors"] == [{"name": "The auv-gym authors"}]
    assert citation["type"] == "software"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])


@pytest.mark.slow
def test_it_simulates_and_diagnoses(installed):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    told = ["--effect", "effects.rudder.deadband=0.06", "--duration", "600", "--seed", "2", "--out", "log.nc"]
    run(installed, "auv-gym", "simulate", "slocum", *told, jit=True)
    run(installed, "auv-gym", "diagnose", "log.nc", "--vehicle", "slocum", "--out", "result", jit=True)
    result = installed.parents[1] / "result"
    assert json.loads((result / "diagnosis.json").read_text())["effects"][0]["path"] == "effects.rudder.deadband"
    assert "<svg" in (result / "report.html").read_text()
