"""Diagnosis of measured dives; skipped where the measured records are absent."""

import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.density import read_profiles, with_density
from auv_gym.records.reading import read_record
from identification.diagnosis import diagnose

COMPRESSIBILITY, GRADIENT = "effects.volume.compressibility", "effects.water.gradient"


@pytest.mark.slow
def test_free_drift_dives_need_lift_that_grows_with_depth(shared_data):
    record = read_record(shared_data / "mermaid" / "free_drift_dives.csv")
    d = diagnose(record, load_vehicle("mermaid"))
    assert d.verdict == "tied"
    assert {COMPRESSIBILITY, GRADIENT} in [set(group) for group in d.tied]
    before, after = (stage.scores["depth_m"].rmse for stage in (d.before, d.after))
    assert after < 0.2 * before  # measured: 106 m and 13.8 m
    # nothing of a held-out dive is in the fit
    segments = record.segments
    fitted, held = ({next(k for k, s in enumerate(segments) if w.start < s.stop) for w in part} for part in d.windows)
    assert not fitted & held
    # about 0.1 mL/m more lift with depth
    found, hull = d.effects[0], d.given.plant.hull
    per_metre = found.value if found.path == COMPRESSIBILITY else found.value * hull.mass / hull.density**2
    assert 0.06e-6 < per_metre < 0.11e-6


@pytest.mark.slow
def test_with_the_waters_density_measured_the_hull_is_named(shared_data):
    folder = shared_data / "mermaid"
    record = read_record(folder / "free_drift_dives.csv")
    d = diagnose(with_density(record, read_profiles(folder / "ctd_profiles_1dbar.csv")), load_vehicle("mermaid"))
    assert d.verdict == "named"
    assert [e.path for e in d.effects] == [COMPRESSIBILITY]
    assert -0.08e-6 < d.effects[0].value < -0.055e-6  # a hull that is squeezed loses lift; measured: -0.068 mL/m
    assert d.after.scores["depth_m"].rmse < 0.3 * d.before.scores["depth_m"].rmse


@pytest.mark.slow
def test_tethered_dives_are_not_explained_away(shared_data):
    d = diagnose(read_record(shared_data / "mermaid" / "fixed_point_february_dives.csv"), load_vehicle("mermaid"))
    assert d.verdict == "unexplained"
