"""Trends over missions: the line with a scatter of its own, and a series that is stopped and goes on."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.changes.page import write_series
from identification.changes.series import MISSIONS, follow_series, line
from identification.experiments.heading_control import closed_loop

OFFSET = "effects.rudder.offset"


def test_a_line_holds_its_slope_where_missions_scatter_and_is_weighted_where_they_do_not():
    rng, at = np.random.default_rng(0), np.arange(12.0)
    errors, held = rng.uniform(0.1, 0.3, at.size), []
    for scatter in (0.0, 1.0):
        found = [
            line(at, 0.2 * at + errors * rng.standard_normal(12) + scatter * rng.standard_normal(12), errors)
            for _ in range(400)
        ]
        slopes, stated, scatters, levels = np.array(found).T
        assert np.mean(slopes) == pytest.approx(0.2, abs=4.0 * np.std(slopes) / 20.0)
        assert np.mean(levels) == pytest.approx(0.2 * at.mean(), abs=4.0 * np.std(levels) / 20.0)
        assert np.median(scatters) == pytest.approx(scatter, abs=0.1)
        held.append(float(np.mean(np.abs(slopes - 0.2) < 2.228 * stated)))  # Student's t of ten degrees of freedom
    assert min(held) > 0.92  # 95 % of 400, less 3 standard errors


def test_a_trend_needs_four_missions(tmp_path):
    with pytest.raises(ValueError, match="at least 4 missions"):
        follow_series({}, load_vehicle("slocum"), tmp_path)


@pytest.mark.slow
def test_a_series_finds_what_grows_and_goes_on_where_it_was_stopped(tmp_path):
    plant, missions = load_vehicle("slocum"), {}
    for k in range(6):
        flown = replace_at(plant, OFFSET, 0.01 * k)
        missions[f"m{k}"] = closed_loop(flown, rng=np.random.default_rng(40 + k), duration=520.0)
    found = follow_series(missions, plant, tmp_path)
    trend = next(t for t in found.trends if t.path == OFFSET)
    assert trend.sure
    assert trend.rate.ci95[0] < 0.01 < trend.rate.ci95[1]
    written = {name: path.read_bytes() for name, path in write_series(found, tmp_path).items()}
    files = sorted((tmp_path / MISSIONS).iterdir())
    assert len(files) == 6
    files[2].unlink()
    files[4].write_text("half of a fi")  # what no such file can be, since each is written whole
    before = files[0].stat().st_mtime_ns
    again = follow_series(missions, plant, tmp_path, jobs=2)
    assert {name: path.read_bytes() for name, path in write_series(again, tmp_path).items()} == written
    assert files[0].stat().st_mtime_ns == before
