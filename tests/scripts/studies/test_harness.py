"""The frame of all studies: runs are kept and never done twice, tables are files, bad input is refused in words."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from scripts.studies.harness import Found, Option, Sheet, Study, begin
from scripts.studies.runs import results_of

ABOUT = "A study of sums.\n\nMore."


def summed(case, seed, size=3):
    """A number that depends on all there is; the case "bad" has none for seed 1."""
    if case == "bad" and seed == 1:
        raise ValueError("one is a bad seed")
    draws = np.random.default_rng([seed, len(case)]).random(size)
    return {"sum": draws.sum(), "parts": draws, "process": os.getpid()}


def sheets(found):
    rows = [[case, f"{np.mean([one['sum'] for one in found.of(case)]):.6f}"] for case in found.runs]
    return [Sheet("sums", "Sums", ("case!", "mean>"), rows), Sheet("more", "More", ("x",), [["1"]], printed=False)]


STUDY = Study(ABOUT, summed, ("good", "bad | worse"), sheets, seeds=2, options={"size": Option(3, "of a sum", least=1)})


def values(found):
    return {case: {seed: one["parts"] for seed, one in runs.items()} for case, runs in found.runs.items()}


def test_two_processes_find_what_one_finds():
    one, two = STUDY.find(range(4)), STUDY.find(range(4), jobs=2)
    assert values(one) == values(two)
    assert list(two.runs["good"]) == [0, 1, 2, 3]
    assert len({run["process"] for runs in two.runs.values() for run in runs.values()}) == 2


def test_a_stopped_study_goes_on_with_nothing_run_twice(tmp_path):
    begun = []

    def stopped(case, seed, size):
        begun.append((case, seed))
        if len(begun) == 4:
            raise KeyboardInterrupt
        return summed(case, seed, size)

    study = Study(ABOUT, stopped, STUDY.cases, sheets, options=STUDY.options)
    with pytest.raises(KeyboardInterrupt):
        study.find(range(3), out=tmp_path)
    assert len(list((tmp_path / "runs").iterdir())) == 3
    found = study.find(range(3), out=tmp_path)
    assert begun == [*((c, s) for c in STUDY.cases for s in range(3))][:4] + begun[3:4] + begun[5:]
    assert len(begun) == 7  # six, and the one that was stopped
    assert values(found) == values(STUDY.find(range(3)))
    study.find(range(4), ["g*"], out=tmp_path)
    assert begun[7:] == [("good", 3)]


def test_a_killed_study_leaves_whole_files_and_keeps_them(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from scripts.studies.harness import Study\n"
        "def slow(case, seed):\n    time.sleep(0.1); return {'seed': seed, 'long': [0.5] * 20000}\n"
        "Study('x', slow, ('a',), lambda found: []).find(range(200), jobs=2, out=Path(sys.argv[1]))"
    )
    paths = os.pathsep.join([str(Path(__file__).parents[3]), *sys.path])
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], env={**os.environ, "PYTHONPATH": paths}, start_new_session=True
    )
    deadline = time.monotonic() + 120.0
    while len(list(tmp_path.glob("runs/*.json"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").glob("*.json")}
    assert 3 <= len(kept) < 200
    assert all(len(json.loads(path.read_text())["long"]) == 20000 for path in kept)
    again = Study("x", lambda case, seed: {"seed": seed}, ("a",), lambda found: [])
    assert [one["seed"] for one in again.find(range(50), out=tmp_path).of("a")] == list(range(50))
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_what_is_no_plain_data_leaves_no_file(tmp_path):
    with pytest.raises(TypeError, match="plain data, got object"):
        results_of(lambda seed: {"fine": 1.0, "not": object()}, [(0,)], 1, "x", [tmp_path / "one.json"])
    assert not list(tmp_path.iterdir())


def test_a_run_that_fails_is_told_and_tried_again(tmp_path, capsys):
    study = Study(ABOUT, summed, ("good", "bad"), sheets, seeds=2)
    assert study.main(["--out", str(tmp_path)]) == 1
    assert "bad, seed 1: one is a bad seed" in capsys.readouterr().out
    assert len(list((tmp_path / "runs").iterdir())) == 3
    assert study.find(range(2), out=tmp_path).failed == {("bad", 1): "one is a bad seed"}
    with pytest.raises(ValueError, match=r"No run has a result. one is a bad seed"):
        study.find(range(1, 2), ["bad"])


def test_tables_are_printed_and_written(tmp_path, capsys):
    drawn = Study(ABOUT, summed, STUDY.cases, sheets, remarks=lambda found: ["[all] well"], pictures=_pictures)
    assert drawn.main(["--out", str(tmp_path), "--seeds", "3"]) == 0
    printed = capsys.readouterr().out
    means = {case: np.mean([one["sum"] for one in drawn.find(range(3)).of(case)]) for case in STUDY.cases}
    for case, mean in means.items():
        assert f"{case}" in printed
        assert f"{mean:.6f}" in printed
    assert "[all] well" in printed
    assert "More" not in printed
    with (tmp_path / "sums.csv").open() as file:
        assert list(csv.reader(file)) == [["case", "mean"], *([c, f"{m:.6f}"] for c, m in means.items())]
    assert (tmp_path / "more.csv").is_file()
    assert f"| bad \\| worse | {means['bad | worse']:.6f} |" in (tmp_path / "results.md").read_text()
    assert (tmp_path / "line.png").read_bytes()[:4] == b"\x89PNG"


def _pictures(found: Found):
    def line():
        from matplotlib.figure import Figure

        figure = Figure()
        figure.subplots().plot([one["sum"] for one in found.of("good")])
        return figure

    return {"line.png": line}


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--seeds", "0"], "--seeds: needs a whole number of at least 1, got 0"),
        (["--jobs", "x"], "--jobs: needs a whole number of at least 1, got x"),
        (["--case", "ugly"], "No case is called 'ugly'; there are: good; bad | worse."),
        (["--size", "0"], "--size needs 1 or more, got 0"),
    ],
)
def test_bad_input_is_refused_in_words(arguments, words, capsys):
    try:
        code = STUDY.main(arguments)
    except SystemExit as stopped:
        code = stopped.code
    assert code in (1, 2)
    assert words in capsys.readouterr().err


def test_a_folder_holds_one_study(tmp_path, capsys):
    STUDY.find(range(1), ["good"], out=tmp_path)
    assert STUDY.main(["--out", str(tmp_path), "--size", "4"]) == 1
    assert "other settings (see study.json there)" in capsys.readouterr().err
    begin(tmp_path, {"study": "A study of sums.", "options": {"size": 3}})
    (tmp_path / "file").write_text("")
    assert STUDY.main(["--out", str(tmp_path / "file")]) == 1
    assert "Cannot write into" in capsys.readouterr().err
