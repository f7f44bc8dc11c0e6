"""The study of nonlinear black boxes: what it judges, and what it prints."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from scripts import narx_study
from scripts.narx_study import METHODS, fits, main, toy


@pytest.mark.slow  # three fits by free runs
def test_bells_are_worth_it_on_the_toy(monkeypatch):
    chosen = {name: METHODS[name] for name in ("ARX 2", "NARX 2")}
    short = replace(narx_study.CASES["toy"], record=lambda seed, noisy: toy(seed, noisy, 500))
    monkeypatch.setattr(narx_study, "METHODS", chosen)
    monkeypatch.setattr(narx_study, "CASES", {"toy": short})
    found = fits("toy", False, 0)
    assert list(found) == list(chosen)
    assert found["ARX 2"]["r_radps"] < 80.0
    assert found["NARX 2"]["r_radps"] > 95.0


def test_the_program_prints_a_table_and_writes_json(monkeypatch, tmp_path, capsys):
    def made(case, noisy, seed):
        return {method: {"depth_m": 90.0 + seed if "NARX" in method else -np.inf} for method in METHODS}

    monkeypatch.setattr(narx_study, "fits", made)
    monkeypatch.setattr(narx_study, "CASES", {"float": narx_study.CASES["float"]})
    monkeypatch.setattr(narx_study, "all_of", lambda work, tasks, *rest: [work(*task) for task in tasks])
    monkeypatch.setattr(sys, "argv", ["narx_study", "--seeds", "3", "--json", str(tmp_path / "narx.json")])
    main()
    assert "depth" in capsys.readouterr().out
    told = json.loads((tmp_path / "narx.json").read_text())
    assert len(told) == 2 * len(METHODS)
    assert next(row for row in told if row["method"] == "NARX 2")["fit"] == pytest.approx([90.0, 91.0, 92.0])
