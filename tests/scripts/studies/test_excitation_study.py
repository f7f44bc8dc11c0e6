"""The information in each design, what is printed and drawn, and the guide's table."""

import re
from pathlib import Path

import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.excitation import make_signal
from identification.experiments.multisine import crest_factor
from scripts.studies.excitation import (
    DT,
    PLANES,
    STUDY,
    frequencies,
    information,
    model_band,
    share_in_band,
    spectrum,
)

GUIDE = Path(__file__).parents[3] / "docs" / "excitation.md"


@pytest.fixture(scope="module")
def found():
    return STUDY.find(range(5))


def test_the_band_holds_the_poles_of_the_vertical_plane():
    # 18 s of the slow pole and 1.7 s of the pitch mode, from the linear form
    low, high = model_band()
    assert low == pytest.approx(0.0538 / 3.0, rel=1e-2)
    assert high == pytest.approx(0.602, rel=1e-2)


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


def test_designs_of_more_power_tell_more(found):
    assert all(run["smallest"] == 0.0 and not run["signals"] for run in found.of("none"))
    middle = {name: np.median([run["smallest"] for run in runs.values()]) for name, runs in found.runs.items()}
    best = middle["PRBS, clock 4 s"]
    assert best == max(middle.values())
    assert 0.3 < middle["multisine, 20 lines a plane"] / best < 0.7
    assert middle["relay on pitch, +-1 deg"] < 1e-3 * best
    assert min(value for name, value in middle.items() if name != "none") > 0.0
    multisine = found.of("multisine, 20 lines a plane")
    assert all(run["crest"] < 1.5 and run["in_band"] == pytest.approx(1.0) for run in multisine)
    # the loop holds the depth; 3 deg at both planes are more than 5 deg of pitch allow
    every = [run for name in found.runs for run in found.of(name)]
    assert max(run["depth"] for run in every) < 1.5
    assert max(run["pitch"] for run in every) < np.radians(9.0)


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


def test_the_guide_has_the_table_that_is_printed(found):
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in GUIDE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    told = {cells[0]: cells for cells in lines}
    for row in STUDY.sheets(found)[0].rows:
        for shown, value in zip(told[row[0]][1:], row[1:], strict=True):
            numbers, expected = (
                np.array([float(x) for x in re.findall(r"[\d.]+(?:e-?\d+)?", c)]) for c in (shown, value)
            )
            # another machine may round the other way, and a closed loop carries that on
            np.testing.assert_allclose(numbers, expected, rtol=0.1, atol=0.011, err_msg=row[0])


def test_the_picture_has_a_row_for_each_design_that_adds_something(found):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    figure = STUDY.pictures(found)["excitation.png"]()
    assert len(figure.axes) == 3 * (len(found.runs) - 1)


def test_an_amplitude_of_nothing_is_refused(capsys):
    assert STUDY.main(["--amplitude", "0"]) == 1
    assert "--amplitude needs 0.001 or more, got 0.0" in capsys.readouterr().err
