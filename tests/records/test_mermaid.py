"""Logs of MERMAID floats: stale pressures, oil moved between readings, what counts as a dive, and what is refused."""

import numpy as np
import pytest

from auv_gym.model import inputs_of
from auv_gym.plant import load_vehicle
from auv_gym.records.mermaid import COLUMNS, is_mermaid, mermaid_dives
from auv_gym.records.reading import read_record

ROWS = 14
# a dive: two rows at the surface, down, oil let in at the sixth row, pumped out at the tenth, up, a row at the surface
DEPTHS = np.array([0.4, 0.9, 10.0, 30.0, 50.0, 70.0, 90.0, 110.0, 100.0, 80.0, 60.0, 40.0, 20.0, 1.0])


def log(**changes) -> dict[str, np.ndarray]:
    """The columns of one dive, a row a minute; changes: whole columns."""
    k = np.arange(ROWS)
    valved, pumped = np.where(k >= 5, -20e-6, 0.0), np.where(k >= 9, 45e-6, 0.0)
    columns = {
        "depth_m": DEPTHS.copy(),
        "temperature_C": 20.0 - 0.05 * DEPTHS,
        "pumped_cum_m3": pumped,
        "valved_cum_m3": valved,
        "oil_volume_rel_m3": pumped + valved,
        "bypass_open_cum_s": np.where(k == 0, 5.0, 120.0),
        "surface_pump_cum_s": np.where(k >= ROWS - 1, 30.0, 0.0),
    }
    return {**columns, **changes}


def dives(*logs: dict[str, np.ndarray], order=None):
    """The record of these dives, labelled a, b, ..."""
    time = np.concatenate([60.0 * np.arange(ROWS)] * len(logs))
    columns = {name: np.concatenate([one[name] for one in logs]) for name in COLUMNS}
    labels = np.repeat([chr(ord("a") + i) for i in range(len(logs))], ROWS)
    order = np.arange(time.size) if order is None else order
    return mermaid_dives(time[order], {n: c[order] for n, c in columns.items()}, labels[order], "log.csv")


def at(values: np.ndarray, rows, value: float) -> np.ndarray:
    """The values with others at some rows."""
    values = values.copy()
    values[rows] = value
    return values


def test_a_dive_begins_below_the_surface_and_ends_there():
    record = dives(log())
    # no rows from before the bypass has closed, above 2 m, or after the pump has run at the surface
    assert np.array_equal(record.time, 60.0 * np.arange(2, 13))
    assert np.array_equal(record["depth_m"], DEPTHS[2:13])
    assert record.labels == ["a"]
    assert record.attrs["source"] == "log.csv"
    assert "oil_volume_m3: oil that pump and valves moved" in record.attrs["derived"]


def test_oil_comes_as_what_pump_and_valve_have_moved_and_how_deep_the_valve_was():
    record = dives(log())
    assert record["oil_volume_m3"] == pytest.approx(
        np.r_[np.zeros(3), np.full(4, -20e-6), np.full(4, 25e-6)], abs=1e-18
    )
    assert record["pumped_volume_m3"] == pytest.approx(np.r_[np.zeros(7), np.full(4, 45e-6)], abs=1e-18)
    assert record["valved_volume_m3"] == pytest.approx(np.r_[np.zeros(3), np.full(8, 20e-6)], abs=1e-18)
    assert record["valved_depth_m4"] == pytest.approx(np.r_[np.zeros(3), np.full(8, 20e-6 * 70.0)], abs=1e-16)


def test_it_is_what_an_oil_floats_plant_takes():
    plant, record = load_vehicle("mermaid"), dives(log(), log())
    u = dict(zip(plant.inputs, inputs_of(plant, record).T, strict=True))
    assert np.array_equal(u["elapsed_s"], np.tile(60.0 * np.arange(11), 2))
    assert np.array_equal(u["valved_depth_m4"], record["valved_depth_m4"])
    assert np.array_equal(u["temperature_C"], record["temperature_C"])


def test_a_pressure_that_repeats_the_one_before_it_is_no_reading():
    """Stale where no temperature was read with it; a float that stays at a depth is another matter."""
    stale = at(log()["temperature_C"], [4, 7], np.nan)
    record = dives(log(depth_m=at(at(DEPTHS, 4, 30.0), 7, 90.0), temperature_C=stale))
    assert np.array_equal(record.time / 60.0, [2, 3, 5, 6, 8, 9, 10, 11, 12])
    assert 30.0 in record["depth_m"]
    staying = dives(log(depth_m=at(DEPTHS, 4, 30.0)))
    assert len(staying) == 11
    new = dives(log(temperature_C=stale))
    assert len(new) == 11


def test_oil_moved_at_a_stale_row_keeps_its_time_and_gets_a_depth_between_its_neighbours():
    record = dives(log(depth_m=at(DEPTHS, 5, 50.0), temperature_C=at(log()["temperature_C"], 5, np.nan)))
    assert len(record) == 11
    assert record["depth_m"][3] == pytest.approx(70.0)
    assert record["oil_volume_m3"][3] == -20e-6
    assert record["valved_depth_m4"][-1] == pytest.approx(20e-6 * 70.0)


def test_temperatures_are_interpolated_in_time():
    record = dives(log(temperature_C=at(log()["temperature_C"], [4, 5], np.nan)))
    temperature = 20.0 - 0.05 * DEPTHS
    expected = at(temperature, 4, (2 * temperature[3] + temperature[6]) / 3)
    expected = at(expected, 5, (temperature[3] + 2 * temperature[6]) / 3)
    assert record["temperature_C"] == pytest.approx(expected[2:13], abs=1e-12)


def test_rows_in_another_order_and_rows_at_one_time_make_the_same_dives():
    in_order = dives(log(), log(depth_m=DEPTHS + 3.0))
    shuffled = dives(log(), log(depth_m=DEPTHS + 3.0), order=np.random.default_rng(0).permutation(2 * ROWS))
    assert sorted(shuffled.labels) == in_order.labels
    first = shuffled.labels.index("a")
    for name in in_order.names:
        assert np.array_equal(shuffled[name][shuffled.segments[first]], in_order[name][in_order.segments[0]])
    time = 60.0 * np.arange(ROWS)
    time[7] = time[6]  # an event and a reading of the same second: the first counts
    twice = mermaid_dives(time, log(), np.full(ROWS, "a"), "log.csv")
    assert len(twice) == 10
    assert 110.0 not in twice["depth_m"]


NOTHING_MOVED = {name: np.zeros(ROWS) for name in ("pumped_cum_m3", "valved_cum_m3", "oil_volume_rel_m3")}
UNUSABLE = {
    "never under": ({"depth_m": np.full(ROWS, 1.5)}, "0 readings below 2 m"),
    "short": ({"depth_m": np.where(np.arange(ROWS) < 7, DEPTHS, 0.0)}, "5 readings below 2 m"),
    "no action": (NOTHING_MOVED, "no buoyancy action, so its drag and volume cannot be told apart"),
    "no temperature": ({"temperature_C": np.full(ROWS, np.nan)}, "no temperature"),
}


@pytest.mark.parametrize("changes, words", UNUSABLE.values(), ids=UNUSABLE)
def test_a_dive_that_cannot_be_used_is_left_out_with_the_reason(changes, words):
    record = dives(log(), log(**changes), log())
    assert record.labels == ["a", "c"]
    assert record.notes == [f"dive b: left out, {words}."]


@pytest.mark.parametrize("changes, words", UNUSABLE.values(), ids=UNUSABLE)
def test_a_log_without_a_usable_dive_is_refused_dive_by_dive(changes, words):
    with pytest.raises(ValueError, match=r"log\.csv has no dive that can be used: a: .*; b: .*A dive needs") as refused:
        dives(log(**changes), log(**changes))
    assert str(refused.value).count(words) == 2


def test_a_log_is_known_by_its_columns():
    assert is_mermaid([*COLUMNS, "time_s", "stage"])
    assert not is_mermaid(COLUMNS[1:])


def csv(path, *logs, names=COLUMNS):
    lines = [",".join(("dive_id", "time_s", *names))]
    for index, one in enumerate(logs):
        for k in range(ROWS):
            values = ("" if np.isnan(one[name][k]) else repr(float(one[name][k])) for name in names)
            lines.append(",".join((f"dive-{index}", str(60 * k), *values)))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_file_of_dives_is_read_as_such(tmp_path):
    record = read_record(csv(tmp_path / "dives.csv", log(), log(temperature_C=at(log()["temperature_C"], 4, np.nan))))
    assert record.labels == ["dive-0", "dive-1"]
    assert record["depth_m"][record.segments[1]] == pytest.approx(DEPTHS[2:13])
    assert record.attrs["source"] == "dives.csv"


def test_a_file_without_buoyancy_actions_says_so_with_its_name(tmp_path):
    with pytest.raises(ValueError, match=r"calm\.csv has no dive that can be used: dive-0: no buoyancy action"):
        read_record(csv(tmp_path / "calm.csv", log(**NOTHING_MOVED)))


def test_text_among_the_numbers_of_a_log_counts_as_missing(tmp_path):
    path = csv(tmp_path / "dives.csv", log())
    text = path.read_text(encoding="utf-8").replace("\ndive-0,240,50.0,", "\ndive-0,240,deep,")
    path.write_text(text, encoding="utf-8")
    record = read_record(path)
    assert any("cells are not numbers ('deep' in row" in line for line in record.notes)
    assert np.isfinite(record["depth_m"]).all()


@pytest.mark.parametrize(
    "name, count, deepest", [("free_drift_dives", 9, 1999.0), ("fixed_point_february_dives", 12, 71.4)]
)
def test_the_measured_dives(shared_data, name, count, deepest):
    record = read_record(shared_data / "mermaid" / f"{name}.csv")
    assert len(record.labels) == count
    assert record.notes == []
    assert record["depth_m"].min() > 2.0
    assert record["depth_m"].max() == pytest.approx(deepest, abs=0.1)
    for segment in record.segments:
        oil, depth = record["oil_volume_m3"][segment], record["valved_depth_m4"][segment]
        assert np.all(np.diff(record.time[segment]) > 0.0)
        assert np.count_nonzero(np.diff(oil)) >= 10
        moved = record["pumped_volume_m3"][segment] - record["valved_volume_m3"][segment]
        assert oil == pytest.approx(moved, abs=5e-9)  # the log's own digits
        assert np.all(np.diff(depth) >= 0.0)
