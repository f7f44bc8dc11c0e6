import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.density import Profile, read_profiles, with_density
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record

ONE = "pressure_dbar,density_kgpm3\n0,1025\n100,1027\n50,1026\n"
TWO = "dive_id,depth_m,density_kgpm3\na,0,1025\na,100,1026\nc,0,1020\nc,100,1030\n"


def _write(tmp_path, text):
    path = tmp_path / "ctd.csv"
    path.write_text(text)
    return path


def _record(labels=("a",)):
    time = np.concatenate([np.arange(5.0)] * len(labels))
    depth = np.concatenate([np.array([0.0, 10.0, 20.0, 60.0, 95.0])] * len(labels))
    segment = np.repeat(labels, 5)
    return Record.from_arrays(time, {"depth_m": depth, "piston_m": np.full(time.size, 0.55)}, segment=segment)


def test_a_profile_over_pressure_is_sorted_and_read_at_depth(tmp_path):
    profile = read_profiles(_write(tmp_path, ONE))[""]
    assert list(profile.density) == [1025.0, 1026.0, 1027.0]
    assert profile.depth[1] == pytest.approx(49.57, abs=0.01)
    assert profile.at(np.array([profile.depth[1]])) == pytest.approx(1026.0)


def test_beyond_its_ends_a_profile_goes_on_with_its_outer_slope():
    profile = Profile.of("", np.array([10.0, 20.0, 30.0]), np.array([1000.0, 1001.0, 1003.0]))
    np.testing.assert_allclose(profile.at(np.array([0.0, 40.0])), [999.0, 1005.0])


def test_each_segment_takes_its_own_profile_or_the_nearest(tmp_path):
    record = with_density(_record(("a", "b", "c")), read_profiles(_write(tmp_path, TWO)))
    gradient = record["density_gradient_kgpm4"].reshape(3, 5)
    np.testing.assert_allclose(gradient[:, 1], [0.01, 0.01, 0.1])
    np.testing.assert_allclose(record["density_depth_m"], record["depth_m"])
    assert record["density_kgpm3"][1] == pytest.approx(1025.1)


def test_dives_may_be_numbers(tmp_path):
    """Records and profiles count dives in one way, whatever a file writes."""
    numbered = TWO.replace("a,", "1,").replace("c,", "3.0,")
    profiles = read_profiles(_write(tmp_path, numbered))
    assert list(profiles) == ["1", "3"]
    log = tmp_path / "log.csv"
    log.write_text(
        "dive_id,time_s,depth_m,piston_m\n" + "".join(f"{d},{t},{10 + t},0.5\n" for d in (1, 3) for t in range(5))
    )
    record = with_density(read_record(log), profiles)
    assert record.labels == ["1", "3"]
    assert record["density_kgpm3"][0] == pytest.approx(1025.1)
    with pytest.raises(ValueError, match="None of the profiles \\(7, 8\\) belongs to a segment"):
        with_density(record, {"7": profiles["1"], "8": profiles["3"]})


def test_one_profile_serves_all_and_strangers_are_refused(tmp_path):
    one = read_profiles(_write(tmp_path, ONE))
    assert with_density(_record(("x", "y")), one).has("density_kgpm3")
    with pytest.raises(ValueError, match=r"None of the profiles \(a, c\).*'x'.*give one profile"):
        with_density(_record(("x",)), read_profiles(_write(tmp_path, TWO)))


@pytest.mark.parametrize(
    "text, words",
    [
        (
            "depth_m,temperature_C\n0,10\n5,9\n",
            "needs the columns density_kgpm3 and depth_m or pressure_dbar, got depth_m",
        ),
        ("depth_m,density_kgpm3\n0,25.1\n5,26.0\n", r"goes from 25.1 to 26; water has 950 to 1100.*not an anomaly"),
        ("depth_m,density_kgpm3\n5,1025\n5,1026\n", "needs at least 2 depths with a density, got 1"),
        ("depth_furlong,density_kgpm3\n0,1025\n5,1026\n", "unknown unit suffix"),
    ],
)
def test_bad_profiles_are_refused(tmp_path, text, words):
    with pytest.raises(ValueError, match=words):
        read_profiles(_write(tmp_path, text))


def test_a_linear_profile_acts_as_a_gradient_does():
    plant = load_vehicle("qiandao_float")
    time = np.arange(0.0, 400.0, 0.7)
    record = Record.from_arrays(time, {"depth_m": 20.0 + 0.0 * time, "piston_m": np.where(time < 150.0, 0.5, 0.56)})
    gradient = simulate(replace_at(plant, "effects.water.gradient", 0.02), record)["depth_m"]
    line = Profile.of("", np.array([0.0, 100.0]), plant.hull.density + np.array([0.0, 2.0]))
    # the profile is read along the measured way, here a constant depth; its slope carries it to where the model is
    measured = simulate(plant, with_density(record, {"": line}))["depth_m"]
    np.testing.assert_allclose(measured, gradient, atol=1e-9)
    assert abs(measured - simulate(plant, record)["depth_m"]).max() > 1.0
