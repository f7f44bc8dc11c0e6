"""The information in each design, what is printed and drawn, and the guide's table."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.excitation import make_signal
from identification.experiments.multisine import crest_factor
from scripts.excitation_table import (
    DT,
    PLANES,
    as_json,
    depth_pilot,
    designs,
    environment,
    fly,
    frequencies,
    information,
    main,
    model_band,
    rows,
    share_in_band,
    spectrum,
)

GUIDE = Path(__file__).parents[2] / "docs" / "excitation.md"


@pytest.fixture(scope="module")
def results():
    env = environment()
    band = model_band(env.unwrapped.plant)
    pilot = depth_pilot(env)
    return [fly(env, pilot, design, np.radians(3.0), 5, band) for design in designs(band)], band


def test_the_band_holds_the_poles_of_the_vertical_plane(results):
    _, band = results
    # 18 s of the slow pole and 1.7 s of the pitch mode, from the linear form
    assert band[0] == pytest.approx(0.0538 / 3.0, rel=1e-2)
    assert band[1] == pytest.approx(0.602, rel=1e-2)


def test_information_by_hand():
    """Independent white signals: each column has its own variance, in its own unit."""
    plant, rng = load_vehicle("npsauv", dt=DT), np.random.default_rng(0)
    n, stop = 20_000, value_at(load_vehicle("npsauv"), "parts.stern_plane.limit")
    signals = {name: 0.1 * stop * rng.standard_normal(n) for name in PLANES}
    record = Record.from_arrays(DT * np.arange(n), {"depth_m": 7.0 + 5.3 * 0.3 * rng.standard_normal(n), **signals})
    smallest, condition = information(plant, record)
    assert smallest == pytest.approx(0.1**2, rel=0.05)
    assert condition == pytest.approx(9.0, rel=0.05)


def test_a_spectrum_keeps_the_mean_square():
    rng = np.random.default_rng(1)
    values = 3.0 + rng.standard_normal(150)
    assert spectrum(values).sum() == pytest.approx(values.var())
    assert frequencies(150)[-1] == pytest.approx(np.pi / DT)
    power = spectrum(np.sin(frequencies(150)[9] * DT * np.arange(150)))
    assert share_in_band([power], (frequencies(150)[8], frequencies(150)[10])) == pytest.approx(1.0)
    assert share_in_band([power], (frequencies(150)[10], 1.0)) == pytest.approx(0.0, abs=1e-12)


def test_without_excitation_the_planes_are_not_told_apart(results):
    assert all(told.smallest == 0.0 for told in results[0][0].told)
    assert not results[0][0].signals


def test_designs_of_more_power_tell_more(results):
    middle = {r.design.name: np.median([t.smallest for t in r.told]) for r in results[0]}
    best = middle["PRBS, clock 4 s"]
    assert best == max(middle.values())
    assert 0.3 < middle["multisine, 20 lines a plane"] / best < 0.7
    assert middle["relay on pitch, +-1 deg"] < 1e-3 * best
    assert min(value for name, value in middle.items() if name != "none") > 0.0
    multisine = next(r for r in results[0] if r.design.kind == "multisine")
    assert all(t.crest < 1.5 and t.in_band == pytest.approx(1.0) for t in multisine.told)
    # the loop holds the depth; 3 deg at both planes are more than 5 deg of pitch allow
    assert max(t.depth for r in results[0] for t in r.told) < 1.5
    assert max(t.pitch for r in results[0] for t in r.told) < np.radians(9.0)


def test_the_guide_s_example_runs():
    example = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)[0]
    names = {}
    exec(example, names)
    reading = {"depth_m": 60.0, "pitch_rad": 0.0, "q_radps": 0.0, "dt_s": 4.0}
    command, _ = names["safe"].act(names["safe"].start(), reading, {"depth_m": 60.0})
    assert abs(command["excitation_stern_plane_rad"]) == 0.05
    assert command["envelope_flag"] == 0.0


def test_the_guide_has_the_crest_factors_of_multisines():
    cells = [line.strip("| ").split(" | ") for line in GUIDE.read_text(encoding="utf-8").splitlines()]
    (lines,) = (row[1:] for row in cells if row[0] == "lines")
    (told,) = (row[1:] for row in cells if row[0] == "crest factor")
    for which, value in zip(lines, told, strict=True):
        chosen = {"20 odd": list(range(1, 40, 2)), "31 to 50": list(range(31, 51))}.get(which) or int(which)
        if chosen != 100:  # takes two seconds
            found = crest_factor(
                make_signal("multisine", 6000, 0.1, np.random.default_rng(0), amplitude=1.0, lines=chosen)
            )
            assert found == pytest.approx(float(value), abs=0.011)


def test_the_guide_has_the_table_that_is_printed(results):
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in GUIDE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    told = {cells[0]: cells for cells in lines}
    for row in rows(results[0]):
        for shown, value in zip(told[row[0]][1:], row[1:], strict=True):
            numbers, expected = (
                np.array([float(x) for x in re.findall(r"[\d.]+(?:e-?\d+)?", c)]) for c in (shown, value)
            )
            # another machine may round the other way, and a closed loop carries that on
            np.testing.assert_allclose(numbers, expected, rtol=0.1, atol=0.011, err_msg=row[0])


def test_main_prints_and_draws(tmp_path, capsys, results, monkeypatch):
    image = pytest.importorskip("matplotlib.image", reason="the extra `render` is not installed")
    few = results[0][:3]
    first = iter(few)
    monkeypatch.setattr("scripts.excitation_table.designs", lambda band: [r.design for r in few])
    monkeypatch.setattr("scripts.excitation_table.fly", lambda *given: next(first))
    assert main(["--out", str(tmp_path / "new"), "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert found == json.loads(json.dumps(as_json(few, results[1])))
    assert found["designs"]["none"]["condition"] is None
    assert found["designs"]["PRBS, clock 4 s"]["crest"]["median"] == pytest.approx(1.0)
    assert f"Written to {tmp_path / 'new' / 'excitation.png'}" in said.err
    pixels = image.imread(tmp_path / "new" / "excitation.png")[..., :3]
    assert min(pixels.shape[:2]) > 200
    assert 0.02 < np.mean(pixels.min(axis=2) < 0.9) < 0.5  # lines and words on white


def test_main_prints_a_table(capsys, results, monkeypatch):
    first = iter(results[0])
    monkeypatch.setattr("scripts.excitation_table.fly", lambda *given: next(first))
    monkeypatch.setenv("COLUMNS", "170")
    assert main([]) == 0
    said = capsys.readouterr().out
    for row in rows(results[0]):
        assert row[0] in said
    assert "smallest eigenvalue" in said


@pytest.mark.parametrize("arguments", [["--amplitude", "0"], ["--seeds", "0"]])
def test_main_says_what_is_wrong(arguments, capsys):
    assert main(arguments) == 1
    assert "--amplitude needs more than 0 deg and --seeds 1 or more" in capsys.readouterr().err
