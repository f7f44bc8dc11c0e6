"""The wheel: what is in it, and that it works where the source tree is not, alone and with each extra."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.markdown_blocks import Block, blocks_of

ROOT = Path(__file__).parents[1]
PACKAGES = ("auv_gym", "controllers", "identification")
DATA = (".toml", ".html", ".pyi", ".yml")
DEVELOPERS = {"dev", "docs", "test"}  # extras whose packages work on the source tree


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
    own = {"compiled": "AUV_GYM_CACHE", "minari": "MINARI_DATASETS_PATH"}
    return kept | {variable: str(folder / name) for name, variable in own.items()} | {"COLUMNS": "120"}


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


# With each extra in an empty environment: the example that README or docs give for it.


def blocks(page: str, word: str) -> list[Block]:
    """The blocks of a page that contain a word."""
    return [block for block in blocks_of((ROOT / page).read_text()) if word in block.text]


def type_commands(python: Path, page: str, word: str) -> list[str]:
    """What the commands of the page's blocks that contain a word print."""
    commands = [shlex.split(line) for block in blocks(page, word) if block.runs for line in block.commands]
    assert commands
    return [run(python, *words, jit=words[1] == "diagnose") for words in commands]


def prints_what_the_page_says(python: Path, page: str, word: str) -> None:
    (block,) = blocks(page, word)
    assert block.printed
    assert run(python, "python", "-c", block.text).split() == block.printed.split()


def refused(python: Path, *words: str) -> str:
    """The error with which a command ends."""
    folder = python.parents[1]
    done = subprocess.run(
        [python.parent / words[0], *words[1:]], cwd=folder, env=clean(folder), capture_output=True, text=True
    )
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stderr


def look(python: Path, log: str | Path, *words: str) -> None:
    text = run(python, "auv-gym", "look", str(log))
    assert all(word in text for word in words), text


def readme(python: Path) -> None:
    """README's glider with an offset rudder: log, first look and report."""
    type_commands(python, "README.md", "auv-gym simulate")
    type_commands(python, "README.md", "auv-gym diagnose")
    result = python.parents[1] / "result"
    assert json.loads((result / "diagnosis.json").read_text())["effects"][0]["path"] == "effects.rudder.offset"
    assert "<svg" in (result / "report.html").read_text()


def without_extras(python: Path) -> None:
    (said,) = type_commands(python, "README.md", "auv-gym simulate")
    assert "mission.csv" in said
    look(python, "mission.csv", "rudder_rad", "slocum")
    assert "'.[slocum]'" in refused(python, "auv-gym", "look", "slocum:ammonite")


def ardupilot(python: Path) -> None:
    from tests.records.readers.ardupilot_logs import tlog

    look(python, tlog(python.parents[1]), "MAVLink", "ATTITUDE.roll", "roll_rad")


def px4(python: Path) -> None:
    from tests.records.readers.test_ulog import write

    look(python, write(python.parents[1] / "log.ulg"), "PX4 ULog", "vehicle_attitude.q[0]")


def ros(python: Path) -> None:
    from tests.records.readers.ros_logs import sample, write_mcap, write_ros1, write_ros2

    folder = python.parents[1]
    look(python, write_ros1(folder / "log.bag", sample(True)), "ROS 1", "mavros/imu/data")
    look(python, write_ros2(folder / "bag", sample(False)), "ROS 2", "mavros/imu/data")
    look(python, write_mcap(folder / "log.mcap", sample(False)), "MCAP", "mavros/imu/data")


def seawater(python: Path) -> None:
    rows = "".join(f"{k},{10 + k},{43.5 + 1e-5 * k}\n" for k in range(60))
    (python.parents[1] / "pressure.csv").write_text("time_s,pressure_dbar,latitude_deg\n" + rows)
    look(python, "pressure.csv", "depth_m", "TEOS-10")


def slocum(python: Path) -> None:
    look(python, "slocum:ammonite", "1.77 h", "rudder_rad")


def logs(python: Path) -> None:
    for reads in (ardupilot, px4, ros, seawater, slocum):
        reads(python)


def rl(python: Path) -> None:
    """Both commands of the first block, without the picture, which needs `render`."""
    first = blocks("docs/rl.md", "auv-gym train")[0]
    train, evaluate = (shlex.split(line) for line in first.commands)
    run(python, *train, "--steps", "4096", jit=True)
    assert "'.[render]'" in refused(python, *evaluate)
    assert evaluate[-2] == "--picture"
    assert "gpc" in run(python, *evaluate[:-2], "--episodes", "4", jit=True)


def casadi(python: Path) -> None:
    prints_what_the_page_says(python, "docs/exports.md", "casadi_model(")


def control(python: Path) -> None:
    prints_what_the_page_says(python, "docs/exports.md", "control_system(")


def minari(python: Path) -> None:
    run(python, "auv-gym", "simulate", "slocum", "--duration", "200", "--out", "dives.nc")
    (said,) = re.findall(r"`auv-gym (export slocum --to minari [^`]+)`", (ROOT / "docs/exports.md").read_text())
    assert "slocum/dives-v0" in run(python, "auv-gym", *shlex.split(said))
    count = "import minari; print(minari.load_dataset('slocum/dives-v0').total_episodes)"
    assert run(python, "python", "-c", count).split() == ["1"]


def distributed(python: Path) -> None:
    text = (ROOT / "scripts" / "campaigns" / "small.toml").read_text()
    (python.parents[1] / "small.toml").write_text(text.replace("400.0", "80.0"))
    code = (
        "import sys; from distributed import LocalCluster; from auv_gym.cli import main\n"
        "with LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:\n"
        "    sys.exit(main(['campaign', 'small.toml', '--out', 'out', '--only', 'runs', '--scheduler',"
        " cluster.scheduler_address]))"
    )
    assert "6 of 6 runs done" in run(python, "python", "-c", code)


EXAMPLES: dict[str, Callable[[Path], None]] = {
    "": without_extras,
    "ardupilot": ardupilot,
    "casadi": casadi,
    "control": control,
    "distributed": distributed,
    "logs": logs,
    "minari": minari,
    "px4": px4,
    "render": readme,
    "rl": rl,
    "ros": ros,
    "seawater": seawater,
    "slocum": slocum,
}


def test_every_extra_for_users_has_an_example_here():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(EXAMPLES) - {""} == set(project["optional-dependencies"]) - DEVELOPERS


@pytest.fixture(scope="module")
def index(tmp_path_factory) -> None:
    """A package index that answers: the smallest dependency can be downloaded anew."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--retries", "1", "--timeout", "20"]
    pip += ["download", "-q", "--no-deps", "--no-cache-dir", "-d", str(tmp_path_factory.mktemp("probe"))]
    done = subprocess.run([*pip, "lazy-loader"], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no package index answers: {done.stderr.strip().splitlines()[-1]}")


@pytest.fixture
def empty(index, tmp_path):
    """The Python of an environment without any package, not even pip; it is deleted after the test."""
    folder = tmp_path / "empty"
    venv.create(folder)
    yield folder / "bin" / "python"
    shutil.rmtree(folder)


@pytest.mark.slow
@pytest.mark.parametrize("extra", EXAMPLES)
def test_the_example_of_an_extra_runs_with_nothing_else_installed(extra, wheel, empty):
    pip = [sys.executable, "-m", "pip", "--python", empty, "--disable-pip-version-check", "install", "-q"]
    asked = f"{wheel}[{extra}]" if extra else str(wheel)
    done = subprocess.run(
        [*pip, "--no-compile", "-c", "constraints.txt", asked],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env=clean(empty.parents[1]),
    )
    assert done.returncode == 0, done.stderr
    EXAMPLES[extra](empty)
