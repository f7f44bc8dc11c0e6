"""The current of a dive from its GPS fixes: recovered in simulated dives, and left unsaid where nothing tells it."""

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.currents import dive_currents, no_currents
from auv_gym.plant.flying import neutral_engine
from auv_gym.plant.record_check import described
from auv_gym.records.log import FIXES
from auv_gym.records.record import Record, concat

EPOCH, LATITUDE = 1.4e9, 47.0
NORTH, EAST = 111175.0, 76057.0  # m for a degree at 47 deg north (tables of WGS 84)
CURRENT = (0.08, -0.15)  # m/s
DRIFT = 300.0  # s at the surface, before a dive and after it


@pytest.fixture(scope="module")
def glider() -> Plant:
    return load_vehicle("seaglider")


def dive(glider: Plant, begun: float, heading: float) -> Record:
    """A dive and a climb in a current, as its log has them, with a fix before and one after."""
    time = np.arange(0.0, 4500.0, 10.0)
    down = time < 1500.0
    engine = neutral_engine(glider, 100.0) + np.where(down, -2e-4, 3e-4)
    columns = {"buoyancy_volume_m3": engine, "pitch_rad": np.where(down, -0.35, 0.35)}
    columns |= {"heading_rad": np.full(time.size, heading), "depth_m": np.full(time.size, 0.5)}
    moving = replace_at(glider, dict(zip(("effects.current.north", "effects.current.east"), CURRENT, strict=True)))
    flown = simulate(moving, Record.from_arrays(time, columns))
    last = int(np.flatnonzero((flown["depth_m"] < 1.0) & ~down)[0])
    place = np.array([flown["north_m"][last], flown["east_m"][last]]) + 2.0 * DRIFT * np.array(CURRENT)
    degrees = place / (NORTH, EAST)
    fixes = [EPOCH + begun - DRIFT, LATITUDE, -125.0, EPOCH + begun + time[last] + DRIFT]
    fixes += [LATITUDE + degrees[0], -125.0 + degrees[1]]
    own = slice(0, last + 1)
    values = {name: column[own] for name, column in columns.items()} | {"depth_m": flown["depth_m"][own]}
    return Record.from_arrays(begun + time[own], values, attrs={FIXES: fixes, "start_epoch_s": EPOCH})


def test_the_current_of_each_dive_is_found(glider):
    record = described(glider, concat([dive(glider, 0.0, 0.7), dive(glider, 6000.0, 4.0)]))
    assert len(record.segments) > 2
    found = dive_currents(glider, record)
    assert len(found) == 2
    for current in found:
        # measured, 0.0006: what is left out at the turn goes on evenly, and the glider is slower there
        assert (current.north, current.east) == pytest.approx(CURRENT, abs=0.001)
    assert found[1].start > found[0].stop
    deep = dive_currents(glider, record.select(record["depth_m"] > 30.0))
    assert (deep[0].north, deep[0].east) == pytest.approx(CURRENT, abs=0.001)


def test_standard_errors_are_of_fixes_surface_compass_and_flight(glider):
    record = described(glider, dive(glider, 0.0, 0.0))
    (found,) = dive_currents(glider, record)
    lasted = found.stop - found.start
    through = 0.25 * lasted  # m, to the north: some 0.25 m/s
    fixes, drift = 5.0 * 2.0**0.5 / lasted, 0.15 * 2.0 * DRIFT / lasted
    assert found.north_error == pytest.approx(np.hypot(fixes, drift), rel=0.05)  # the climb from 0.5 m is drift, too
    assert found.east_error == pytest.approx(
        np.sqrt(fixes**2 + drift**2 + (np.deg2rad(2.0) * through / lasted) ** 2), rel=0.1
    )
    slower = replace_at(glider, "hull.drag_0", 1.3 * glider.hull.drag_0)
    (moved,), (wide,) = dive_currents(slower, record), dive_currents(glider, record, [slower])
    assert (wide.north, wide.east) == (found.north, found.east)
    assert wide.north_error == pytest.approx(np.hypot(found.north_error, moved.north - found.north), rel=1e-9)
    assert (
        wide.words
        == f"{wide.north:.3f} ± {1.96 * wide.north_error:.3f} and {wide.east:.3f} ± {1.96 * wide.east_error:.3f} m/s"
    )


def test_nothing_is_said_without_fixes_or_a_heading(glider):
    record = described(glider, dive(glider, 0.0, 0.7))
    assert dive_currents(glider, record)
    assert dive_currents(glider, record.without(["heading_rad"])) == ()
    bare = Record(record.dataset.assign_attrs({FIXES: []}))
    assert dive_currents(glider, bare) == ()
    assert dive_currents(load_vehicle("qiandao_float"), record) == ()


def test_a_log_without_fixes_or_a_heading_says_that_its_currents_are_not_known(glider):
    record = dive(glider, 0.0, 0.7)
    assert no_currents(glider, record) == ""
    bare, blind = Record(record.dataset.assign_attrs({FIXES: []})), record.without(["heading_rad"])
    for log, words in ((bare, "The log has no GPS fixes from before"), (blind, "The log has no heading (heading_rad)")):
        (line,) = (note for note in described(glider, log).notes if "currents" in note)
        assert line.startswith(words)
        assert line.endswith("so the currents of its dives cannot be computed.")
    tracked = bare.with_channels({"north_m": bare.time, "east_m": bare.time})
    assert no_currents(glider, tracked) == ""  # its currents are effects like others
    assert no_currents(load_vehicle("qiandao_float"), bare) == ""
