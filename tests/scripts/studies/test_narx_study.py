"""The study of nonlinear black boxes: a small run on the toy, whose nonlinearity a linear model cannot have."""

import numpy as np
import pytest

from scripts.studies import narx
from scripts.studies.narx import METHODS, STUDY, toy


def test_linear_models_lack_what_the_toy_has(monkeypatch):
    monkeypatch.setattr(narx, "METHODS", {name: METHODS[name] for name in ("ARX 2", "ARMAX 3")})
    found = STUDY.find(range(2), ["toy*"])
    assert list(found.runs) == ["toy", "toy, noisy"]
    shown, every = STUDY.sheets(found)
    assert [row[:3] for row in shown.rows] == [["toy", "yaw rate", noise] for noise in ("no", "yes")]
    fits = [run["ARX 2"]["r_radps"] for run in found.of("toy")]
    assert 40.0 < min(fits) < max(fits) < 80.0
    assert shown.rows[0][3] == f"{np.median(fits):.1f} ({min(fits):.0f})"
    assert len(every.rows) == 8
    noise = np.std(toy(0, True)["r_radps"] - toy(0, False)["r_radps"])
    assert noise == pytest.approx(narx.TOY_NOISE, rel=0.1)


@pytest.mark.slow  # fits by free runs
def test_bells_are_worth_it_on_the_toy(monkeypatch):
    monkeypatch.setattr(narx, "METHODS", {"NARX 2": METHODS["NARX 2"]})
    assert STUDY.find(range(1), ["toy"]).of("toy")[0]["NARX 2"]["r_radps"] > 95.0
